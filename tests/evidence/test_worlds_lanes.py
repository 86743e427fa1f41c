"""Lanes of worlds: their sites, the roads of the ablation, a lane's record, signal to clutter, and what tables tell."""

import dataclasses
import json
import math

import numpy as np
import pandas as pd
import pytest

from flgpr.jobs.workers import InProcess
from flgpr.simulate import Scene
from flgpr.simulate.scene.scene import site_tables
from worlds import ablation, detection
from worlds.lanes import (
    FAR,
    LaneJob,
    lane_recipe,
    lane_table,
    radar,
    read_targets,
    run_jobs,
)
from worlds.signature import signal_to_clutter
from worlds.space import AXES, DECLARED, World, design_worlds

pytestmark = pytest.mark.slow("simulates the lanes of a study")

WORLD = World(1, 4.0, 4.5, "mironov", "natural", "posts", "plastic")


def scene_of(tables):
    return Scene(length=30.0, **tables)


def test_worlds_have_names_numbers_and_seeds_of_their_own():
    every = design_worlds()
    assert len(every) == 64
    assert [world.number for world in every] == list(range(64))
    assert len({world.name for world in every}) == 64
    assert len({job.seed for job in detection.jobs()}) == 64


@pytest.mark.parametrize("permittivity", AXES["permittivity"])
def test_a_world_is_a_site_of_its_soil_surface_and_roadside(permittivity):
    scenes = {}
    for loss in AXES["loss"]:
        world = dataclasses.replace(WORLD, permittivity=permittivity, loss=loss)
        scenes[loss] = scene_of(world.tables())
    soil = {loss: scene.soil.media(np.array([1e9]))[-1][0] for loss, scene in scenes.items()}
    assert soil["mironov"].real == pytest.approx(permittivity, abs=0.01)
    assert soil["low"].real == pytest.approx(permittivity, abs=0.01)
    assert -soil["low"].imag / soil["low"].real == pytest.approx(0.01)
    assert -soil["mironov"].imag / soil["mironov"].real > 0.02
    prepared = site_tables("prepared-earth")
    for scene in scenes.values():
        assert scene.surface.rms_height == pytest.approx(0.004)
        assert scene.surface.correlation_length == prepared["surface"]["correlation_length"]
        assert (scene.clutter.bushes, scene.clutter.posts) == (0.0, DECLARED["roadside"]["posts"])


def test_contents_are_those_of_the_sites():
    def scene(contents):
        world = dataclasses.replace(WORLD, contents=contents, permittivity=6.0)
        return scene_of(world.tables())

    nothing, prepared, natural = map(scene, AXES["contents"])
    assert not any(
        getattr(nothing, part).on
        for part in ("stones", "roots", "lenses", "heterogeneity", "holes")
    )
    assert (nothing.clutter.rocks, nothing.clutter.patches) == (0.0, 0.0)
    assert natural.stones.density == site_tables("temperate")["stones"]["density"]
    assert (
        prepared.stones.density
        == site_tables("prepared-earth")["stones"]["density"]
        < natural.stones.density
    )
    assert natural.clutter.rocks == site_tables("temperate")["clutter"]["rocks"]
    ratio = natural.heterogeneity.deviation / site_tables("temperate")["heterogeneity"]["deviation"]
    own = Scene(site="temperate").soil.media([1e9])[-1][0].real
    assert ratio == pytest.approx((6.0 - 1) / (own - 1), rel=1e-3)


def test_all_parts_together_turn_each_road_into_the_other():
    smooth = ablation.smooth_road()
    natural = ablation.natural_road()
    assert scene_of(ablation.replaced(smooth, natural, ablation.PARTS)) == scene_of(natural)
    made = scene_of(ablation.replaced(natural, smooth, ablation.PARTS))
    assert made == scene_of(smooth)
    assert not made.grass.grown
    assert made.clutter.bushes == 0


def test_a_part_changes_nothing_but_itself():
    smooth = ablation.smooth_road()
    natural = ablation.natural_road()
    before = scene_of(smooth).model_dump()
    after = scene_of(ablation.replaced(smooth, natural, ["roughness"])).model_dump()
    assert after["surface"]["rms_height"] == 0.005
    different = [
        name for name in after["surface"] if after["surface"][name] != before["surface"][name]
    ]
    assert set(different) <= {"rms_height", "correlation_length"}
    assert [name for name in after if after[name] != before[name]] == ["surface"]


