"""IDS GeoRadar's DT: records, marks, and files that contradict themselves."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from io_gpr import (
    STEP,
    section,
    write_ids,
)

COUNTS = section()


def test_what_records_of_ids_say_counts(tmp_path):
    read = read_gpr(write_ids(tmp_path / "a.dt", COUNTS, lost=3))
    assert np.isnan(read.traces[3]).all()
    assert np.isfinite(np.delete(read.traces, 3, axis=0)).all()
    assert read.marks == (7,)
    assert any(
        "unsigned" in one
        for one in read_gpr(write_ids(tmp_path / "u.dt", COUNTS, unsigned=32768)).history
    )
    assert read_gpr(write_ids(tmp_path / "w.dt", COUNTS, apart=0)).separation is None
    for entries, said in (
        ({"window": 1e3}, "a time in seconds"),
        ({"samples": 999}, "samples must be from 2 to the 256"),
    ):
        with pytest.raises(ValueError, match=said):
            read_gpr(write_ids(tmp_path / "b.dt", COUNTS, **entries))
    path = write_ids(tmp_path / "c.dt", COUNTS)
    raw = bytearray(path.read_bytes())
    raw[-516] = 0
    path.write_bytes(raw)
    with pytest.raises(ValueError, match="trace 39 must begin with R, got byte 0x00"):
        read_gpr(path)


def real_layout(path):
    """Lay a file out as instruments write it: bytes behind the H, antennas in ATX and ARX."""
    raw = path.read_bytes()
    size = int.from_bytes(raw[4:6], "little")
    records = [raw[k : k + size] for k in range(0, len(raw), size)]
    place = b"".join(f"{value:16.6E}".encode() for value in (0, -0.09, 0)) + b" 3000"
    other = b"".join(f"{value:16.6E}".encode() for value in (0, -0.03, 0)) + b" 3000"
    laid = []
    for one in records:
        if one[:3] == b"ATR":
            laid += [
                b"ATX\0" + place.ljust(size - 4, b"\0"),
                b"ARX\0" + other.ljust(size - 4, b"\0"),
            ]
        elif one[:1] == b"H":
            laid += [b"AC1\0".ljust(size, b"\0"), b"S\0\0\0RT N_CHANNEL= 1".ljust(size, b"\0")]
            laid.append(b"H\x15\x04\0" + one[4:])
        else:
            laid.append(one)
    path.write_bytes(b"".join(laid))
    return path


def test_the_layout_of_real_instruments(tmp_path):
    read = read_gpr(real_layout(write_ids(tmp_path / "a.dt", COUNTS)))
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert read.frequencies == (3e9,)
    assert read.separation == pytest.approx(0.06)
    assert read.distance[1] == pytest.approx(STEP)
    assert any("0.05 m in field 7 and 0.01 m in field 9" in note for note in read.history)


def test_channels_side_by_side_come_apart(tmp_path):
    both = np.stack([COUNTS, COUNTS[::-1] // 3], axis=1).reshape(-1, COUNTS.shape[1])
    path = real_layout(write_ids(tmp_path / "a.dt", both, traces=0))
    path.write_bytes(path.read_bytes().replace(b"N_CHANNEL= 1", b"N_CHANNEL= 2"))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert read.traces.shape[1] == 2
    assert len(read.frequencies) == 2
