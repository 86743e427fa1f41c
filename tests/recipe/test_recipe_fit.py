"""Steps of tones that let echoes from before an image appear in it: told, not refused, with what to change."""

import itertools
import re
from importlib import resources

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.run_report import run_info
from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.live.detector import LiveDetector
from flgpr.model import Sensor, load_sensor, make_run, sensor_presets
from flgpr.recipe.fit import alias_faults, check_fit, fit_faults
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.simulate import Scene
from flgpr.store import Scan, describe_for_live, open_run, sample_lane, save_run

RECIPES = sorted(
    file.name.removesuffix(".toml")
    for file in (resources.files("flgpr.recipe") / "packaged").iterdir()
    if file.name.endswith(".toml")
)
FAR_IMAGES = {"flsar2004", "fuse2018-wang2007", "fused", "fused3", "wang2007", "wang2007-printed"}
"""Their images end 22 and 26 m ahead; the full-wave array's 7.5 MHz keep 40 m of path apart, for images of 7 m."""
LONG_SUMS = {"fuse2018-printed"}
"""The earliest of five frames is 4 m behind: 19 m ahead of it with 10 m to the side are 44 m of path."""
FULL_WAVE = ("full-wave", "full-wave-echo")
EXPECTED = set(itertools.product(FULL_WAVE, FAR_IMAGES | LONG_SUMS))


@pytest.mark.parametrize(("preset", "recipe"), list(itertools.product(sensor_presets(), RECIPES)))
def test_packaged_radars_keep_packaged_recipes_images_clear(preset, recipe):
    sensor = load_sensor(preset)
    tx, rx = (side + [0.0, 0.0, sensor.height] for side in sensor.pairs())
    behind = (load_recipe(recipe).image.summed - 1) * 1.1
    fault, doubt = alias_faults(load_recipe(recipe), sensor.tones.axis(), tx, rx, behind)
    assert fault == ""
    assert bool(doubt) == ((preset, recipe) in EXPECTED)


@pytest.mark.parametrize("recipe", ["demo", "miniature"])
def test_the_packaged_lane_is_clear(recipe):
    check_fit(open_run(sample_lane() / "run.zarr"), load_recipe(recipe))


def bare_run(step, height=3.5, scans=3, apart=1.0):
    """A run without echoes over 1.3 GHz, in steps (Hz)."""
    antennas = np.zeros((4, 3))
    pose = np.zeros((scans, 6))
    antennas[:, 0] = np.linspace(-1, 1, 4)
    pose[:, 1] = apart * np.arange(scans)
    pose[:, 2] = height
    tones = 0.3e9 + step * np.arange(round(1.3e9 / step) + 1)
    return make_run(
        np.zeros((scans, 2, 4, tones.size)), tones, ("HH", "VV"), antennas, antennas, pose
    )


def image_to(y, frames=1):
    """Write a recipe with an image from 8 to ``y`` metres ahead, in one band."""
    return parse_recipe(text_to(y, frames))


def text_to(y, frames=1):
    return f"""
name = "far"
description = "far"
[image]
x = [-2.0, 2.0]
y = [8.0, {y}]
spacing = 0.1
window = "hann"
frames = {frames}
[image.subbands]
all = [0.3e9, 1.6e9]
[background]
self_signature = "none"
[run_view]
x = [-2.0, 2.0]
spacing = 0.1
y_max = 9.0
[prescreen]
polarization = "HH"
subband = "all"
radius = 0.5
density = 0.75
[contrast]
polarization = "HH"
subband = "all"
size = 5
spacing = 0.1
inner = [1, 1]
guard = [3, 3]
[lane]
x_min = -1.0
x_max = 1.0
y_min = 8.0
y_max = 11.0
[score]
halo = 1.0
area = "union"
"""


def test_what_is_told_is_what_mends_it():
    run = bare_run(8e6)
    with pytest.warns(
        UserWarning, match=r"image\.y should end where paths are shorter than 37\.\d+ m, got 22 m"
    ) as told:
        check_fit(run, image_to(22.0))
    (words,) = [str(one.message) for one in told]
    end, step = (
        float(re.search(rf"{before} ([\d.]+)", words)[1])
        for before in ("end it at", "steps of at most")
    )
    check_fit(run, image_to(end))
    check_fit(bare_run((step - 0.01) * 1e6), image_to(22.0))
    assert fit_faults(run, image_to(end + 0.05))[1]
    assert fit_faults(bare_run((step + 0.05) * 1e6), image_to(22.0))[1]


