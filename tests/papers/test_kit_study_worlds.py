"""The two worlds of every study: prepared lanes of its own, and roads as found, which are those of before."""

import json
from collections import Counter

import pytest

from flgpr.simulate import draw_world
from flgpr.simulate.bodies.signature.table import body_size
from flgpr.simulate.scene.scene import site_tables, sites
from flgpr.store import sha256
from flgpr_papers.cosgrove2004 import images as cosgrove
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.flsar2004 import lanes as flsar
from flgpr_papers.fuse2018 import lanes as fuse
from flgpr_papers.fuse2018.process import result_key
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.findings import measured, write_findings
from flgpr_papers.kit.mines import MIXES, mix_counts
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.study_worlds import (
    AS_FOUND,
    OWN,
    STUDY_WORLDS,
    other_world,
    study_world,
    world_folder,
)
from flgpr_papers.wang2007 import lanes as wang

pytestmark = pytest.mark.slow("studies of papers")

FROZEN = {
    ("cosgrove2004", "quick"): "fcc6a742473ff304",
    ("cosgrove2004", "full"): "676decbeda80ac56",
    ("flsar2004", "quick"): "1a6d3bd9306daea7",
    ("flsar2004", "full"): "efb91a76a40bb9c9",
    ("fuse2018", "quick"): "fcdc33e0cf61cbda",
    ("fuse2018", "full"): "3916f4f7c51e1204",
    ("wang2007", "quick"): "4caa9e0a9a7289de",
    ("wang2007", "full"): "84de823cf5872fcd",
}
"""Digests of the scenes that every study had before it got prepared lanes."""


def cosgrove_scenes(quick, world):
    recipe = study_recipe(quick, world)
    for name, site in recipe.sites.items():
        yield cosgrove.lane_scene(
            recipe, site, cosgrove.lane_seed(recipe, name, 1), recipe.study.share
        )[0]


def flsar_scenes(quick, world):
    settings = flsar.load_settings(quick, world)
    for site in settings.sites:
        yield flsar._scene(settings, site)


def fuse_scenes(quick, world):
    recipe = fuse.fuse_recipe(quick, world)
    for name in recipe.lanes.seeds:
        for band in fuse.BANDS:
            yield fuse.lane_scene(recipe, name, band)


def wang_scenes(quick, world):
    parts = (
        wang.quick_scenes(world=world)
        if quick
        else (wang.calibration_scenes(world), wang.blind_scenes(world))
    )
    for lanes in parts:
        for scene, _ in lanes.values():
            yield scene


SCENES = {
    "cosgrove2004": cosgrove_scenes,
    "flsar2004": flsar_scenes,
    "fuse2018": fuse_scenes,
    "wang2007": wang_scenes,
}


def digest(scenes):
    """Digest what scenes say, to nine digits."""

    def rounded(value):
        if isinstance(value, dict):
            return {name: rounded(one) for name, one in value.items()}
        if isinstance(value, list):
            return [rounded(one) for one in value]
        return f"{value:.9g}" if isinstance(value, float) else value

    # The name is a label: nothing is drawn by it.
    dumps = [
        rounded(scene.model_dump(mode="json", exclude_unset=True, exclude={"name"}))
        for scene in scenes
    ]
    return sha256(json.dumps(dumps, sort_keys=True).encode())[:16]


@pytest.mark.parametrize("form", ["quick", "full"])
@pytest.mark.parametrize("paper", SCENES)
def test_roads_as_found_are_those_of_before(paper, form):
    assert digest(SCENES[paper](form == "quick", AS_FOUND)) == FROZEN[paper, form]


@pytest.mark.parametrize("world", STUDY_WORLDS)
@pytest.mark.parametrize("paper", PAPERS)
def test_what_a_world_names_exists(paper, world):
    told = study_world(paper, world)
    assert set(told.sites.values()) <= set(sites())
    assert all(site.startswith("prepared-") == (world == OWN) for site in told.sites.values())
    assert set(told.mixes.values()) <= set(MIXES)
    assert all(MIXES[mix].kind == kind for kind, mix in told.mixes.items())
    assert bool(told.described) == (world == OWN)
    assert all(one.place and one.here for one in told.described)


@pytest.mark.parametrize("form", ["quick", "full"])
@pytest.mark.parametrize("paper", SCENES)
def test_lanes_of_the_own_world_lie_on_its_sites(paper, form):
    own, as_found = (list(SCENES[paper](form == "quick", world)) for world in STUDY_WORLDS)
    assert {scene.site for scene in own} == set(study_world(paper).sites.values())
    assert [scene.length for scene in own] == [scene.length for scene in as_found]
    assert all(one != other for one, other in zip(own, as_found, strict=True))
    for scene in own:
        assert scene.surface.rms_height == site_tables(scene.site)["surface"]["rms_height"]
        if paper == "fuse2018":  # its paper is about the roadside
            assert (scene.clutter.bushes, scene.clutter.posts) == (0.35, 0.06)


def test_results_of_the_two_worlds_have_other_keys():
    recipes = [study_recipe(True, world) for world in STUDY_WORLDS]
    settings = [flsar.load_settings(True, world) for world in STUDY_WORLDS]
    fuses = [fuse.fuse_recipe(True, world) for world in STUDY_WORLDS]
    for one, other in (recipes, settings):
        assert key_of(one.model_dump(mode="json")) != key_of(other.model_dump(mode="json"))
    assert len({result_key(one, True) for one in fuses}) == 2


def test_bodies_of_a_mix_are_dealt_over_all_lanes_in_their_shares():
    buried = Counter()
    surface = Counter()
    for scene, seed in wang.calibration_scenes().values():
        for target in draw_world(scene, seed).targets:
            lies = target.depth < 0
            (surface if lies else buried)[target.kind, target.body] += 1
            if lies:
                assert target.depth == pytest.approx(-body_size(target.body)["height"], abs=0.03)
    plastic = {body: count for (kind, body), count in buried.items() if kind == "plastic"}
    assert plastic == mix_counts("plastic", 20)
    assert sum(count for (kind, _), count in buried.items() if kind == "simulant") == 16
    lying = {body: count for (kind, body), count in surface.items() if kind == "plastic"}
    assert lying == mix_counts("plastic", 7)
    assert sum(surface.values()) == 15
    for scene, _ in wang.blind_scenes().values():
        assert sum(draw.count for draw in scene.draws if draw.kind == "plastic") == 12


def test_a_road_as_found_stands_beside_if_it_is_there_in_the_same_form(tmp_path):
    beside = world_folder(tmp_path, AS_FOUND)
    assert other_world(tmp_path, "page.html", OWN, quick=False).page == ""
    beside.mkdir()
    write_findings(
        beside, [measured("a", "p", "q", (0.1, 0.06, 0.2), (-0.05, 0.05))], False, world=AS_FOUND
    )
    (beside / "page.html").write_text("")
    there = other_world(tmp_path, "page.html", OWN, quick=False)
    assert there.page == "as-found/page.html"
    assert there.found["a", "q", ""] == ("0.10 (0.06 to 0.20)", "disagrees")
    assert other_world(tmp_path, "page.html", OWN, quick=True).page == ""
    assert other_world(tmp_path, "page.html", AS_FOUND, quick=False).page == ""
