"""Messages of ROS 2 in plain CDR, by their definitions."""

import struct

import pytest

from flgpr_exchange.bags.cdr import message_decoder


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Own own", "holds itself"),
        ("Other[] others", "missing"),
        ("wstring name", "wide"),
        ("float64", "no field"),
    ],
)
def test_definitions_that_make_no_sense(text, words):
    with pytest.raises(ValueError, match=words):
        message_decoder("made/msg/Own", text)


def test_content_is_checked_before_memory_is_taken():
    decode = message_decoder("made/msg/Own", "Id[] ids\n===\nMSG: made/Id\nuint8[16] uuid")
    head = b"\0\1\0\0"
    assert len(decode(head + struct.pack("<I", 2) + bytes(32))["ids"]) == 2
    for content in (struct.pack("<I", 2**32 - 1) + bytes(64), b"", struct.pack("<I", 1)):
        with pytest.raises(ValueError, match="cut off"):
            decode(head + content)
    with pytest.raises(ValueError, match="plain CDR"):
        decode(b"\0\7\0\0" + bytes(8))


def test_big_endian_and_alignment():
    decode = message_decoder(
        "made/msg/Own",
        "uint8 a\nfloat64 b\nstring c\nint16[<=3] d\nint16[2] e\nEmpty f\n===\nMSG: made/Empty\n",
    )
    for order, mark in ((">", 0), ("<", 1)):
        body = (
            struct.pack(order + "B7xd", 3, 1.5)
            + struct.pack(order + "I", 3)
            + b"hi\0\0"
            + struct.pack(order + "Ihh2hB", 2, 4, 5, 6, 7, 0)
        )
        told = decode(bytes([0, mark, 0, 0]) + body)
        assert (told["a"], told["b"], told["c"]) == (3, 1.5, "hi")
        assert told["d"].tolist() == [4, 5]
        assert told["e"].tolist() == [6, 7]
