"""The map of contrasts: a channel's contrast, the weights, and what of a lane's examples they are learnt from."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sklearn.linear_model import LogisticRegression

from flgpr.chain.stages.levels import LevelMap, LevelSettings, contrasts, logistic_weights
from flgpr.model import Grid, Lane

GRID = Grid.spanning((-3.0, 3.0), (5.0, 15.0), 0.1)
SETTINGS = LevelSettings()


def image_of(values):
    shape = (2, 2, GRID.ny, GRID.nx)
    return xr.DataArray(
        np.broadcast_to(values, shape).astype(np.complex64),
        dims=("polarization", "subband", "y", "x"),
        coords={"polarization": ["HH", "VV"], "subband": ["B0", "B1"], "y": GRID.y, "x": GRID.x},
        attrs={"pose": [0.0, 0.0, 5.0, 0.0, 0.0, 0.0], "scan": 0},
    )


def speckle(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(2, 2, GRID.ny, GRID.nx)) + 1j * rng.normal(size=(2, 2, GRID.ny, GRID.nx))


def test_the_contrast_is_the_power_about_a_pixel_over_that_of_the_ring():
    values = speckle(1)
    found = contrasts(image_of(values), SETTINGS)
    row, column = 50, 30
    power = np.abs(values[1, 0]) ** 2

    def total(half):
        square = power[row - half : row + half + 1, column - half : column + half + 1]
        return square.sum(), square.size

    (inner, few), (guard, some), (outer, all_of) = total(1), total(6), total(15)
    want = 10 * np.log10((inner / few) / ((outer - guard) / (all_of - some)))
    assert found[1, 0, row, column] == pytest.approx(want, abs=1e-4)


def test_the_contrast_does_not_depend_on_the_level():
    values = speckle(2)
    louder = values * np.array([3.0, 0.1])[:, None, None, None]
    np.testing.assert_allclose(contrasts(image_of(values), SETTINGS), contrasts(image_of(louder), SETTINGS), atol=1e-4)
    assert np.isfinite(contrasts(image_of(0.0), SETTINGS)).all()  # a channel that failed


def test_weights_are_those_of_a_balanced_logistic_regression_and_none_is_below_zero():
    rng = np.random.default_rng(3)
    mines, clutter = rng.normal(1.0, 2.0, (80, 3)), rng.normal(0.0, 2.0, (900, 3))
    penalty, count = 0.06, 980
    theirs = LogisticRegression(C=1 / (penalty * count), class_weight="balanced", tol=1e-8, max_iter=1000)
    theirs.fit(np.concatenate([mines, clutter]), np.arange(count) < 80)
    np.testing.assert_allclose(logistic_weights(mines, clutter, penalty), theirs.coef_[0], atol=2e-4)
    mines[:, 1] -= 3  # what is dark over mines says nothing here
    weights = logistic_weights(mines, clutter, penalty)
    assert weights[1] == 0
    assert (weights[[0, 2]] > 0).all()


def stage(learnt=None, lane=Lane(-1.5, 1.5, 5.0, 15.0)):  # noqa: B008
    setup = SimpleNamespace(view=Grid.spanning((-2.0, 2.0), (5.0, 15.0), 0.1), images=GRID, lane=lane)
    return LevelMap(SETTINGS, setup, learnt)


def examples(seed, mines, channel):
    """What a lane of several looks gives, with mines that are bright in one polarization and sub-band."""
    looks = []
    for number in range(4):
        values = speckle(100 * seed + number)
        for x, y in mines:
            spot = 6 * np.exp(-((GRID.x - x) ** 2 + (GRID.y[:, None] - y) ** 2) / 0.02)
            values[channel] += spot * np.exp(1j * number)
        looks.append(image_of(values))
    truth = pd.DataFrame({"x": [x for x, _ in mines], "y": [y for _, y in mines], "kind": "metal"})
    gathered = stage().examples(truth, looks.__getitem__)
    for number in range(4):
        gathered.add(number)
    return gathered.result()


def test_it_learns_which_channel_tells_mines():
    rng = np.random.default_rng(5)
    lanes = [examples(seed, [(rng.uniform(-1, 1), y) for y in (6.5, 9.0, 11.5, 13.5)], (1, 0)) for seed in range(3)]
    learnt, notes = LevelMap.fit(SETTINGS, lanes)
    assert notes["mines"] == 12
    assert notes["clutter"] > 50
    assert learnt["weight"].sum() == pytest.approx(1)
    assert learnt["weight"].argmax() == 2  # VV, B0
    assert learnt["weight"][2] > 0.6
    values = speckle(999)
    values[1, 0] += 6 * np.exp(-((GRID.x - 0.5) ** 2 + (GRID.y[:, None] - 10.0) ** 2) / 0.02)
    found = stage(learnt).map(image_of(values))
    row, column = np.unravel_index(found.argmax(), found.shape)
    assert abs(GRID.x[column] - 0.5) < 0.2
    assert abs(GRID.y[row] - 10.0) < 0.2
    assert found.min() > 0


def test_mines_of_other_kinds_are_no_examples_and_no_clutter():
    lanes = [examples(seed, [(0.0, 8.0), (0.5, 12.0)], (0, 0)) for seed in range(2)]
    for lane in lanes:
        lane["wanted"][:] = False
    with pytest.raises(ValueError, match="levels need mines and clutter, got 0 and"):
        LevelMap.fit(SETTINGS, lanes)


def test_mines_that_stand_out_nowhere_are_told():
    lane = examples(1, [(0.0, 8.0), (0.5, 12.0)], (0, 0))
    lane["view"] = -lane["view"]
    far = {**lane, "places": np.array([[0.0, 8.0], [0.5, 12.0]])}
    far["view"] = np.where(np.isfinite(far["view"]), 0.0, np.nan)
    far["view"][:, ::9, ::9] = 5.0
    with pytest.raises(ValueError, match="stand out of clutter in some channel"):
        LevelMap.fit(LevelSettings(rounds=1, reach=0.01), [far])


def test_rings_that_do_not_nest_are_refused():
    with pytest.raises(ValueError, match="inner, guard and outer must rise"):
        LevelSettings(guard=2.0)
