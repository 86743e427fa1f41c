"""A recipe made from a run: it runs on very different arrays, and recipes that do not fit say what to change."""

import numpy as np
import pytest
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.method.method import detect
from flgpr.model import Sensor, load_sensor, make_run
from flgpr.recipe.fit import check_fit
from flgpr.recipe.make import fit_recipe, recipe_for, recipe_or_fitted
from flgpr.recipe.schema import lane_of, load_recipe, parse_recipe, recipe_text
from flgpr.simulate import Scene, simulate
from flgpr.store import open_run, save_run

HINT = "`flgpr recipe for RUN`"


def changed(name, **parts):
    return Sensor.model_validate(load_sensor(name).model_dump() | parts)


def across(width, count):
    return [(x, 0.0, 0.0) for x in np.linspace(-width / 2, width / 2, count)]


TALL = changed(
    "sri-array", rx=across(4.0, 5), tones={"start": 442.5e6, "step": 7.5e6, "count": 172}
)
X_BAND = changed(
    "dual-band-x", tx=across(2.17, 8), tones={"start": 8.4e9, "step": 10e6, "count": 101}
)
LOW = changed(
    "dual-band-l",
    polarization=["HH"],
    height=0.7,
    tx=across(2.0, 2),
    rx=across(1.6, 4),
    footprint=(-3.5, 3.5, 0.6, 6.0),
    tones={"start": 1e9, "step": 15e6, "count": 101},
)


def bare_run(
    height=2.0, polarization=("HH",), tones=None, scans=6, step=1.0, course=0.0, width=2.0
):
    """Make a run without echoes: geometry, tones and polarizations are all that a recipe is made of."""
    tones = 1e9 + 5e6 * np.arange(200) if tones is None else tones
    antennas = across(width, 4)
    pose = np.zeros((scans, 6))
    pose[:, 0] = course
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = height
    signal = np.zeros((scans, len(polarization), len(antennas), len(tones)))
    return make_run(signal, tones, polarization, antennas, antennas, pose)


@pytest.mark.slow("detects with three very different arrays")
@pytest.mark.parametrize(
    ("sensor", "step", "target", "polarization", "features"),
    [(TALL, 1.5, 12.0, "HH", True), (X_BAND, 1.0, 11.5, "VV", False), (LOW, 0.5, 3.0, "HH", False)],
    ids=["5 m high, 0.44 to 1.7 GHz", "3.4 m high, X band", "0.7 m high, one polarization"],
)
def test_metal_on_the_ground_is_the_first_alarm_of_very_different_arrays(
    sensor, step, target, polarization, features
):
    scene = Scene(
        site="arid-sand",
        length=target + 12.0,
        surface={"density": 3.0},
        clutter={"rocks": 0, "bushes": 0, "posts": 0, "patches": 0},
        targets=[{"kind": "metal", "x": 0.4, "y": target, "depth": -0.1}],
        track={"positions": tuple(step * scan for scan in range(6))},
    )
    run, _ = simulate(scene, sensor, 3)
    text = fit_recipe(run)
    recipe = parse_recipe(text)
    assert (recipe.prescreen.polarization, recipe.features is not None) == (polarization, features)
    assert recipe.image.y[0] == pytest.approx(0.8 * sensor.height, abs=0.1)
    first = detect(run, recipe).alarms.iloc[0]
    assert np.hypot(first["x"] - 0.4, first["y"] - target) < 0.5
    assert fit_recipe(run) == text


@pytest.mark.parametrize("height", [0.2, 0.7, 1.5, 5.0, 20.0])
@pytest.mark.parametrize("width", [0.0, 0.6, 8.0])
@pytest.mark.parametrize("start", [0.1e9, 0.5e9, 3e9, 16e9])
def test_the_recipe_fits_its_run(height, width, start):
    tones = start + 2e6 * np.arange(400)
    for step in (0.1, 2.0):
        run = bare_run(height, ("VV", "HH", "VH"), tones, step=step, width=width)
        recipe = parse_recipe(fit_recipe(run))
        check_fit(run, recipe)
        assert recipe.image.y[0] < recipe.run_view.y_max < recipe.image.y[1]
        assert recipe.features is not None
        assert recipe.background.self_signature == ("mean" if step > 1 else "none")


def test_the_image_ends_where_the_steps_of_the_tones_say():
    free = parse_recipe(fit_recipe(bare_run(tones=1e9 + 5e6 * np.arange(200))))
    bound = bare_run(tones=1e9 + 18e6 * np.arange(56))
    recipe = parse_recipe(fit_recipe(bound))
    check_fit(bound, recipe)
    assert recipe.image.y[1] < free.image.y[1]
    with pytest.raises(
        ValueError, match=r"frequency must have tones at most [\d.]+ MHz apart.*got 30 MHz"
    ):
        fit_recipe(bare_run(tones=1e9 + 30e6 * np.arange(34)))


