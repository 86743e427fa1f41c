"""The two worlds of every study: prepared lanes of its own, and roads as found, which are those of before."""

import json

import pytest

from flgpr.io import sha256
from flgpr_papers.cosgrove2004 import images as cosgrove
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.flsar2004 import lanes as flsar
from flgpr_papers.fuse2018 import lanes as fuse
from flgpr_papers.wang2007 import lanes as wang

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


def cosgrove_scenes(quick):
    recipe = study_recipe(quick)
    for name, site in recipe.sites.items():
        yield cosgrove._scene(recipe, site, cosgrove._seed(recipe, name, 1), recipe.study.share)[0]


def flsar_scenes(quick):
    settings = flsar.load_settings(quick)
    for site in settings.sites:
        yield flsar._scene(settings, site)


def fuse_scenes(quick):
    recipe = fuse.fuse_recipe(quick)
    for name in recipe.lanes.seeds:
        for band in fuse.BANDS:
            yield fuse.lane_scene(recipe, name, band)


def wang_scenes(quick):
    parts = wang.quick_scenes() if quick else (wang.calibration_scenes(), wang.blind_scenes())
    for lanes in parts:
        for scene, _ in lanes.values():
            yield scene


SCENES = {"cosgrove2004": cosgrove_scenes, "flsar2004": flsar_scenes, "fuse2018": fuse_scenes, "wang2007": wang_scenes}


def digest(scenes):
    """Digest what scenes say, to nine digits."""

    def rounded(value):
        if isinstance(value, dict):
            return {name: rounded(one) for name, one in value.items()}
        if isinstance(value, list):
            return [rounded(one) for one in value]
        return f"{value:.9g}" if isinstance(value, float) else value

    # The name is a label: nothing is drawn by it.
    dumps = [rounded(scene.model_dump(mode="json", exclude_unset=True, exclude={"name"})) for scene in scenes]
    return sha256(json.dumps(dumps, sort_keys=True).encode())[:16]


@pytest.mark.parametrize("form", ["quick", "full"])
@pytest.mark.parametrize("paper", SCENES)
def test_roads_as_found_are_those_of_before(paper, form):
    assert digest(SCENES[paper](form == "quick")) == FROZEN[paper, form]
