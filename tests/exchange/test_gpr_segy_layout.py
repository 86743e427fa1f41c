"""Where the traces of a SEG-Y lie: revisions, extra headers, sample counts and intervals."""

import numpy as np
import pytest

from flgpr.formats import read_gpr
from io_gpr import (
    INTERVAL,
    SAMPLES,
    write_segy,
)
from io_recordings import ALONG, COUNTS, TRACES, notes_with, patched, segy_words, with_extra_headers


@pytest.mark.parametrize(
    ("revision", "count", "form"),
    [(b"\2\0", 1, ">i"), (b"\2\0", 1, ">h"), (b"\2\1", 2, ">h"), (b"\2\1", 1, ">i")],
)
def test_extra_headers_of_revision_2_are_passed_over(revision, count, form, tmp_path):
    path = with_extra_headers(write_segy(tmp_path / "a.sgy", COUNTS), TRACES, revision, count, form)
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, f"every trace has {count} extra headers")
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-9)


def test_a_revision_that_does_not_exist_stays_readable(tmp_path):
    path = patched(
        write_segy(tmp_path / "a.sgy", COUNTS),
        (3500, ">H", 0x2425),
        (3504, ">h", 3),
        (3506, ">i", 77),
    )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, "its revision word is 36.37, which does not exist")
    assert notes_with(read, "its traces begin at byte 3600, not at 13200")


def test_samples_and_interval_of_the_trace_headers(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, samples=(114, ">H", SAMPLES), interval=(116, ">H", 200))
    read = read_gpr(patched(path, (3220, ">H", 0), (3216, ">H", 0)))
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_allclose(read.delay, np.arange(SAMPLES) * INTERVAL, atol=1e-16)
    assert notes_with(read, f"the number of samples, {SAMPLES}, is that of the trace headers")
    assert notes_with(read, "the sample interval, 200, is that of the first trace header")
    wrong = read_gpr(patched(path, (3220, ">H", 100), (3216, ">H", 200)))
    np.testing.assert_array_equal(wrong.traces[:, 0], COUNTS)
    bare = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3220, ">H", 0))
    with pytest.raises(ValueError, match="it must tell the number of samples"):
        read_gpr(bare)
    with pytest.raises(ValueError, match="it must tell the sample interval"):
        read_gpr(patched(write_segy(tmp_path / "c.sgy", COUNTS), (3216, ">H", 0)))