def test_where_the_road_was_driven_before_one_band_tells_up_to_where_grating_lobes_come():
    run = bare_run(polarization=("HH", "HV", "VV"), width=0.3)  # sin 50° = λ/2d at 1.957 GHz
    text = fit_recipe(run, again=True)
    recipe = parse_recipe(text)
    assert [stage.stage for stage in recipe.clutter] == ["earlier"]
    assert recipe.image.subbands["F0"] == pytest.approx((1e9, 1.9568e9), rel=1e-4)
    assert (recipe.prescreen.polarization, recipe.contrast.polarization) == ("VV", "VV")
    assert (recipe.contrast.subband, recipe.features, recipe.image.window) == ("F0", None, "hann")
    assert recipe.image.y[0] == pytest.approx(2.8)  # 1.4 heights of 2 m
    assert "Local contrast of what has changed" in text
    assert (
        "# all of the run's band, up to where grating lobes of the array come to 50 degrees" in text
    )
    check_fit(run, recipe)

    # Lobes that come near from the first tone on leave a range cell of 25 cm.
    wide = parse_recipe(fit_recipe(bare_run(width=2.0), again=True))
    assert wide.image.subbands["F0"] == pytest.approx((1e9, 1.6e9))
    like = parse_recipe(fit_recipe(run, like="wang2007", again=True))
    assert like.clutter[-1].stage == "earlier"
    assert like.contrast.polarization == load_recipe("wang2007").contrast.polarization


def test_subbands_divide_the_band_and_skip_gaps():
    tones = 1e9 + 5e6 * np.arange(501)
    bands = parse_recipe(fit_recipe(bare_run(tones=tones))).image.subbands
    assert list(bands) == ["F0", "F1", "F2", "F3", "F4"]
    assert bands["F0"] == (1e9, 3.5e9) == (bands["F1"][0], bands["F4"][1])
    widths = [high - low for low, high in list(bands.values())[1:]]
    assert min(widths) > 0.6e9
    np.testing.assert_allclose(widths, widths[0], rtol=1e-4)
    assert all(bands[f"F{n}"][1] > bands[f"F{n + 1}"][0] for n in (1, 2, 3))
    dual = np.concatenate([1e9 + 5e6 * np.arange(100), 9e9 + 5e6 * np.arange(100)])
    assert list(parse_recipe(fit_recipe(bare_run(tones=dual))).image.subbands.values()) == [
        (1e9, 1.495e9),
        (9e9, 9.495e9),
    ]
    with pytest.raises(ValueError, match="frequency must hold neighbouring tones"):
        fit_recipe(bare_run(tones=np.array([1e9])))


def test_a_course_beside_the_lanes_axis_and_missing_sweeps_are_seen():
    run = bare_run(course=40.0, scans=8, step=0.5)
    run["valid"][7] = False
    recipe = parse_recipe(fit_recipe(run))
    assert recipe.lane is None
    searched = lane_of(run, recipe)  # of a short run, too, all that two scans see
    assert (searched.x_min, searched.x_max) == (38.5, 41.5)
    assert searched.y_min == pytest.approx(recipe.image.y[0])
    assert searched.y_max == pytest.approx(2.5 + recipe.run_view.y_max)
    assert recipe.run_view.x == (37.6, 42.4)
    run["valid"][:] = False
    with pytest.raises(ValueError, match="scan without missing sweeps"):
        fit_recipe(run)
    with pytest.raises(
        ValueError,
        match=r"pose must put the antennas at least 0\.05 m above the ground, got 0 m: `flgpr image`",
    ):
        fit_recipe(bare_run(height=0.0))


FULL = bare_run(5.0, ("HH", "VV", "HV"), 0.75e9 + 2.5e6 * np.arange(841))


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (
            FULL.isel(polarization=[1]),
            ["prescreen.polarization must be one the run has (VV), got 'HH'", "features"],
        ),
        (
            FULL.isel(polarization=[0, 1]),
            [
                "does not fit the run: its features are of runs with HH, VV, and HV or VH, got a run with HH, VV"
            ],
        ),
        (
            FULL.isel(frequency=slice(0, 600)),
            ["image.subbands.F4 must lie in the run's band, 0.75 to 2.248 GHz, got 2.25"],
        ),
        (
            FULL.isel(frequency=slice(0, None, 5)),
            [
                "image.y must end where paths are shorter than 41.19 m",
                "got 26 m",
                "repeat after 23.98 m",
                "end it at 7.99 m",
            ],
        ),
    ],
    ids=["no HH", "no cross-polarized", "band too narrow", "tones too far apart"],
)
def test_a_recipe_that_does_not_fit_names_the_entry_and_the_remedy(run, words):
    recipe = load_recipe("wang2007")
    check_fit(FULL, recipe)
    with pytest.raises(ValueError) as error:
        check_fit(run, recipe)
    for word in words:
        assert word in str(error.value)
    assert str(error.value).endswith(f"{HINT} writes one that fits")
    with pytest.raises(ValueError, match="writes one that fits"):
        detect(run, recipe)