def test_replicates_have_the_same_mines_on_all_roads():
    lanes = ablation.jobs()
    assert len(lanes) == 2 * (1 + len(ablation.PARTS)) * DECLARED["ablation"]["replicates"]
    assert len({job.name for job in lanes}) == len(lanes)
    for replicate in range(DECLARED["ablation"]["replicates"]):
        own = [job for job in lanes if job.about["replicate"] == replicate]
        assert len({(job.seed, job.mines, job.length, job.count) for job in own}) == 1


def test_the_radar_has_the_tones_of_f1_and_the_recipe_the_ground_asked_for():
    tones = radar(3.5).tones.axis()
    assert (tones[0], tones[-1]) == pytest.approx((0.75e9, 1.35e9))
    assert (radar(3.5).height, radar().height) == (3.5, 5.0)
    recipe = lane_recipe((10.0, 22.0))
    assert list(recipe.image.subbands) == ["F1"]
    assert (recipe.image.y[0], recipe.run_view.y_max) == (10.0, 22.0)
    assert lane_recipe().image.y[0] == 7.0


@pytest.fixture(scope="module")
def lane(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lanes")
    tables = ablation.smooth_road()
    tables["surface"] = tables["surface"] | {"rms_height": 0.001}
    job = LaneJob(
        "detection",
        "short",
        {"number": 7},
        tables,
        "plastic",
        12.0,
        1,
        3,
        ground=((7.0, 10.0), (7.0, 16.0)),
    )
    run_jobs(folder, [job], InProcess())
    return folder, job


@pytest.mark.slow("simulates lanes of several worlds")
def test_a_lane_is_kept_and_not_run_again(lane, monkeypatch):
    folder, job = lane
    record = json.loads(job.path(folder).read_text())
    assert len(record["targets"]) == len(record["ratio_db"]) == 3
    assert [found["ground"] for found in record["found"]] == [[7.0, 10.0], [7.0, 16.0]]
    monkeypatch.setattr("worlds.lanes.run_job", lambda *_: pytest.fail("run again"))
    run_jobs(folder, [job], InProcess())
    other = dataclasses.replace(job, seed=4)
    assert other.path(folder) != job.path(folder)


def test_targets_of_a_lane_are_read_with_what_the_lane_is(lane):
    folder, job = lane
    table = read_targets(folder, [job, dataclasses.replace(job, seed=5)])
    assert len(table) == 6
    assert set(table["kind"]) == {"metal", "plastic", "simulant"}
    assert set(table["number"]) == {7}
    metal = table[(table["kind"] == "metal") & (table["farthest"] == 16.0)].iloc[0]
    assert metal["far"] == 0.0  # a metal mine under a road of 1 mm stands above all clutter
    assert metal["ratio_db"] > 15
    assert read_targets(folder, [dataclasses.replace(job, seed=5)]).empty


def test_found_targets_are_counted_lane_by_lane():
    targets = pd.DataFrame(
        {
            "number": [0, 0, 0, 0, 1],
            "kind": ["metal", "metal", "plastic", "simulant", "plastic"],
            "far": [0.0, FAR[0], FAR[1], math.inf, 0.05],
            "ratio_db": [10.0, 14.0, 0.0, -5.0, 2.0],
            **{f"chance_{far:g}": far for far in FAR},
        }
    )
    table = lane_table(targets, ["number"]).set_index("number")
    assert table.loc[0, ["metal_targets", "metal_0.02", "metal_0.07"]].tolist() == [2, 2, 2]
    assert table.loc[0, ["plastic_targets", "plastic_0.02", "plastic_0.07"]].tolist() == [1, 0, 1]
    assert table.loc[0, ["simulant_0.07", "metal_ratio_db"]].tolist() == [0, 12.0]
    assert table.loc[1, ["plastic_0.07", "metal_targets"]].tolist() == [1, 0]


def test_signal_to_clutter_falls_with_the_square_of_the_roughness():
    """σ⁰ of small perturbations goes with s²: 12 dB from 1 to 4 mm, on the same scatterers."""
    ratios = []
    for rms in (0.001, 0.004):
        tables = ablation.smooth_road()
        tables["terrain"] = {"on": False}
        tables["surface"] = tables["surface"] | {
            "rms_height": rms, "unevenness": 0.0, "phase_screen": False, "density": 30.0,
        }  # fmt: skip
        target = {"kind": "metal", "body": "tm-62m", "x": 0.2, "y": 6.0, "depth": 0.075}
        scene = Scene(length=12.0, targets=[target], **tables)
        ratios.append(signal_to_clutter(scene, radar(), 1, tuple(DECLARED["lane"]["band"]))[0])
    assert ratios[0] - ratios[1] == pytest.approx(20 * math.log10(4), abs=0.05)
