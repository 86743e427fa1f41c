"""IDS GeoRadar's DT: records, marks, and files that contradict themselves."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from io_gpr import (
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
