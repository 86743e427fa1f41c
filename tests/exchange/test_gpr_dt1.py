"""Sensors & Software's DT1: gathers, types of samples, and words of the trace headers."""

import re

import numpy as np
import pytest

from flgpr.formats import explain_file, gpr_run, read_gpr
from io_gpr import (
    SEPARATION,
    write_dt1,
)
from io_recordings import (
    ALONG,
    COUNTS,
    TRACES,
    notes_with,
    set_dt1_words,
)


@pytest.mark.parametrize(
    "mode",
    [
        "CMP/WARR",
        "WARR",
        "Multi-offset",
        "Transillumination",
        "Common Mid-Point",
        "common midpoint",
        "Wide Angle Reflection and Refraction",
        "C.M.P.",
    ],
)
def test_a_gather_is_no_line(mode, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE=mode)
    with pytest.raises(ValueError, match=f"its antennas move apart .{re.escape(mode)}"):
        gpr_run(read_gpr(path))
    assert (
        f"its antennas move apart ({mode}): it is no line of one offset" in explain_file(path).lines
    )
    assert explain_file(path).lines[-1].startswith("flgpr import gpr refuses it")


def test_places_of_the_antennas_tell_a_gather_too(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE="Reflection")
    set_dt1_words(path, "receiver", [0.5 + 0.1 * k for k in range(TRACES)])
    assert read_gpr(path).gather == "antennas 0.5 to 3.4 apart"
    set_dt1_words(path, "receiver", [3.4 - 0.1 * k for k in range(TRACES)])
    assert read_gpr(path).gather == "antennas 0.5 to 3.4 apart"
    set_dt1_words(path, "receiver", [0.5 + k % 3 for k in range(TRACES)])
    assert not read_gpr(path).gather
    assert notes_with(
        read_gpr(path), "the trace headers put the antennas 0.5 to 2.5 apart, which is not used"
    )
    for line in ("Reflection", "Common-Offset", "common offset", "PROFILE"):
        read = read_gpr(write_dt1(tmp_path / "b.dt1", COUNTS, SURVEY_MODE=line))
        assert not read.gather
        assert not notes_with(read, "SURVEY MODE")
    assert notes_with(
        read_gpr(write_dt1(tmp_path / "c.dt1", COUNTS, SURVEY_MODE="walking")), "is not known"
    )


def test_the_size_of_the_samples_tells_their_type(tmp_path):
    real = write_dt1(tmp_path / "a.dt1", COUNTS + 0.25, real=True, DATA_TYPE="")
    np.testing.assert_array_equal(read_gpr(real).traces[:, 0], COUNTS + np.float32(0.25))
    assert notes_with(
        read_gpr(real), "read as 32 bit floating point, by their size (no DATA TYPE is told)"
    )
    wrong = write_dt1(tmp_path / "b.dt1", COUNTS, DATA_TYPE="F*4")
    np.testing.assert_array_equal(read_gpr(wrong).traces[:, 0], COUNTS)
    assert notes_with(read_gpr(wrong), "read as 16 bit, by their size (DATA TYPE is F*4)")
    big = write_dt1(tmp_path / "c.dt1", COUNTS, real=True, order=">", DATA_TYPE="")
    np.testing.assert_array_equal(read_gpr(big).traces[:, 0], COUNTS)


def test_what_a_trace_header_says_counts(tmp_path):
    feet = {"POSITION_UNITS": "feet", "TIMEZERO_AT_POINT": 11}
    read = read_gpr(write_dt1(tmp_path / "a.dt1", COUNTS, dead=3, comment=7, **feet))
    assert np.isnan(read.traces[3]).all()
    assert np.isfinite(np.delete(read.traces, 3, axis=0)).all()
    assert read.marks == (7,)
    assert read.separation == pytest.approx(0.3048 * SEPARATION)
    np.testing.assert_allclose(read.distance, 0.3048 * ALONG, atol=1e-5)
    np.testing.assert_allclose(read.time, 36000 + np.arange(len(COUNTS)))
    assert read.delay[10] == 0
    run = gpr_run(read)
    np.testing.assert_array_equal(run["valid"].values.ravel(), np.arange(len(COUNTS)) != 3)
