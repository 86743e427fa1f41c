"""Why `fused` misses the full-wave lane, evidence/why_full_wave.py, on numbers that are known."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.stages.early import EarlyEchoes

sys.path.append(str(Path(__file__).parents[2] / "evidence"))
from full_wave_causes import detection, figure, lanes, recipes, signatures, tables

pytestmark = pytest.mark.slow("of a script, whose numbers stand on a page")


def test_recipes_are_of_one_array_and_early_echoes_are_taken_out_by_name():
    fused = recipes.fused_recipe()
    contrast = recipes.contrast_recipe()
    assert fused.image.grid() == contrast.image.grid()
    assert not fused.clutter
    assert not contrast.clutter
    (stage,) = recipes.fused_recipe(early=True).clutter
    assert stage.stage_class is EarlyEchoes
    assert list(recipes.fused_recipe(recipes.WIDE).image.subbands) == ["F0", "F1", "F2"]


def test_a_twin_has_the_targets_of_the_lane_and_another_surface():
    real = lanes.full_wave()
    scene = lanes.twin_scene((0.009, 0.10))
    assert scene.surface.rms_height == 0.009
    places = [(target.x, target.y) for target in scene.targets]
    np.testing.assert_allclose(places, real.targets[["x", "y"]])
    assert not lanes.twin_scene((0.009, 0.10), targets=False).targets


def test_targets_are_found_behind_the_false_alarms_above_them():
    targets = pd.DataFrame({
        "target_id": ["a", "b", "c"], "x": 0.0, "y": [2.5, 4.0, 5.9], "kind": "metal", "depth": 0.05,
    })  # fmt: skip
    alarms = pd.DataFrame({"x": 0.0, "y": [3.1, 2.5, 4.7, 4.1], "confidence": [4.0, 3.0, 2.0, 1.0]})
    data = lanes.LaneData(None, lanes.LANE, targets, targets)
    assert detection.before_targets(alarms, data).tolist() == [1, 2, np.inf]
    rows = []
    detection.add(rows, "twins", 7, "C_HH", alarms, data)
    assert [row["false_alarms"] for row in rows] == [1, 2, np.inf]
    # That of the strongest alarm near it, not of the one that finds it.
    assert rows[1]["behind"] == pytest.approx(0.7)
    assert np.isnan(rows[2]["behind"])


def test_coherence_takes_no_notice_of_level_and_phase():
    rng = np.random.default_rng(1)
    one = rng.normal(size=(2, 9)) + 1j * rng.normal(size=(2, 9))
    assert signatures.coherence(one, 3j * one) == pytest.approx(1)
    assert signatures.coherence(np.array([1, 0]), np.array([0, 1])) == 0
    assert np.isnan(signatures.coherence(one, 0 * one))
    assert signatures.decibels(10.0) == pytest.approx(20)


def test_mines_of_three_are_told_with_their_spread():
    found = pd.Series([1, 1, 0, 1, 0, 0], index=pd.Index([0, 0, 0, 1, 1, 1], name="seed"))
    assert tables.of_three(found) == "1.5 (1 to 2; 0, 1, 1, 0)"
    assert tables.of_three(found[:3]) == "2.0"


def test_the_figure_has_a_mark_for_every_count_and_a_legend_below_each_panel():
    worlds = (lanes.OWN, lanes.WITH_OWN_ECHOES, figure.FULL_WAVE)
    found = pd.DataFrame([
        {"world": world, "seed": seed, "detector": name, "target": target, "false_alarms": seed}
        for world in worlds for seed in range(2) for name in figure.DETECTORS for target in "abc"
    ])  # fmt: skip
    lane = pd.DataFrame([
        {"world": world, "early_out": out, "target": target, "coherence": 0.5, "by_chance_95": 0.4}
        for world in worlds for out in (False, True) for target in "abc"
    ])  # fmt: skip
    ground = pd.DataFrame([
        {"world": world, "early_out": out, "polarization": "HH", "band": band, "level_db": 40.0}
        for world in worlds for out in (False, True) for band in signatures.BANDS
    ])  # fmt: skip
    drawn = figure.make_figure(found, lane, ground)
    drawn.draw_without_rendering()
    left, middle, right = drawn.axes
    # Two seeds: one or no false alarm, so that all three mines are found in both.
    assert len(left.collections) == len(worlds) * len(figure.DETECTORS)
    for axes in (left, middle, right):
        assert axes.get_legend().get_window_extent().y1 < axes.get_window_extent().y0


def test_echoes_alone_lie_in_the_directions_in_which_fused_looks():
    case = signatures.difference.load(next(iter(signatures.difference.names())))
    vectors = signatures.directions(case)
    assert vectors.shape == (signatures.RANK, vectors.shape[1])
    np.testing.assert_allclose(vectors @ vectors.conj().T, np.eye(signatures.RANK), atol=1e-4)
    assert signatures.share(vectors[0].conj(), vectors.conj()) == pytest.approx(1, abs=1e-4)
