"""Header words that change the meaning, and headers in other layouts and encodings."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from io_gpr import (
    write_dt1,
    write_impulse,
    write_mala,
)
from io_recordings import (
    COUNTS,
    notes_with,
)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("kind", ["dt1", "rd3", "iprb"])
def test_headers_in_other_encodings(kind, encoding, tmp_path):
    write, suffix = {
        "dt1": (write_dt1, ".hd"),
        "rd3": (write_mala, ".RAD"),
        "iprb": (write_impulse, ".iprh"),
    }[kind]
    path = write(tmp_path / f"a.{kind}", COUNTS, SITE="Grünfläche", OPERATOR="Öster")
    head = path.with_suffix(suffix)
    plain = head.read_text(encoding="utf-8")
    head.write_bytes(plain.encode(encoding))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert bool(notes_with(read, "is text in")) == (encoding != "utf-8-sig")
    if kind == "rd3":
        assert read.title == "Grünfläche"