@pytest.mark.parametrize(
    ("height", "words"), [(1.0, "7 m for antennas 1 m high"), (15.0, "antennas 15 m high")]
)
def test_an_image_for_an_array_of_another_height_is_a_warning(height, words):
    run = bare_run(height, ("HH", "VV", "HV"), 0.75e9 + 2.5e6 * np.arange(841))
    with pytest.warns(
        UserWarning,
        match=rf"image\.y should begin 0\.5 to 3\.5 antenna heights ahead.*{words}.*{HINT}",
    ):
        check_fit(run, load_recipe("wang2007"))


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Two short runs of noise, with features."""
    home = tmp_path_factory.mktemp("runs")
    rng = np.random.default_rng(4)
    for name in ("a", "b"):
        run = bare_run(0.5, ("HH", "VV", "HV"), 1e9 + 15e6 * np.arange(50), width=1.0)
        run["signal"].values[:] = rng.normal(size=run["signal"].shape)
        save_run(run, home / f"{name}.zarr")
    return home


def test_the_command_line_writes_a_recipe_once_and_detects_with_it(stored, tmp_path):
    run = stored / "a.zarr"
    file = tmp_path / "own.toml"
    printed = call("recipe", "for", run)
    assert printed.exit_code == 0, printed.output
    assert call("recipe", "for", run, "-o", file).stdout == f"wrote {file}\n"
    assert file.read_text() == printed.stdout
    again = call("recipe", "for", run, "-o", file)
    assert again.exit_code == 0
    assert again.stderr.startswith(f"{file} exists already")
    changed = file.read_text() + "# by hand\n"
    file.write_text(changed)
    assert call("recipe", "for", run, "-o", file).stderr.startswith(
        f"error: output must not exist yet, got {file}"
    )
    assert file.read_text() == changed
    assert "good" in call("recipe", "check", file).stdout
    found = call("detect", run, "-o", tmp_path / "result")
    assert found.exit_code == 0, found.output
    assert (
        found.stdout.splitlines()[0]
        == f"no --recipe: detecting with the one that `flgpr recipe for {run}` prints"
    )
    assert (tmp_path / "result" / "recipe.toml").read_text() == printed.stdout
    assert (
        "no --recipe" not in call("detect", run, "-o", tmp_path / "other", "--recipe", file).stdout
    )


def test_a_model_needs_the_recipe_it_was_trained_with(stored, tmp_path):
    told = call("detect", stored / "a.zarr", "-o", tmp_path / "result", "--model", tmp_path)
    assert (told.exit_code, "recipe must be given with a model" in told.stderr) == (2, True)


def test_a_recipe_is_made_where_none_is_named(stored):
    run = stored / "a.zarr"
    assert recipe_or_fitted("demo", run, "model") == recipe_text("demo")
    assert recipe_or_fitted(None, run) == recipe_for(run)
    with pytest.raises(ValueError, match="recipe must be given with a model"):
        recipe_or_fitted(None, run, "model")


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line(stored, tmp_path):
    file = tmp_path / "far.toml"
    text = recipe_for(stored / "a.zarr")
    near = parse_recipe(text).image.y[0]
    file.write_text(
        text.replace(f"y = [{near}, ", "y = [2.0, ").replace("y_max = ", "y_max = 3 # ")
    )
    told = call("detect", stored / "a.zarr", "-o", tmp_path / "result", "--recipe", file, "--quiet")
    assert told.exit_code == 0, told.output
    assert [line[:30] for line in told.stderr.splitlines()] == ["warning: image.y should begin "]


def test_a_stopped_detection_without_a_recipe_goes_on(stored, tmp_path):
    def stop(report):
        if report["stage"] == "view":
            raise KeyboardInterrupt

    done = []
    with pytest.raises(KeyboardInterrupt):
        flgpr.detect(stored / "a.zarr", None, tmp_path / "result", report=False, note=stop)
    flgpr.detect(
        stored / "a.zarr",
        None,
        tmp_path / "result",
        report=False,
        note=lambda one: done.append(one["stage"]),
    )
    whole = flgpr.detect(stored / "a.zarr", None, tmp_path / "whole", report=False)
    assert "gain" not in done
    assert "features" in done
    assert (tmp_path / "result" / "alarms.csv").read_bytes() == (
        whole.folder / "alarms.csv"
    ).read_bytes()


def test_a_survey_takes_the_recipe_of_its_first_run(stored, tmp_path):
    runs = [stored / "a.zarr", stored / "b.zarr"]
    survey = flgpr.detect(runs, None, tmp_path / "survey", report=False)
    assert {(folder / "recipe.toml").read_text() for folder in survey.folders} == {
        recipe_for(runs[0])
    }
    # The lane of each follows from its own scans, however short the runs are.
    areas = [(result.lane.y_min, result.lane.y_max) for result in survey]
    recipe = parse_recipe(recipe_for(runs[0]))
    expected = lane_of(open_run(runs[1]), recipe)
    assert areas[1] == (expected.y_min, expected.y_max)