def test_an_image_that_shows_an_echo_twice_is_refused():
    with pytest.raises(
        ValueError,
        match=r"image\.y must end .* again where it is far; end it at [\d.]+ m, or record",
    ):
        check_fit(bare_run(12e6), image_to(24.0))


def test_tones_that_were_thinned_count_as_they_are():
    fine = bare_run(2.5e6)
    check_fit(fine, image_to(22.0))
    with pytest.warns(UserWarning, match="repeat after 39.97 m"):
        check_fit(fine.isel(frequency=slice(None, None, 3)), image_to(22.0))


def test_earlier_scans_of_a_coherent_sum_lie_farther_behind():
    run = bare_run(8e6, scans=6)
    check_fit(run, image_to(17.0))
    with pytest.warns(UserWarning, match="got 17 m"):
        check_fit(run, image_to(17.0, frames=4))


def test_a_fitted_recipe_is_clear_where_steps_bound_it():
    for step in (10e6, 13e6, 14e6):
        run = bare_run(step)
        check_fit(run, parse_recipe(fit_recipe(run)))


@pytest.mark.filterwarnings("default")
def test_the_command_line_tells_it_once_and_detects(tmp_path):
    run = bare_run(8e6)
    run["signal"].values[:] = np.random.default_rng(1).normal(size=run["signal"].shape)
    save_run(run, tmp_path / "run.zarr")
    (tmp_path / "far.toml").write_text(text_to(22.0))
    command = [
        "detect",
        tmp_path / "run.zarr",
        "-o",
        tmp_path / "result",
        "--recipe",
        tmp_path / "far.toml",
        "--quiet",
    ]
    done = CliRunner().invoke(app, list(map(str, command)))
    assert done.exit_code == 0, done.output
    assert done.stderr.count("echoes repeat after 37.47 m of path") == 1
    assert (tmp_path / "result" / "alarms.csv").is_file()
    looked = run_info(tmp_path / "run.zarr", tmp_path / "far.toml")
    assert "echoes repeat" in str(looked)


def test_a_footprint_beyond_what_the_tones_keep_apart_is_told_and_simulated(tmp_path):
    parts = load_sensor("full-wave").model_dump() | {"footprint": (-2.0, 2.0, 0.8, 6.5)}
    coarse = Sensor.model_validate(parts | {"tones": {"start": 442.5e6, "step": 30e6, "count": 36}})
    scene = Scene.model_validate(
        {"length": 6.0, "surface": {"density": 5.0}, "track": {"positions": [0.0]}}
    )
    with pytest.warns(
        UserWarning, match=r"tones\.step should be below 26\.6 MHz for the footprint .* got 30 MHz"
    ) as told:
        simulate_to_store(scene, coarse, 1, tmp_path / "lane.zarr")
    assert len(told) == 1
    assert open_run(tmp_path / "lane.zarr").sizes["scan"] == 1
    finer = parts["tones"] | {"step": 26e6, "count": 41}
    simulate_to_store(
        scene, Sensor.model_validate(parts | {"tones": finer}), 1, tmp_path / "finer.zarr"
    )


def live_to(y):
    return parse_recipe(text_to(y).replace('"none"', '"mean"'))


def test_live_detection_tells_it_once_when_the_height_is_known():
    run = bare_run(8e6)
    run["signal"].values[:] = np.random.default_rng(1).normal(size=run["signal"].shape)
    detector = LiveDetector(describe_for_live(run), live_to(22.0))
    scans = [Scan(k, float(k), run["pose"].values[k], run["signal"].values[k]) for k in range(3)]
    with pytest.warns(
        UserWarning, match=r"image\.y should end .* echoes repeat after 37\.47 m"
    ) as told:
        detector.add(scans[0])
    assert len(told) == 1
    for scan in scans[1:]:
        detector.add(scan)
    clear = LiveDetector(describe_for_live(run), live_to(15.0))
    clear.add(scans[0])
