"""MALÅ's RD3 and RD7 and ImpulseRadar's IPRB: sampling, steps, clocks and sample types."""

import numpy as np
import pytest

from flgpr_exchange.gpr.mala import read_impulse, read_mala
from io_gpr import INTERVAL, SAMPLES, STEP, ZERO, write_impulse, write_mala
from io_recordings import ALONG, COUNTS, TRACES

LIMIT = 10**9


def has_note(read, words):
    return any(words in note for note in read["history"])


def test_the_header_has_the_rate_in_megahertz(tmp_path):
    read = read_mala(write_mala(tmp_path / "a.rd3", COUNTS), LIMIT)
    np.testing.assert_allclose(read["delay"], INTERVAL * np.arange(SAMPLES), rtol=1e-12)
    np.testing.assert_array_equal(read["traces"][:, 0], COUNTS)
    np.testing.assert_allclose(read["distance"], ALONG)
    assert read["title"] == "meadow"
    assert read["time"] is None
    with pytest.raises(ValueError, match="SAMPLES must be a number from 2 to"):
        read_mala(write_mala(tmp_path / "b.rd3", COUNTS, SAMPLES=1), LIMIT)


def test_an_rd7_has_samples_of_32_bits(tmp_path):
    wide = COUNTS.astype(np.int64) * 2**15
    read = read_mala(write_mala(tmp_path / "a.rd7", wide), LIMIT)
    np.testing.assert_array_equal(read["traces"][:, 0], wide)


def test_without_a_wheel_there_is_no_step(tmp_path):
    read = read_mala(write_mala(tmp_path / "a.rd3", COUNTS, DISTANCE_FLAG=0, TIME_FLAG=1), LIMIT)
    assert read["distance"] is None
    assert has_note(read, "DISTANCE FLAG is 0: no wheel was used, and DISTANCE INTERVAL (0.05 m)")
    np.testing.assert_allclose(read["time"], 0.1 * np.arange(TRACES))
    timed = write_impulse(tmp_path / "a.iprb", COUNTS, TRIG_SOURCE="time")
    assert read_impulse(timed, LIMIT)["distance"] is None


def test_the_users_step_goes_before_that_of_the_wheel(tmp_path):
    path = write_impulse(tmp_path / "a.iprb", COUNTS, USER_DISTANCE_INTERVAL=2 * STEP)
    read = read_impulse(path, LIMIT)
    np.testing.assert_allclose(read["distance"], 2 * ALONG)
    assert has_note(read, "by USER DISTANCE INTERVAL in the header")


def test_impulse_radars_time_zero_and_bits(tmp_path):
    read = read_impulse(write_impulse(tmp_path / "a.iprb", COUNTS, bits=32), LIMIT)
    assert read["delay"][ZERO] == 0
    np.testing.assert_array_equal(read["traces"][:, 0], COUNTS)
    with pytest.raises(ValueError, match=r"b\.iprh: DATA VERSION must be 16 or 32, got 24"):
        read_impulse(write_impulse(tmp_path / "b.iprb", COUNTS, DATA_VERSION=24), LIMIT)
    unknown = read_impulse(write_impulse(tmp_path / "c.iprb", COUNTS, DATA_VERSION=""), LIMIT)
    assert has_note(unknown, "no DATA VERSION: samples are read as 16 bit")
