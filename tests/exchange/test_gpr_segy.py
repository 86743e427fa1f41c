"""SEG-Y as radars write it: revisions, sample counts, coordinates."""

import numpy as np

from flgpr.formats import read_gpr
from io_gpr import (
    write_segy,
)
from io_recordings import COUNTS, TRACES, notes_with, patched, segy_words


def test_words_that_change_the_meaning_of_a_trace_are_told(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(
        path, TRACES, dead=(28, ">h", lambda k: 2 if k == 3 else 1), offset=(36, ">i", lambda k: k)
    )
    read = read_gpr(path)
    assert np.isnan(read.traces[3]).all()
    np.testing.assert_array_equal(
        np.delete(read.traces[:, 0], 3, axis=0), np.delete(COUNTS, 3, axis=0)
    )
    assert notes_with(read, "1 traces without data")
    assert notes_with(read, "the distance from source to receiver (bytes 37-40) goes from 0 to 29")
    odd = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3254, ">H", 9), (3600 + 88, ">h", 1))
    assert notes_with(read_gpr(odd), "its measurement system is 9, which does not exist")
