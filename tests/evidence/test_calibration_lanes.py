"""Experiments on the calibration lanes of Wang et al. 2007, evidence/reasons/calibration_lanes.py."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.progress import silent
from flgpr.recipe.schema import load_recipe
from flgpr_papers.wang2007.analysis import Pool
from flgpr_papers.wang2007.lanes import sensor
from reasons import calibration_lanes
from reasons.calibration_lanes import (
    RADARS,
    calibration_trials,
    changed_radar,
    feature_numbers,
    prescreener_numbers,
)
from wang2007_lane import fake_lane

pytestmark = pytest.mark.slow("studies of papers")
LANES = [fake_lane(f"c{seed}", seed) for seed in range(3)]


def test_a_change_is_of_the_radars_errors_alone():
    preset = sensor().model_dump()
    for name, entries in RADARS.items():
        radar = changed_radar(name).model_dump()
        before, after = preset["errors"], radar["errors"]
        assert {entry: after[entry] for entry in after if after[entry] != before[entry]} == entries
        assert radar | {"errors": before} == preset


def test_the_share_of_other_levels_is_of_places_that_far_looks_change():
    recipe = load_recipe("wang2007-printed")
    same = prescreener_numbers(LANES, recipe)
    assert same["other level"] == 0
    assert same["16 m"] == same["26 m"] > 0
    wide = LANES[0].other_views["wide"].copy()
    half = wide.sizes["y"] // 2
    wide[:half] = wide[:half] * 2  # 6 dB
    changed = [replace(one, other_views={**one.other_views, "wide": wide}) for one in LANES[:1]]
    share = prescreener_numbers(changed, recipe)["other level"]
    assert share == pytest.approx(half / wide.sizes["y"])


def test_mines_on_the_surface_and_buried_ones_are_told_apart():
    view = LANES[0].view.copy()
    truth = LANES[0].truth
    (first, *_) = np.flatnonzero(truth["depth"] < 0)
    place = dict(x=truth["x"][first], y=truth["y"][first])
    view[:] = 1 + 0.1 * np.random.default_rng(0).random(view.shape)
    index = {name: int(np.abs(view[name].values - at).argmin()) for name, at in place.items()}
    view[:, 4, index["y"], index["x"]] = 9.0
    [other] = [replace(LANES[0], view=view)]
    numbers = prescreener_numbers([other], load_recipe("wang2007-printed"))
    mines_on_surface = int((truth["depth"] < 0).sum())
    assert numbers["HH F4 surface"] >= 1 / mines_on_surface
    assert numbers["HH F4 buried"] < numbers["HH F4 surface"]


def test_features_that_say_something_are_told():
    numbers = feature_numbers(Pool(LANES))
    assert numbers["C_HH"] > numbers["P_alpha"]
    assert numbers["five"] >= numbers["first of five"] > 0.5
    assert 0 <= numbers["five nested"] <= 1
    assert 0 <= numbers["C_HH by the other lanes"] <= 1


def test_repeats_are_measured_once_and_their_lanes_go(tmp_path, monkeypatch):
    ran = []

    def fake_result(folder, scene, seed, radar, text, track):
        (folder / "lanes").mkdir(parents=True, exist_ok=True)
        ran.append((scene.name, seed, radar.errors))
        return fake_lane(scene.name, seed)

    monkeypatch.setattr(calibration_lanes, "lane_result", fake_result)
    trials = calibration_trials(tmp_path, True, "own", silent)
    assert len(ran) == 2 * len(RADARS) * 3
    assert all(ran.count(one) == 1 for one in ran)
    assert len([one for one in trials if one.explanation]) == 11
    assert not list((tmp_path / "reasons").glob("*.lanes"))
    ran.clear()
    again = calibration_trials(tmp_path, True, "own", silent)
    assert [one.row for one in again] == [one.row for one in trials]
    assert not ran
