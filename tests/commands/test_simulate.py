"""Simulation by command: scenes drawn or simulated, and options that do not go together."""

import pytest
from typer.testing import CliRunner

from alone import needs
from flgpr.commands.app import app
from flgpr.commands.simulate import simulate_lane
from flgpr.store import open_run


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_a_scene_is_drawn_or_simulated(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "yard"\nsite = "gravel"\nlength = 8.0\n[surface]\ndensity = 2.0\n[track]\npositions = [0.0]\n'
        '[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 1\n'
    )
    drawn = call("simulate", scene, "--preview", tmp_path / "scene.png")
    assert drawn.exit_code == 0, drawn.output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.png", "scene.toml"]
    made = call("simulate", scene, "-o", tmp_path / "yard.zarr", "--seed", 3, "--quiet")
    assert made.exit_code == 0, made.output
    assert open_run(tmp_path / "yard.zarr").attrs["seed"] == 3
    scene.write_text("length = -1")
    failed = call("simulate", scene, "-o", tmp_path / "x.zarr")
    assert failed.exit_code == 2
    assert "length" in failed.stderr


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"body": "m19.toml"}, "only simulate signature takes a second argument, got 'm19.toml'"),
        pytest.param(
            {"engine": "rays"},
            "engine must be one of flgpr, gprmax, got 'rays'",
            marks=needs("flgpr_exchange"),
        ),
        ({}, "simulate needs `output` or `preview`, got neither"),
        (
            {"preview": "a.png", "truth": "t.csv"},
            "`truth` does nothing where a scene is only drawn",
        ),
        (
            {"output": "a.zarr", "workers": 3},
            "`workers` does nothing where flgpr simulates a lane, got 3",
        ),
        pytest.param(
            {"output": "a", "engine": "gprmax", "errors": False},
            "`errors` does nothing where gprmax makes the output, got False",
            marks=needs("flgpr_exchange"),
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        simulate_lane(tmp_path / "scene.toml", **options)
    assert not list(tmp_path.iterdir())


def test_options_of_lanes_are_refused_beside_bodies():
    with pytest.raises(ValueError, match="`seed` does nothing where bodies are listed, got 3"):
        simulate_lane("signature", seed=3)
    with pytest.raises(ValueError, match="`cells` does nothing where a body is computed, got 3"):
        simulate_lane("signature", "tm-62p", cells=3.0)


def test_what_a_scene_can_hardly_mean_and_errors_that_do_nothing_are_told(tmp_path):
    scene = tmp_path / "scene.toml"
    sensor = tmp_path / "sensor.toml"
    scene.write_text(YARD + '[[targets]]\nkind = "metal"\nx = 9.0\ny = 2.0\n')
    sensor.write_text(LOW.format(height=4.0, kind="horn") + "[errors]\nringing_db = -10\n")
    doubt = "targets outside the lane, and not in the truth: 1 (T001)"
    idle = "errors.ringing_db = -10.0 does nothing without ringing_frequencies"
    asked = {"sensor": str(sensor), "output": tmp_path / "yard.zarr"}
    assert simulate_lane(scene, **asked).lines == [doubt, idle]
    assert simulate_lane(scene, preview=tmp_path / "yard.png").lines == [doubt]


def test_bodies_are_listed_where_none_is_named():
    listed = simulate_lane("signature")
    assert listed.paths == []
    assert any("m19" in line for line in listed.lines)
    shown = call("simulate", "signature")
    assert shown.exit_code == 0, shown.output
    assert shown.stdout.splitlines() == listed.lines


def test_where_the_solvers_are_not_installed_a_signature_names_the_package_that_has_them(
    tmp_path, monkeypatch
):
    from flgpr.simulate.bodies import signature

    monkeypatch.delitem(vars(signature), "build_table", raising=False)
    monkeypatch.delattr(signature, "__getattr__")
    failed = call("simulate", "signature", "tm-62p", "-o", tmp_path / "tm-62p.npz")
    assert failed.exit_code == 2
    assert "package flgpr_ground" in failed.stderr
    assert not (tmp_path / "tm-62p.npz").exists()


LOW = """name = "low"
source = "test"
polarization = ["HH"]
height = {height}
tx = [[-0.4, 0.0, 0.0]]
rx = [[0.4, 0.0, 0.0]]
[tones]
start = 0.6e9
step = 7e6
count = 100
[antenna]
kind = "{kind}"
"""
YARD = 'site = "gravel"\nlength = 8.0\n[surface]\ndensity = 2.0\n[track]\npositions = [0.0]\n'


@pytest.mark.parametrize(
    ("height", "kind", "words"),
    [
        (1.0, "dipole", ["the echo of the mean surface", "lower than 3 m"]),
        (1.0, "horn", ["the echo of the mean surface", "horns' pattern is -20 dB"]),
        (4.0, "horn", []),
    ],
)
def test_what_is_simulated_below_a_low_array_is_told(tmp_path, height, kind, words):
    scene = tmp_path / "scene.toml"
    sensor = tmp_path / "sensor.toml"
    scene.write_text(YARD)
    sensor.write_text(LOW.format(height=height, kind=kind))
    made = simulate_lane(scene, output=tmp_path / "yard.zarr", sensor=str(sensor))
    told = "\n".join(made.lines)
    assert all(word in told for word in words)
    assert bool(told) == bool(words)
