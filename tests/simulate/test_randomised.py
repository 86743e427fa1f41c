"""Worlds whose entries are drawn anew by every seed."""

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.model import load_sensor
from flgpr.simulate import Scene
from flgpr.simulate.scene.randomised import draw_into, load_worlds, world_names

SENSOR = load_sensor("sri-array")
TOML = """
name = "two"
[scene.soil]
model = { one_of = ["fixed"] }
permittivity = { ratio = [2.0, 32.0] }
[sensor.errors]
position = [0.01, 0.03]
"""


@pytest.fixture
def worlds(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(TOML)
    return load_worlds(path)


def test_a_seed_draws_the_same_world_and_another_seed_another(worlds):
    first, again, other = (draw_into(worlds, Scene(), SENSOR, seed) for seed in (1, 1, 2))
    assert first == again
    assert first[0].soil.permittivity != other[0].soil.permittivity
    assert first[1].errors.position != other[1].errors.position


def test_values_keep_their_ranges_and_ratios_are_even(worlds):
    permittivity = []
    for seed in range(400):
        scene, sensor, _ = draw_into(worlds, Scene(), SENSOR, seed)
        permittivity.append(scene.soil.permittivity)
        assert 0.01 <= sensor.errors.position <= 0.03
    assert 2 <= min(permittivity) < 2.2
    assert 29 < max(permittivity) <= 32
    # The middle of the ratios of 2 to 32 is 8: half lie below.
    assert np.mean(np.array(permittivity) < 8) == pytest.approx(0.5, abs=0.08)


def test_what_is_not_drawn_stays(worlds):
    scene, sensor, drawn = draw_into(worlds, Scene(site="arid-sand", length=12.0), SENSOR, 3)
    plain = Scene(site="arid-sand", length=12.0)
    assert scene.surface == plain.surface
    assert scene.length == 12.0
    assert sensor.tones == SENSOR.tones
    assert [line.split()[0] for line in drawn] == [
        "soil.model",
        "soil.permittivity",
        "errors.position",
    ]


def test_one_more_entry_leaves_the_others_as_they_were(worlds, tmp_path):
    path = tmp_path / "three.toml"
    path.write_text(TOML + "heading = [0.0, 0.01]\n")
    before = draw_into(worlds, Scene(), SENSOR, 5)
    after = draw_into(load_worlds(path), Scene(), SENSOR, 5)
    assert before[0] == after[0]
    assert before[1].errors.position == after[1].errors.position


@pytest.mark.parametrize("name", world_names())
def test_packaged_worlds_draw_valid_lanes(name):
    for seed in range(20):
        draw_into(load_worlds(name), Scene(length=10.0), SENSOR, seed)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("clay = [3.0, 2.0]", "soil.clay must be [least, greatest]"),
        ("clay = [1.0]", "soil.clay must be [least, greatest]"),
        ("clay = { ratio = [0.0, 2.0] }", "soil.clay must have ratios of values over zero"),
        ("clay = { one_of = [] }", "soil.clay must have values in one_of"),
    ],
)
def test_what_nothing_can_be_drawn_from_is_refused(tmp_path, line, fault):
    path = tmp_path / "worlds.toml"
    path.write_text(f'name = "bad"\n[scene.soil]\n{line}\n')
    with pytest.raises(ValueError) as caught:
        load_worlds(path)
    assert fault in str(caught.value)


def test_an_entry_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "worlds.toml"
    path.write_text('name = "bad"\n[scene.soil]\nmoistur = [0.1, 0.2]\n')
    with pytest.raises(ValueError, match=r"worlds bad: scene.soil.moistur: no such entry"):
        draw_into(load_worlds(path), Scene(), SENSOR, 1)


def test_simulate_tells_what_it_drew(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text('name = "short"\nlength = 2.0\n[track]\npositions = [-8.0]\n')
    words = ["simulate", str(scene), "--sensor", "full-wave", "--worlds", "any-road", "--seed", "4"]
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "a.zarr")])
    assert done.exit_code == 0, done.output
    assert "drawn by seed 4: site " in done.output
