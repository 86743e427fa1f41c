"""Sections below a line of antennas, migrated with any permittivity."""

import numpy as np
import pytest

from flgpr.imaging.section import LineSection
from flgpr.model import SPEED_OF_LIGHT, make_run
from flgpr.model.phase import path_phase

TONES = 0.5e9 + 50e6 * np.arange(40)
PERMITTIVITY = 6.0
DEPTH = 0.4
PLACE = 1.0


@pytest.fixture(scope="module")
def run():
    """Antennas on the ground along +y over one buried point."""
    pose = np.zeros((41, 6))
    pose[:, 1] = 0.05 * np.arange(41)
    way = 2 * np.sqrt(PERMITTIVITY) * np.hypot(pose[:, 1] - PLACE, DEPTH)
    signal = np.array([path_phase(TONES, np.array([path])) for path in way])[:, None]
    antenna = np.zeros((1, 3))
    attributes = {"sounding": "ground-coupled"}
    return make_run(signal, TONES, ["HH"], antenna, antenna, pose, attrs=attributes)


def peak(section, permittivity):
    image = np.abs(section.image(permittivity)[0])
    return image.max(), np.unravel_index(image.argmax(), image.shape)


def test_a_buried_point_is_sharp_at_its_place_and_delay_with_the_right_permittivity(run):
    delays = (1e-9, 15e-9)
    section = LineSection(run, None, delays)
    level, (row, column) = peak(section, PERMITTIVITY)
    rows, columns = section.image(PERMITTIVITY).shape[1:]
    along = np.linspace(0.0, 2.0, columns)[column]
    delay = np.linspace(delays[0], delays[1], rows)[row]
    assert along == pytest.approx(PLACE, abs=0.04)
    assert delay == pytest.approx(2 * np.sqrt(PERMITTIVITY) * DEPTH / SPEED_OF_LIGHT, abs=0.2e-9)
    for wrong in (3.0, 10.0):
        assert peak(section, wrong)[0] < 0.9 * level


def test_a_stretch_of_the_line_is_what_is_imaged(run):
    whole = LineSection(run, None, (1e-9, 5e-9)).image(PERMITTIVITY)
    half = LineSection(run, (0.0, 1.0), (1e-9, 5e-9)).image(PERMITTIVITY)
    assert half.shape[1] == whole.shape[1]
    assert half.shape[2] == pytest.approx(whole.shape[2] / 2, abs=1)


@pytest.mark.parametrize(
    ("along", "delays"), [((1.0, 0.5), (0.0, 1e-8)), (None, (2e-8, 1e-8)), (None, (-1e-9, 1e-8))]
)
def test_limits_that_do_not_increase_are_refused(run, along, delays):
    with pytest.raises(ValueError, match="along and delays must have limits that increase"):
        LineSection(run, along, delays)


@pytest.mark.parametrize(
    ("along", "delays", "words"),
    [
        ((50.0, 60.0), (1e-9, 5e-9), "along must hold a part of the line"),
        (None, (1.0, 2.0), "delays must begin within the record"),
    ],
)
def test_a_section_of_what_was_not_recorded_is_refused(run, along, delays, words):
    with pytest.raises(ValueError, match=words):
        LineSection(run, along, delays)


def test_where_a_section_is_focused_is_told_and_whether_it_is_an_edge_of_the_delays(run):
    place, delay, is_edge = LineSection(run, None, (1e-9, 15e-9)).focus(PERMITTIVITY)
    assert place == pytest.approx(PLACE, abs=0.04)
    assert delay == pytest.approx(2 * np.sqrt(PERMITTIVITY) * DEPTH / SPEED_OF_LIGHT, abs=0.2e-9)
    assert not is_edge
    assert LineSection(run, None, (9e-9, 15e-9)).focus(PERMITTIVITY)[2]


@pytest.mark.parametrize("z", [0.9, -0.9])
def test_antennas_off_the_ground_are_refused(run, z):
    lifted = run.assign(pose=run["pose"] + np.array([0, 0, z, 0, 0, 0]))
    rule = rf"antennas must be on level ground, z = 0 to 0\.1 m, half a wavelength, got z = {z} m"
    with pytest.raises(ValueError, match=rule):
        LineSection(lifted, None, (1e-9, 15e-9))
