"""Text in any encoding: found by its mark, its zeros, or by what UTF-8 refuses."""

import codecs

import pytest

from flgpr.store.text import decode_text, utc_text, zoned_time

TEXT = "Länge;5\n"


@pytest.mark.parametrize(
    ("data", "encoding"),
    [
        (TEXT.encode(), None),
        (codecs.BOM_UTF8 + TEXT.encode(), None),
        (codecs.BOM_UTF16_LE + TEXT.encode("utf-16-le"), "UTF-16"),
        (codecs.BOM_UTF32_BE + TEXT.encode("utf-32-be"), "UTF-32"),
        (TEXT.encode("utf-16-be"), "UTF-16 without a mark"),
        (TEXT.encode("latin-1"), "Latin-1, which is assumed because it is no UTF-8"),
    ],
)
def test_the_encoding_is_found_and_noted(data, encoding):
    notes = []
    assert decode_text(data, "a.csv", notes) == TEXT
    assert notes == ([] if encoding is None else [f"a.csv is text in {encoding}"])


def test_text_that_breaks_its_mark_is_refused():
    with pytest.raises(ValueError, match=r"a\.csv begins as UTF-16 and is none at byte 2"):
        decode_text(codecs.BOM_UTF16_LE + b"\x00\xd8\x00", "a.csv")


def test_a_time_has_a_zone_or_is_none_and_is_written_in_utc():
    assert zoned_time("2026-05-04T09:30:00") is None
    assert zoned_time("noon") is None
    assert zoned_time(5) is None
    assert utc_text(zoned_time("2026-05-04T09:30:00+02:00")) == "2026-05-04T07:30:00.000000Z"
