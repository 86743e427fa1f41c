"""All channels of a recording as one run, and a recording that is only looked at."""

import numpy as np
import pytest

from flgpr.formats import channels_run, gpr_run, preview_run, read_gpr
from io_gpr import INTERVAL, SAMPLES, ZERO, section, write_dt1, write_dzt, write_mala

BOTH = np.stack([section(20), -3 * section(20)], axis=1)


@pytest.fixture
def line(tmp_path):
    return read_gpr(write_dzt(tmp_path / "a.DZT", BOTH, names=("50400", "3101")))


def test_every_channel_is_a_pair_as_it_would_be_alone(line):
    run = channels_run(line, [-0.4, 0.4], separation=0.2)
    assert run["signal"].sizes["pair"] == 2
    band = (100e6, 1800e6)  # a quarter of the lowest antenna's to twice the highest's
    assert run["frequency"].values[[0, -1]] == pytest.approx(band, abs=1 / (SAMPLES * INTERVAL))
    for channel in range(2):
        alone = gpr_run(line, channel, band=band, separation=0.2)
        np.testing.assert_array_equal(
            run["signal"].values[:, :, channel], alone["signal"].values[:, :, 0]
        )
    np.testing.assert_allclose(run["tx_position"].values, [[-0.4, -0.1, 0], [0.4, -0.1, 0]])
    np.testing.assert_allclose(run["rx_position"].values, [[-0.4, 0.1, 0], [0.4, 0.1, 0]])
    np.testing.assert_array_equal(run["pose"].values, alone["pose"].values)


def test_notes_tell_the_channels_and_the_places_that_are_assumed(line):
    notes = channels_run(line).attrs["import_notes"]
    assert "all 2 channels in one run, a pair each; antennas 400 MHz, 900 MHz" in notes
    assert "2 channels put at one place: the file does not tell where their antennas are" in notes
    assert len(notes) == len(set(notes))
    placed = channels_run(line, [0.0, 0.3]).attrs["import_notes"]
    assert not any(
        "put at one place: the file does not tell where their" in note for note in placed
    )


def test_a_common_band_that_the_sampling_cuts_is_told_so(tmp_path):
    """2600 MHz in samples 0.2 ns apart, which hold up to 2500 MHz."""
    path = write_dzt(tmp_path / "a.DZT", BOTH, names=("3101", "52600"))
    notes = channels_run(read_gpr(path)).attrs["import_notes"]
    words = "antennas', within what record and sampling hold)"
    assert [note for note in notes if note.startswith("impulse data") and note.endswith(words)]
    whole = write_dzt(tmp_path / "b.DZT", BOTH, names=("50400", "3101"))
    notes = channels_run(read_gpr(whole)).attrs["import_notes"]
    assert [note for note in notes if note.endswith("a quarter to twice the antennas')")]


def test_places_must_be_one_per_channel(line):
    with pytest.raises(
        ValueError, match=r"channel_x must give a finite x, m, for each of 2 channels, got \[0.0\]"
    ):
        channels_run(line, [0.0])


def test_a_recording_is_looked_at_with_all_channels_and_frequencies(line):
    run = preview_run(line.path)
    assert run["signal"].sizes["pair"] == 2
    assert run["frequency"].values[-1] == pytest.approx(0.45 / INTERVAL, rel=0.02)
    assert run.attrs["first_sample_s"] == pytest.approx(-ZERO * INTERVAL)


def test_traces_without_a_known_spacing_are_looked_at_a_metre_apart_and_it_is_told(tmp_path):
    run = preview_run(write_mala(tmp_path / "a.rd3", section(12), DISTANCE_FLAG=0))
    np.testing.assert_allclose(run["pose"].values[:, 1], np.arange(12))
    assert "no trace spacing is known: traces are put 1 m apart" in run.attrs["import_notes"]
    told = preview_run(write_dt1(tmp_path / "a.dt1", section(12))).attrs["import_notes"]
    assert not any("1 m apart" in note for note in told)
