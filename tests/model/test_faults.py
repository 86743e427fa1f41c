"""Faults of scenes, sensors, recipes and mappings are told in words that help to mend them."""

import tomllib
from importlib import resources

import pytest

from flgpr.formats.mapping import parse_mapping
from flgpr.geo import read_anchor
from flgpr.model import load_sensor
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.simulate import load_scene


def told(load, *arguments):
    with pytest.raises(ValueError) as caught:
        load(*arguments)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[[targets]]\nkind = 'metal'\nx = 0\ny = 2\ndept = 0.1",
            "targets.0.dept: no such entry; did you mean depth?",
        ),
        ("length_m = 60.0", "length_m: no such entry; did you mean length?"),
        (
            "[soil]\nlayers = [{thickness = 1, moist = 0.2}]",
            "soil.layers.0.moist: no such entry; did you mean",
        ),
        (
            "[clutter]\nzzz = 1",
            "clutter.zzz: no such entry; there are bushes, patches, posts, roadside, rocks",
        ),
        ("[[targets]]\nkind = 'metal'\ny = 2.0\ndepth = 0.1", "targets.0.x: is missing"),
        (
            "length = 'long'",
            "length: input should be a valid number, unable to parse string as a number, got 'long'",
        ),
        ("site = 'moon'", "scene: site must be one of arid-sand"),
        ("x_min = 2.0\nx_max = -2.0", "scene: x_max must be greater than x_min, got 2.0 and -2.0"),
    ],
)
def test_faults_of_a_scene(text, words, tmp_path):
    (tmp_path / "scene.toml").write_text(text)
    said = told(load_scene, tmp_path / "scene.toml")
    assert said.startswith(f"scene {tmp_path / 'scene.toml'}: {words}")
    assert "Value error" not in said
    assert "\n" not in said


def test_a_name_that_is_no_preset_and_a_file_that_is_not_there():
    assert told(load_sensor, "mine.toml") == "sensor file not found: mine.toml"
    assert told(load_sensor, "sri-arry").endswith("got 'sri-arry'; did you mean sri-array?")
    assert told(load_recipe, "own/wang.toml") == "recipe file not found: own/wang.toml"
    assert told(load_recipe, "wang").endswith("got 'wang'; did you mean wang2007?")
    assert told(load_scene, "no.toml") == "scene file not found: no.toml"


def test_faults_of_a_sensor_a_recipe_and_a_mapping(tmp_path):
    preset = (resources.files("flgpr.model") / "presets" / "sri-array.toml").read_text()
    assert "step" in tomllib.loads(preset)["tones"]
    (tmp_path / "mine.toml").write_text(preset.replace("\nstep", "\nsteps"))
    assert "tones.steps: no such entry; did you mean step?" in told(
        load_sensor, tmp_path / "mine.toml"
    )
    assert "image.spacing_m: no such entry; did you mean spacing?" in told(
        parse_recipe, "[image]\nspacing_m = 1"
    )
    assert told(parse_mapping, "titles = 'a'").startswith("mapping: ")


def test_a_fault_names_no_type_of_the_schema(tmp_path):
    path = tmp_path / "anchor.toml"
    path.write_text(
        'crs = "EPSG:32633"\naccuracy = 0.02\n[[point]]\nlane = [0.0]\neasting = 1.0\nnorthing = 2.0\n'
    )
    with pytest.raises(ValueError, match=r"point\.0\.lane\.1: is missing"):
        read_anchor(path)
