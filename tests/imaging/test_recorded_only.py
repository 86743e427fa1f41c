"""Images end where the record and the ground end: nothing folds back, nothing is seen in the air."""

import numpy as np
import pytest

from flgpr.clutter import shift_time
from flgpr.formats.impulse import impulse_to_frequency
from flgpr.imaging.aperture import Record, record_of, without_folds
from flgpr.imaging.focus import focus
from flgpr.imaging.view_axes import View
from flgpr.model import make_run

SPEED = 0.299792458 / 3  # m/ns, of permittivity 9
PLACE, DEPTH, APART = 1.0, 0.5, 0.2  # m
SAMPLES, STEP, ZERO = 160, 0.2, 20  # -, ns, sample


def line(count, slope=0.0, pad=1, first=ZERO, spacing=0.05):
    """A run of a line down a slope over one point below its surface, and a direct wave."""
    time = (np.arange(SAMPLES) - first) * STEP
    along = spacing * np.arange(count)
    way = np.stack([0 * along, along * np.cos(slope), -along * np.sin(slope)], axis=1)
    point = np.array([0, PLACE * np.cos(slope), -PLACE * np.sin(slope) - DEPTH])
    half = np.array([0, APART / 2, 0])
    path = np.linalg.norm(way + half - point, axis=1) + np.linalg.norm(way - half - point, axis=1)
    late = time - np.append(path[:, None] / SPEED, np.full((count, 1), 1.0), axis=1)[..., None]
    square = (np.pi * 0.4 * late) ** 2
    traces = ((1 - 2 * square) * np.exp(-square) * [[1.0], [3.0]]).sum(axis=1)
    tones_of = impulse_to_frequency(traces, time * 1e-9, (0.1e9, 0.8e9), pad)
    pose = np.zeros((count, 6))
    pose[:, :3] = way
    attrs = {
        "sounding": "ground-coupled",
        "time_window_s": SAMPLES * STEP * 1e-9,
        "first_sample_s": time[0] * 1e-9,
    }
    signal, tones = tones_of
    return make_run(
        signal[:, None, None], tones, ["HH"], [-half], [half], pose, None, attrs
    ), point  # fmt: skip


def levels(image, point):
    """Level far from the point and below the direct wave's place, dB re the brightest pixel."""
    level = np.abs(image.values[0, :, :, 0])
    y, z = image["y"].values, image["z"].values
    far = np.hypot(y[None] - point[1], z[:, None] - point[2]) > 0.6
    deep = z[:, None] < -0.3
    return 20 * np.log10(level[far & deep].max() / level[~far & deep].max())


VIEW = View(x=0.0, y=(0.0, 6.0), z=(-1.3, 0.0), spacing=0.05, permittivity=9.0)


@pytest.mark.parametrize("pad", [1, 2])
def test_what_is_beyond_the_record_is_not_read_from_its_begin(pad):
    run, point = line(121, pad=pad)
    assert levels(focus(run, VIEW).image, point) < -27
    folded = run.copy()
    del folded.attrs["time_window_s"]
    assert levels(focus(folded, VIEW).image, point) > -21


def test_time_zero_moves_the_record():
    run, _ = line(121)
    later = shift_time(run, -6e-9)
    assert later.attrs["first_sample_s"] == pytest.approx(run.attrs["first_sample_s"] + 6e-9)
    back = focus(shift_time(later, 6e-9), VIEW).image.values
    expected = focus(run, VIEW).image.values
    np.testing.assert_allclose(back, expected, atol=2e-3 * np.abs(expected).max())


def test_denser_tones_are_those_of_the_record_and_zeros_behind_it():
    time = np.arange(64) * 1e-9 - 5e-9
    traces = np.random.default_rng(0).normal(size=(3, 64))
    signal, tones = impulse_to_frequency(traces, time, (0.05e9, 0.4e9))
    record = Record(time[0], time[0] + 64e-9, 64e-9)
    dense, denser = without_folds(signal, tones, record, 150e-9)
    np.testing.assert_allclose(denser[::3], tones)
    np.testing.assert_allclose(3 * dense[:, ::3], signal, rtol=1e-9)
    same, _ = without_folds(signal, tones, record, 50e-9)
    assert same is signal
    # behind the record and before the phases repeat there is nothing
    late = np.linspace(75e-9, 170e-9, 50)
    window = np.hanning(denser.size)
    behind = np.abs((dense * window) @ np.exp(2j * np.pi * np.outer(denser, late)))
    within = np.abs((dense * window) @ np.exp(2j * np.pi * np.outer(denser, time)))
    assert behind.max() < 0.1 * within.max()


def test_tones_that_no_record_stands_for_repeat_and_are_told():
    run, _ = line(121)
    for name in ("time_window_s", "first_sample_s"):
        del run.attrs[name]
    assert record_of(run).end == np.inf
    (note,) = [one for one in focus(run, VIEW).notes if "repeat" in one]
    assert "tones 31.25 MHz apart repeat after 1.599 m" in note
    near = View(**(VIEW.__dict__ | {"reach": 1.0}))
    assert not [one for one in focus(run, near).notes if "repeat" in one]


@pytest.mark.parametrize("slope", [20, -20])
def test_above_a_slope_nothing_is_imaged(slope):
    run, point = line(61, np.radians(slope), spacing=0.05)
    drawn = focus(run, View(permittivity=9.0))
    level = np.abs(drawn.image.values[0, :, :, 0])
    row, column = np.unravel_index(level.argmax(), level.shape)
    y, z = drawn.image["y"].values, drawn.image["z"].values
    ground = -y * np.tan(np.radians(slope))
    assert not level[z[:, None] > ground[None] + drawn.spacing].any()
    is_below = z[:, None] < ground[None] - 0.2
    row, column = np.unravel_index((level * is_below).argmax(), level.shape)
    assert np.hypot(y[column] - point[1], z[row] - point[2]) < 0.1
    assert any("lie above the antennas" in note for note in drawn.notes)


def test_on_level_ground_all_is_imaged():
    run, _ = line(41)
    drawn = focus(run, View(permittivity=9.0))
    assert np.abs(drawn.image.values[0]).min() > 0
    assert not drawn.notes
