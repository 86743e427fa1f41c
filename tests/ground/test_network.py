"""The convolutional network on chips: its forward pass, its examples, and, where PyTorch is there, its training."""

import sys
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.signal import correlate
from sklearn.metrics import roc_auc_score

from flgpr.method.model import Model, load_model, save_model
from flgpr.model import Lane
from flgpr.stages import TrainingView
from flgpr_ground.stages.network import (
    ChipNetwork,
    NetworkSettings,
    run_network,
    train_network,
    weights_of,
)

X = np.round(np.arange(-3, 3.05, 0.1), 9)
Y = np.round(np.arange(0, 40.05, 0.1), 9)
LANE = Lane(-1.5, 1.5, 2.0, 38.0)
MINES = pd.DataFrame(
    {"x": np.tile([-0.8, 0.1, 0.9], 4), "y": 4.0 + 2.7 * np.arange(12), "kind": "metal"}
)


def view_of(seed, truth=MINES):
    """Two channels of Rayleigh clutter; mines are wide in both, clutter's own bright spots are single pixels in one."""
    rng = np.random.default_rng(seed)
    values = rng.rayleigh(1.0, (1, 2, Y.size, X.size))
    for x, y in truth[["x", "y"]].to_numpy():
        values += 4 * np.exp(-((X - x) ** 2 + (Y[:, None] - y) ** 2) / 0.15)
    rows = rng.integers(0, Y.size, 150)
    columns = rng.integers(0, X.size, 150)
    values[0, 0, rows, columns] += 8
    coords = {"polarization": ["HH"], "subband": ["F1", "F2"], "y": Y, "x": X}
    return xr.DataArray(values.astype(np.float32), dims=tuple(coords), coords=coords)


def lane(seed):
    return TrainingView(view_of(seed), MINES, LANE)


def network(learnt, **settings):
    return ChipNetwork(NetworkSettings(**settings), None, learnt)


def made_up(channels=2, sizes=(3, 4, 5), seed=3):
    rng = np.random.default_rng(seed)
    of = (channels, *sizes)
    weights = {
        f"kernel{k}": rng.normal(size=(of[k + 1], of[k], 3, 3)).astype(np.float32) for k in range(3)
    }
    weights |= {f"bias{k}": rng.normal(size=of[k + 1]).astype(np.float32) for k in range(3)}
    return weights | {"last": rng.normal(size=of[3]).astype(np.float32), "bias": np.float32([0.3])}


def test_the_forward_pass_is_three_convolutions_a_mean_and_a_sum():
    weights = made_up()
    x = np.random.default_rng(0).normal(size=(2, 2, 21, 21)).astype(np.float32)
    for chip, score in zip(x, run_network(x, weights), strict=True):
        maps = chip
        for k, stride in enumerate((1, 2, 2)):
            kernels = weights[f"kernel{k}"]
            bias = weights[f"bias{k}"]
            sums = [sum(map(partial(correlate, mode="valid"), maps, some)) for some in kernels]
            maps = np.maximum(np.array(sums)[:, ::stride, ::stride] + bias[:, None, None], 0)
        assert score == pytest.approx(maps.mean(axis=(1, 2)) @ weights["last"] + 0.3, rel=1e-4)


def test_scores_do_not_depend_on_which_alarms_are_asked_for_together():
    rng = np.random.default_rng(1)
    learnt = {"mean": np.zeros((2, 1, 1)), "deviation": np.ones((2, 1, 1))}
    for number in range(2):
        learnt |= {f"{number}-{name}": one for name, one in made_up(seed=number).items()}
    stage = network(learnt)
    places = np.column_stack(
        [rng.uniform(-3, 3, 300), rng.uniform(0, 40, 300)]
    )  # at the border, too
    every = stage.of_view(view_of(5), places)["cnn"]
    assert np.isfinite(every).all()
    np.testing.assert_allclose(
        stage.of_view(view_of(5), places[280:])["cnn"], every[280:], rtol=1e-5
    )
    assert len(weights_of(learnt)) == 2
    assert stage.of_view(view_of(5), np.zeros((0, 2)))["cnn"].shape == (0,)


def test_without_pytorch_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ModuleNotFoundError, match=r"flgpr\[network\]"):
        ChipNetwork.fit(NetworkSettings(), [lane(1)])


def test_lanes_without_mines_of_its_kinds_are_refused():
    with pytest.raises(ValueError, match="needs mines and clutter, got 0 and"):
        ChipNetwork.fit(NetworkSettings(kinds=("plastic",)), [lane(1)])


def test_it_learns_what_is_wide_and_its_model_needs_no_pytorch(tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="PyTorch is an extra")
    settings = NetworkSettings(networks=2, epochs=6)
    learnt, notes = ChipNetwork.fit(settings, [lane(1), lane(2)])
    assert notes["chips_of_mines"] >= 9 * 24
    again, _ = ChipNetwork.fit(settings, [lane(1), lane(2)])
    assert all(np.array_equal(learnt[name], again[name]) for name in learnt)
    save_model(Model(stages={"features.network": learnt}), tmp_path / "model")
    monkeypatch.setitem(sys.modules, "torch", None)
    stage = network(load_model(tmp_path / "model").stages["features.network"])
    rng = np.random.default_rng(4)
    other = pd.DataFrame(
        {"x": rng.uniform(-1.2, 1.2, 12), "y": 3.5 + 2.9 * np.arange(12), "kind": "metal"}
    )
    spots = np.column_stack([rng.uniform(-1.5, 1.5, 400), rng.uniform(2, 38, 400)])
    spots = spots[np.hypot(*(spots[:, None] - other[["x", "y"]].to_numpy()).T).min(axis=0) > 1]
    places = np.concatenate([other[["x", "y"]].to_numpy(), spots])
    scores = stage.of_view(view_of(9, other), places)["cnn"]
    assert roc_auc_score(np.arange(len(places)) < 12, scores) > 0.99
    monkeypatch.undo()
    rows = np.random.default_rng(0).permutation(300)
    chips = np.random.default_rng(6).normal(size=(300, 2, 21, 21)).astype(np.float32)
    by_chance = train_network(chips[rows[:150]], chips[rows[150:]], NetworkSettings(epochs=2), 0)
    fresh = np.random.default_rng(7).normal(size=(400, 2, 21, 21)).astype(np.float32)
    assert 0.4 < roc_auc_score(np.arange(400) < 200, run_network(fresh, by_chance)) < 0.6
