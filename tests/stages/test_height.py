"""Heights of alarms: echoes above, on and under the ground, and what is said of them."""

import numpy as np
import pandas as pd
import pytest

from flgpr.imaging import ScanImager
from flgpr.method.method import detect
from flgpr.model import SPEED_OF_LIGHT, Grid, lane_to_scan, make_run, vehicle_to_scan
from flgpr.recipe.schema import parse_recipe
from flgpr.stages import Setup
from flgpr.stages.height import Height, HeightSettings
from small_lane import LANE, RX, TX, course, small_recipe, small_run

FREQUENCY = 0.75e9 + 15e6 * np.arange(74)
BANDS = {"F1": (0.75e9, 1.86e9)}
GRID = Grid.spanning((-1.0, 1.0), (2.0, 6.5), 0.05)


def driven(points, depth=0.0, permittivity=4.0, scans=14):
    """Make a run over unit echoes at points (n, 3), so deep under the ground there."""
    rng = np.random.default_rng(7)
    pose = course(rng, 0.35 * np.arange(scans) - 1.0, 0.05)
    signal = np.zeros((scans, 1, 8, FREQUENCY.size), complex)
    for scan, one in enumerate(pose):
        local = lane_to_scan(points, one)
        path = 0.0
        for ends in (TX, RX):
            away = local - vehicle_to_scan(ends, one)[:, None]
            air = np.linalg.norm(away, axis=-1)
            sine = np.linalg.norm(away[..., :2], axis=-1) / air
            path = path + air + depth * np.sqrt(permittivity - sine**2)
        phase = np.exp(-2j * np.pi * FREQUENCY * path[..., None] / SPEED_OF_LIGHT)
        signal[scan, 0] = phase.sum(axis=1)
    noise = 0.05 * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))
    return make_run(signal + noise, FREQUENCY, ["HH"], TX, RX, pose)


def stage(run, **settings):
    imager = ScanImager(run, GRID, BANDS, window="hann")
    setup = Setup(run, {}, LANE, imager, GRID, None, [0], 1, {})
    return Height(HeightSettings(**settings), setup)


def gathered(one, alarms, scans=None):
    """Return the sums of a stage over scans, by default all."""
    sums = one.sums(pd.DataFrame(alarms, columns=["x", "y"]))
    imager = one.setup.imager
    for number in imager.scans if scans is None else scans:
        image = imager.image(number)
        image.attrs["pose"] = one.setup.run["pose"].values[number].tolist()
        sums.add(image)
    return sums


@pytest.mark.parametrize("height", [0.0, 0.25, 0.6, 1.0])
def test_the_height_of_an_echo_is_told_wherever_it_shows_on_the_ground(height):
    # Half-way along, what stands above the ground shows nearer by height / 2.
    one = stage(driven(np.array([[0.1, 5.0, height]])))
    table = gathered(one, [(0.1, 5.0 - height / 2), (0.2, 5.1 - height / 2)]).table()
    assert list(table) == ["height", "height_low", "height_high"]
    np.testing.assert_allclose(table["height"], height, atol=0.07)  # a step of the trials
    assert ((table["height_low"] < height) & (height < table["height_high"])).all()
    assert (table["height_high"] - table["height_low"] < 0.3).all()


def test_what_is_buried_looks_as_if_it_stood_below_the_ground():
    """Its echo comes later by ``d sqrt(ε - sin² θ)``; place and height that explain it follow."""
    points = np.array([[0.0, 5.0, 0.0]])
    deep = gathered(stage(driven(points, depth=0.3), span=(-0.6, 1.0)), [(0.0, 5.55)]).table()
    ahead = np.array([3.0, 5.8])
    slant = np.hypot(ahead, 2.0)
    later = 0.3 * np.sqrt(4.0 - (ahead / slant) ** 2)
    _, height = np.linalg.solve(np.column_stack([ahead, np.full(2, -2.0)]) / slant[:, None], later)
    assert deep["height"][0] == pytest.approx(height, abs=0.1)
    assert deep["height_high"][0] < 0


def test_the_level_of_the_ground_widens_the_interval():
    run = driven(np.array([[0.0, 5.0, 0.0]]))
    table = gathered(stage(run, level=0.2, span=(-0.8, 1.5)), [(0.0, 5.0)]).table()
    width = table["height_high"][0] - table["height_low"][0]
    assert width == pytest.approx(2 * 1.645 * 0.2, rel=0.1)


def test_sums_of_parts_are_those_of_all_scans():
    one = stage(driven(np.array([[0.0, 5.0, 0.3]])))
    alarms = [(0.0, 4.9), (0.3, 5.0)]
    whole = gathered(one, alarms)
    first, second = gathered(one, alarms, range(7)), gathered(one, alarms, range(7, 14))
    first.merge(second.state())
    for name, sums in whole.state().items():
        np.testing.assert_allclose(first.state()[name], sums, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(first.table(), whole.table(), atol=1e-3)


def test_an_alarm_that_few_scans_see_whole_has_no_height():
    one = stage(driven(np.array([[0.0, 5.0, 0.0]]), scans=6))
    table = gathered(one, [(0.0, 4.5), (0.0, 9.0), (0.99, 4.5)], range(4)).table()
    assert table.isna().all(axis=None)
    assert one.of_alarms(table) == [
        "heights of alarms are not told: no alarm is seen by five scans"
    ]


def test_what_stands_above_the_ground_is_counted():
    one = stage(driven(np.array([[0.0, 5.0, 0.0]])), ground=0.2)
    low, high = [0.3, -0.1, 0.1, np.nan], [0.5, 0.2, 0.3, np.nan]
    alarms = pd.DataFrame({"height": low, "height_low": low, "height_high": high})
    assert one.of_alarms(alarms) == [
        "alarms that stand more than 0.2 m above the ground: 1 of 4; at it or under it: 1; not told: 2"
    ]


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match=r"span must hold the heights from 0 to ground, 0.15, got"):
        HeightSettings(span=(0.1, 1.0))
    with pytest.raises(ValueError, match=r"span must hold .*, got \(-0.5, 0.1\)"):
        HeightSettings(span=(-0.5, 0.1))
    for wrong in (
        {"span": (-np.inf, 1.0)},
        {"span": (0.0, np.nan)},
        {"level": 0.0},
        {"reach": 1e9},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            HeightSettings(**wrong)
    run = driven(np.array([[0.0, 5.0, 0.0]]), scans=2)
    with pytest.raises(
        ValueError, match=r"at most 4000 trial places at the wavelengths of F1, got"
    ):
        stage(run, reach=40.0)
    with pytest.raises(ValueError, match=r"height\.subband must be one of F1, got 'F9'"):
        stage(run, subband="F9")


def test_alarms_of_a_recipe_show_their_height_and_a_result_says_what_stands():
    text = small_recipe() + '\n[[columns]]\nstage = "height"\n'
    found = detect(small_run(scans=40, step=0.2), parse_recipe(text), LANE)
    columns = found.alarms[list(Height.columns)].dropna()
    assert len(columns) > 3
    assert (columns["height_low"] <= columns["height"]).all()
    assert (columns["height"] <= columns["height_high"]).all()
    assert (columns["height"].abs() < 0.2).mean() > 0.7  # all that lies there lies on the ground
