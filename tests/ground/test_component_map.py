"""A map by principal components: intervals of range have their own, and looks add up."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.clutter import ClutterWhitener
from flgpr.detect import PrincipalComponentDetector
from flgpr.detect.scorers.checks import Checked
from flgpr.stages.too_few import TooFewExamplesError
from flgpr_ground.stages.principal_components import (
    ComponentMap,
    ComponentSettings,
    interval_samples,
)

SETTINGS = ComponentSettings(
    length=6, clutter_step=(3, 3), search=0.0, edges=(3.0, 5.0, 7.0), moments="sample"
)
X = np.linspace(-2, 2, 41)
Y = np.linspace(2.5, 7.5, 51)
MINES = np.array([[0.0, 4.0], [0.5, 6.0], [0.0, 9.0]])


def band(seed=1):
    rng = np.random.default_rng(seed)
    shape = 2, Y.size, X.size
    values = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    values[:, Y > 5] *= 5  # clutter farther off is of another level
    coords = {"polarization": ["HH", "VV"], "y": Y, "x": X}
    return xr.DataArray(values.astype(np.complex64), coords, ("polarization", "y", "x"))


def examples(looks=(8, 8), seed=2):
    rng = np.random.default_rng(seed)
    samples = interval_samples(band(), MINES, SETTINGS)
    for number, count in enumerate(looks):
        shape = count, 12
        cuts = rng.normal(size=shape) + 1j * rng.normal(size=shape)
        samples[f"target-{number}"] = 3 * (number + 1) * cuts
    return samples


def test_a_look_belongs_to_the_interval_in_which_the_mine_lies():
    samples = interval_samples(band(), MINES, SETTINGS)
    assert [len(samples[f"target-{k}"]) for k in range(2)] == [1, 1]
    row = np.abs(Y - 4.0).argmin()
    column = np.abs(X).argmin()
    wanted = band().values[:, row - 3 : row + 3, column].ravel()
    np.testing.assert_array_equal(samples["target-0"][0], wanted)
    near, far = (np.abs(samples[f"clutter-{k}"]).mean() for k in range(2))
    assert far > 4 * near


def test_clutter_keeps_clear_of_all_mines_whatever_interval_they_lie_in():
    values = band().values.copy()
    beside_the_edge = np.array([[0.0, 4.95]])
    distance = np.hypot(X[:, None], (Y - 4.95)).T
    values[:, distance < 1.0] = 1e6
    samples = interval_samples(band().copy(data=values), beside_the_edge, SETTINGS)
    assert np.abs(samples["clutter-0"]).max() < 1e3
    assert np.abs(samples["clutter-1"]).max() < 1e3


def test_every_interval_scores_by_the_likelihood_ratio_that_it_learnt():
    lane = examples()
    learnt, notes = ComponentMap.fit(SETTINGS, [lane])
    assert notes["looks_at_mines"] == [8, 8]
    assert notes["clutter_samples"] == len(lane["clutter-0"]) + len(lane["clutter-1"])
    ComponentMap.check_learnt(SETTINGS, None, Checked({}, learnt))
    image = band(5).expand_dims(subband=["F1"], axis=1)
    found = ComponentMap(SETTINGS, SimpleNamespace(), learnt).map(image)

    on_clutter = []
    ratio = np.full(found.shape, np.nan)
    for number, rows in enumerate((Y < 5.0, Y >= 5.0)):
        whitener = ClutterWhitener("sample").fit(lane[f"clutter-{number}"])
        detector = PrincipalComponentDetector(3).fit(whitener.transform(lane[f"target-{number}"]))
        scored = detector.decision_function(whitener.transform(lane[f"clutter-{number}"]))
        on_clutter.append(scored)
        for row in np.flatnonzero(rows & (Y >= 3.0) & (Y < 7.0)):
            chips = np.stack(
                [band(5).values[:, row - 3 : row + 3, column].ravel() for column in range(X.size)]
            )
            ratio[row] = detector.decision_function(whitener.transform(chips))
    clutter = np.concatenate(on_clutter)
    wanted = (ratio - clutter.min()) / clutter.std()
    np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-3)
    assert np.isnan(found[(Y < 3.0) | (Y >= 7.0)]).all()


def test_what_the_scans_of_a_lane_show_is_gathered():
    poses = np.zeros((2, 6))
    poses[1, 1] = 2.0  # two metres on: the mine that was in the second interval is in the first
    setup = SimpleNamespace(pose=lambda index: poses[index])
    stage = ComponentMap(SETTINGS, setup)
    truth = pd.DataFrame({"x": [0.5], "y": [6.0], "kind": ["metal"]})
    images = [band(seed).expand_dims(subband=["F1"], axis=1) for seed in (1, 2)]
    gathered = stage.examples(truth, lambda index: images[index])
    gathered.add(0)
    gathered.add(1)
    result = gathered.result()
    row = np.abs(Y - 6.0).argmin()
    column = np.abs(X - 0.5).argmin()
    np.testing.assert_array_equal(
        result["target-1"], images[0].values[:, 0, row - 3 : row + 3, column].reshape(1, -1)
    )
    assert result["target-0"].shape == (1, 12)


def test_mines_of_no_training_lane_change_nothing():
    """The same lane learns the same, whatever was learnt from another one before."""
    ComponentMap.fit(SETTINGS, [examples(seed=3)])
    first, _ = ComponentMap.fit(SETTINGS, [examples()])
    second, _ = ComponentMap.fit(SETTINGS, [examples()])
    for name, array in first.items():
        np.testing.assert_array_equal(second[name], array)


def test_too_few_looks_and_samples_name_the_interval():
    with pytest.raises(
        TooFewExamplesError, match="2 looks at targets or more from 5 to 7 m, got 1"
    ):
        ComponentMap.fit(SETTINGS, [examples(looks=(8, 1))])
    bare = examples() | {"clutter-0": np.zeros((0, 12), np.complex64)}
    with pytest.raises(TooFewExamplesError, match="2 cuts of clutter or more from 3 to 5 m, got 0"):
        ComponentMap.fit(SETTINGS, [bare])
    few = examples() | {"clutter-0": examples()["clutter-0"][:5]}
    with pytest.raises(TooFewExamplesError, match="samples that moments can be taken of") as error:
        ComponentMap.fit(SETTINGS, [few])
    assert error.value.changes[0].value == "ledoit-wolf"


@pytest.mark.parametrize("edges", [(5.0,), (5.0, 5.0), (7.0, 5.0), tuple(range(1, 70))])
def test_edges_make_intervals(edges):
    with pytest.raises(ValueError, match="edges must increase and be 2 to 65, got"):
        ComponentSettings(edges=edges)


def test_a_model_of_other_intervals_is_refused():
    learnt, _ = ComponentMap.fit(SETTINGS, [examples()])
    three = ComponentSettings(length=6, edges=(3.0, 4.0, 5.0, 7.0))
    with pytest.raises(ValueError, match=r"array 'constant' must have the shape \(3\), got \(2,\)"):
        ComponentMap.check_learnt(three, None, Checked({}, learnt))
