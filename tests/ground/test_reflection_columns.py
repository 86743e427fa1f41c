"""Columns of reflections in time and frequency: of the widest sub-band, of profiles inside the image alone."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flgpr.features import range_wavenumbers, reflection_features, spectrograms
from flgpr.method.method import detect
from flgpr.model import Grid
from flgpr.recipe.schema import parse_recipe
from flgpr_ground.stages.time_frequency import TimeFrequency, TimeFrequencySettings
from small_lane import LANE, small_recipe, small_run

GRID = Grid.spanning((-1.0, 1.0), (8.0, 12.0), 0.05)
ANTENNA = np.array([[0.0, 0.0, 0.0]])
SUBBANDS = {"narrow": (1.0e9, 1.5e9), "wide": (0.8e9, 2.8e9)}


def stage(grid=GRID, imaged=(0, 1), **settings):
    run = xr.Dataset(
        {"tx_position": (("pair", "axis"), ANTENNA), "rx_position": (("pair", "axis"), ANTENNA)},
        coords={"polarization": ["HH", "VV"]},
    )
    setup = SimpleNamespace(
        imager=SimpleNamespace(run=run, subbands=SUBBANDS), imaged=imaged, images=grid, run=run
    )
    return TimeFrequency(TimeFrequencySettings(**settings), setup)


def image(seed=1):
    rng = np.random.default_rng(seed)
    shape = 2, 2, GRID.ny, GRID.nx
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    coords = {
        "polarization": ["HH", "VV"],
        "subband": list(SUBBANDS),
        "y": GRID.y,
        "x": GRID.x,
    }
    made = xr.DataArray(values, coords, tuple(coords))
    made.attrs["pose"] = [0.0, 0.0, 5.0, 0.0, 0.0, 0.0]
    return made


def test_columns_are_the_features_of_the_brightest_profile_about_an_alarm():
    one = image()
    middle = np.abs(GRID.y - 10.0).argmin()
    side = np.abs(GRID.x - 0.1).argmin()
    one.values[1, 1, middle, side] = 60.0  # VV in the wide sub-band, 0.1 m beside the alarm
    found = stage().of_image(one, np.array([[0.0, 10.0]]))
    half = round(0.72 / 0.05)
    profile = one.values[1, 1, middle - half : middle + half + 1, side].astype(complex)
    frequency = np.linspace(0.8e9, 2.8e9, 16)
    lifted = ANTENNA + [0.0, 0.0, 5.0]
    turned = range_wavenumbers(np.array([[0.0, 10.0]]), lifted, lifted, frequency)
    offsets = 0.05 * np.arange(-half, half + 1)
    energy = spectrograms(profile[None], offsets, turned, 0.06)
    wanted = reflection_features(energy, offsets, frequency, 0.25, (0.1, 0.35))
    for name in ("level", "second", "distance", "entropy"):
        assert found[f"tf_{name}_VV"][0] == pytest.approx(getattr(wanted, name)[0]), name
    assert found["tf_shift_VV"][0] == pytest.approx(wanted.shift[0] / 1e9)
    assert found["tf_bandwidth_VV"][0] == pytest.approx(wanted.bandwidth[0] / 1e9)
    assert found["tf_level_VV"][0] > found["tf_level_HH"][0] + 10


def test_a_profile_that_leaves_the_image_or_holds_a_gap_says_nothing():
    one = image()
    one.values[0, 1, np.abs(GRID.y - 9.0).argmin(), np.abs(GRID.x - 0.5).argmin()] = np.nan
    points = np.array([[0.0, 10.0], [0.0, 8.4], [0.95, 10.0], [0.0, 30.0], [0.5, 9.0]])
    found = stage(across=0.0).of_image(one, points)
    assert set(found) == set(stage().columns)
    np.testing.assert_array_equal(
        np.isfinite(found["tf_second_HH"]), [True, False, True, False, False]
    )
    np.testing.assert_array_equal(
        np.isfinite(found["tf_second_VV"]), [True, False, True, False, True]
    )
    np.testing.assert_array_equal(
        np.isfinite(stage().of_image(one, points)["tf_level_VV"]), [True, False, False, False, True]
    )


def test_alarms_do_not_depend_on_which_are_asked_for_together():
    points = np.random.default_rng(3).uniform([-0.7, 8.9], [0.7, 11.1], (20, 2))
    together = stage().of_image(image(), points)
    for number in (0, 7, 19):
        alone = stage().of_image(image(), points[number : number + 1])
        for name, values in together.items():
            assert alone[name][0] == pytest.approx(values[number], rel=1e-12), name


def test_entries_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"polarizations must be among VV, got 'HH'"):
        stage(imaged=[1])
    with pytest.raises(ValueError, match=r"subband must be one of narrow, wide, got 'F9'"):
        stage(subband="F9")
    with pytest.raises(ValueError, match=r"gate must increase, got 0.3, 0.1"):
        stage(gate=(0.3, 0.1))
    coarse = Grid.spanning((-1.0, 1.0), (8.0, 12.0), 0.1)
    with pytest.raises(ValueError, match=r"image.spacing must be below 0.0749 m .* wide, got 0.1"):
        stage(coarse)
    assert stage(coarse, subband="narrow").columns[0] == "tf_level_HH"


def test_its_columns_join_those_of_a_recipe():
    recipe = parse_recipe(small_recipe() + '\n[[columns]]\nstage = "time-frequency"\n')
    found = detect(small_run(), recipe, LANE)
    table = found.features
    assert np.isfinite(table["tf_entropy_VV"]).any()
    assert (table["tf_distance_HH"].dropna() >= 0.1 - 1e-9).all()
