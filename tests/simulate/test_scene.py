"""Scenes: sites, soils and the rules of their entries."""

import numpy as np
import pytest

from flgpr.simulate import Scene, load_scene
from flgpr.simulate.scene.scene import Soil, Target, sites


def test_a_site_of_ones_own_stands_where_the_scene_says_nothing(tmp_path):
    own = tmp_path / "track.toml"
    own.write_text(
        '[soil]\nmodel = "fixed"\npermittivity = 5.0\n[surface]\nrms_height = 0.007\n',
        encoding="utf-8",
    )
    scene = Scene(site=str(own), surface={"slope": 0.1})
    assert (scene.soil.permittivity, scene.surface.rms_height, scene.surface.slope) == (
        5.0,
        0.007,
        0.1,
    )
    assert Scene.model_validate(scene.model_dump()) == scene
    for text, message in (
        ("[soil", "must be TOML"),
        ("[lane]\nx = 1\n", "tables of a site alone, got lane"),
    ):
        own.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=message):
            Scene(site=str(own))
    with pytest.raises(
        ValueError, match=r"site must be one of arid-sand, .* or a TOML file that is there, got"
    ):
        Scene(site=str(tmp_path / "none.toml"))


def test_a_target_takes_what_its_kind_has_unless_it_is_given():
    metal = Target(kind="metal", x=0, y=0)
    plastic = Target(kind="plastic", x=0, y=0)
    simulant = Target(kind="simulant", x=0, y=0)
    assert (metal.dielectric, plastic.dielectric, simulant.dielectric) == (None, 2.9, 2.9)
    assert (metal.air_gap, plastic.air_gap, simulant.air_gap) == (0.0, 0.015, 0.0)
    stated = Target(kind="plastic", x=0, y=0, permittivity=3.2, gap=0.0)
    assert (stated.dielectric, stated.air_gap) == (3.2, 0.0)


def test_the_extent_of_a_profile_is_its_widest_corner_and_its_bottom():
    profile = ((0.0, 0.0), (0.1, 0.0), (0.16, 0.08), (0.05, 0.12))
    assert Target(kind="metal", x=0, y=0, profile=profile).extent == (0.16, 0.12)
    assert Target(kind="metal", x=0, y=0, radius=0.2, height=0.1).extent == (0.2, 0.1)


@pytest.mark.parametrize(
    ("depth", "want"),
    [
        (0.03, [0.03, 0.0, 0.0]),
        (0.12, [0.05, 0.07, 0.0]),
        (0.4, [0.05, 0.1, 0.25]),
        (-1, [0, 0, 0]),
    ],
)
def test_a_point_has_the_layers_over_it_down_to_its_depth(depth, want):
    layers = [{"thickness": 0.05, "moisture": 0.02}, {"thickness": 0.1, "moisture": 0.1}]
    np.testing.assert_allclose(Soil(layers=layers).thicknesses_above(depth), want)


def test_the_permittivities_of_layers_come_from_the_top_down():
    soil = Soil(model="topp", moisture=0.3, layers=[{"thickness": 0.05, "moisture": 0.02}])
    upper, lower = soil.media(1e9)
    assert upper.real < lower.real


def test_another_model_of_soil_than_the_sites_takes_its_own_entries():
    """What the site says for its model is left out, and a stored scene reads as it was."""
    scene = Scene.model_validate(
        {"site": "wet-clay", "soil": {"model": "fixed", "permittivity": 9.0, "conductivity": 0.01}}
    )
    assert scene.soil.permittivity == 9.0
    assert Scene.model_validate(scene.model_dump(mode="json")).soil == scene.soil
    for site in sites():
        of_site = Scene.model_validate({"site": site})
        assert Scene.model_validate(of_site.model_dump(mode="json")) == of_site


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"x_min": 2.0, "x_max": 1.0}, "x_max must be greater than x_min"),
        ({"track": {"step": (3.0, 1.0)}}, "step must have 0 < least <= greatest"),
        ({"clutter": {"roadside": (7.0, 3.0)}}, "roadside must be the least and the greatest"),
        ({"lenght": 3.0}, "lenght"),
        (
            {"soil": {"permittivity": 9.0}},
            "permittivity goes with the model fixed, got 9 with model",
        ),
        (
            {"site": "prepared-sand", "soil": {"sand": 10.0}},
            "sand goes with the model peplinski, got",
        ),
        (
            {"draws": [{"kind": "metal", "depth": 0.1, "count": 2, "laid": 2}]},
            "laid must be a drive that the scene tells of, at most 1, got 2",
        ),
        (
            {
                "targets": [{"kind": "metal", "x": 0, "y": 1, "laid": 2, "lifted": 2}],
                "drives": [{}],
            },
            "lifted must be a drive after laid, got 2 and 2",
        ),
    ],
)
def test_entries_that_break_a_rule_are_refused(entries, message):
    with pytest.raises(ValueError, match=message):
        Scene.model_validate(entries)


def test_a_scene_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"scene file not found: .*none\.toml"):
        load_scene(tmp_path / "none.toml")
