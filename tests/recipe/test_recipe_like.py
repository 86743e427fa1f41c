"""A recipe like another one: what belongs to the array follows from the run, the method stays."""

import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.simulate import simulate_lane
from flgpr.model import load_sensor, make_run, sensor_presets
from flgpr.recipe.fit import check_fit
from flgpr.recipe.like import likeable_names
from flgpr.recipe.make import fit_recipe, recipe_for, sensor_for
from flgpr.recipe.schema import load_recipe, parse_recipe, recipe_names, recipe_text
from flgpr.store import open_run, read_table, sample_lane, save_run
from flgpr.toml_text import toml_value
from recipe.test_recipe_for_run import bare_run
from systems.lanes import SENSOR

LOW_TONES = 0.45e9 + 5e6 * np.arange(130)
ARRAY_ENTRIES = {
    "image": {"x", "y", "spacing", "subbands"},
    "background": {"self_signature", "median_step", "mean"},
    "map": {"sensor", "antennas", "polarizations", "step", "clear", "guard", "outer"},
    "run_view": {"x", "spacing", "y_max"},
    "prescreen": {"subband", "radius", "count"},
    "contrast": {"polarization", "subband", "size", "spacing", "inner", "guard"},
}
"""Entries of fused that a run may change."""


def run_of(sensor, scans=6, step=1.0):
    """Make a run without echoes that a sensor took."""
    tx, rx = sensor.pairs()
    tones = sensor.tones.axis()
    pose = np.zeros((scans, 6))
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = sensor.height
    shape = (scans, len(sensor.polarization), len(tx), len(tones))
    return make_run(np.zeros(shape, np.complex64), tones, sensor.polarization, tx, rx, pose)


def fused_for(run):
    """Fit fused to a run; the recipe must fit without a doubt."""
    recipe = parse_recipe(fit_recipe(run, like="fused"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_fit(run, recipe)
    return recipe


@pytest.mark.parametrize("name", sensor_presets())
def test_fused_fits_every_packaged_array_and_its_method_stays(name):
    recipe = fused_for(run_of(load_sensor(name)))
    table = recipe.map.settings
    same_array = {"full-wave-echo": "full-wave"}
    assert (table.sensor, table.antennas) == ("run", same_array.get(name, name))
    model = load_recipe("fused").model_dump(mode="json")
    fitted = recipe.model_dump(mode="json")
    for part, entries in model.items():
        if part in ("name", "description", "clutter") or entries is None:
            continue
        own, models = fitted[part], entries
        if part == "map":
            own, models = own["settings"], models["settings"]
        if not isinstance(models, dict):
            assert own == models, part
            continue
        for entry in set(models) - ARRAY_ENTRIES.get(part, set()):
            assert own[entry] == models[entry], f"{part}.{entry}"


def test_the_papers_array_gets_nearly_what_fused_has():
    recipe = fused_for(run_of(load_sensor("sri-array")))
    model = load_recipe("fused")
    assert list(recipe.image.subbands.values()) == [
        (0.45e9, 1.5e9),
        (0.45e9, 1.05e9),
        (0.9e9, 1.5e9),
    ]
    assert (recipe.image.x, recipe.image.spacing) == (model.image.x, model.image.spacing)
    assert recipe.contrast == model.contrast.model_copy(update={"subband": "F0"})
    assert recipe.prescreen.radius == model.prescreen.radius
    table, of_model = recipe.map.settings, model.map.settings
    for entry in ("clear", "inner", "guard", "outer", "blur", "own"):
        assert getattr(table, entry) == getattr(of_model, entry), entry


def test_comments_tell_what_was_taken_from_the_run():
    text = fit_recipe(open_run(sample_lane() / "run.zarr"), like="fused")
    lines = {line.split(" = ")[0]: line for line in text.splitlines() if " = " in line}
    fitted = ("x", "y", "self_signature", "sensor", "antennas", "y_max", "median_step", "clutter")
    for entry in (*fitted, "step", "clear", "guard", "outer", "mean", "radius", "count", "size"):
        assert "  # run: " in lines[entry], entry
    for entry in ("window", "kinds", "depths", "blur", "falloff", "density", "halo", "estimator"):
        assert "#" not in lines[entry], entry
    assert 'antennas = "full-wave"' in lines["antennas"]
    assert "flgpr recipe for --like fused" in text
    assert text == fit_recipe(open_run(sample_lane() / "run.zarr"), like="fused")


@pytest.mark.parametrize("like", [None, "fused"])
def test_tones_at_the_edges_of_sub_bands_stay_in_them(like):
    # More digits than a recipe used to have; the lowest tone is above its own rounded value.
    tones = 0.7500000001234567e9 + 5000000.123 * np.arange(130)
    tones[-1] = np.nextafter(tones[-1], np.inf)
    bands = parse_recipe(fit_recipe(bare_run(tones=tones), like=like)).image.subbands.values()
    assert min(low for low, _ in bands) == tones[0]
    assert max(high for _, high in bands) == tones[-1]


@pytest.mark.parametrize(
    ("frequency", "text"),
    [(1e9, "1e9"), (0.45e9, "0.45e9"), (1.5e10, "15e9"), (1e6, "0.001e9"), (1e9 / 3, None)],
)
def test_a_frequency_is_written_so_that_it_is_read_again(frequency, text):
    written = toml_value(frequency)
    assert float(written) == frequency
    assert text is None or written == text


def test_neither_path_nor_name_of_the_model_ends_a_comment(tmp_path):
    path = tmp_path / "a\nfoo = 1\x1b.toml"
    text = recipe_text("fused").replace('name = "fused"', 'name = "fu\\nsed\\u007f = 1"')
    path.write_text(text)
    fitted = fit_recipe(bare_run(tones=LOW_TONES), like=path)
    assert parse_recipe(fitted).name == "fu\nsed\x7f = 1-fitted"
    assert "all others are those of fu\\nsed\\x7f = 1, see" in fitted
    assert fitted.count("a\\nfoo = 1\\x1b.toml") == 2


def test_an_array_of_its_own_assumes_the_antennas_and_says_so():
    text = fit_recipe(bare_run(tones=LOW_TONES), like="fused")
    assert 'antennas = "sri-array"  # assumed' in text


@pytest.mark.parametrize(
    ("labels", "measured", "contrast"),
    [(("VV",), ("VV",), "VV"), (("HH",), ("HH",), "HH"), (("HV",), ("HV",), "HV")],
)
def test_a_single_polarization_is_all_that_is_read(labels, measured, contrast):
    recipe = fused_for(bare_run(polarization=labels, tones=LOW_TONES))
    assert recipe.map.settings.polarizations == measured
    assert recipe.contrast.polarization == contrast


def test_a_single_transmitter_gets_a_recipe():
    receivers = [[x, 0.0, 0.0] for x in np.linspace(-1, 1, 8)]
    pose = np.zeros((6, 6))
    pose[:, 1] = np.arange(6)
    pose[:, 2] = 2.0
    signal = np.zeros((6, 2, 8, LOW_TONES.size), np.complex64)
    run = make_run(signal, LOW_TONES, ["HH", "VV"], [[0.0, 0.0, 0.0]] * 8, receivers, pose)
    assert list(fused_for(run).image.subbands) == ["F0", "F1", "F2"]
    sensor = sensor_for(run)
    assert (len(sensor.tx), len(sensor.rx), sensor.scanned) == (1, 8, False)


ALL_LOW = {"F0": (0.45, 1.095), "F1": (0.45, 0.8186), "F2": (0.7264, 1.095)}


@pytest.mark.parametrize(
    ("height", "tones", "bands"),
    [
        (5.0, LOW_TONES, ALL_LOW),
        (2.0, LOW_TONES, ALL_LOW),
        (2.0, 0.9e9 + 5e6 * np.arange(500), {"F0": (0.9, 1.5), "F1": (0.9, 1.2429), "F2": (1.1571, 1.5)}),
        (0.8, 0.75e9 + 5e6 * np.arange(400), {"F0": (0.75, 1.5)}),
        (0.8, 0.9e9 + 5e6 * np.arange(400), {"F0": (0.9, 1.5677)}),
        (2.0, 8e9 + 5e6 * np.arange(400), {"F0": (8.0, 9.995), "F1": (8.0, 9.14), "F2": (8.855, 9.995)}),
        (2.0, 8e9 + 5e6 * np.arange(80), {"F0": (8.0, 8.395)}),
        (2.0, 1e9 + 5e6 * np.arange(20), {"F0": (1.0, 1.095)}),
        (0.7, 1e9 + 30e6 * np.arange(12), {"F0": (1.0, 1.33)}),
        (2.0, np.append(0.3e9 + 5e6 * np.arange(40), 2e9 + 5e6 * np.arange(40)), {"F0": (0.45, 0.495)}),
    ],
    ids=["its own", "its own, low", "higher", "very low", "higher, very low", "far higher",
         "high and narrow", "narrow", "coarse", "in two pieces"],
)  # fmt: skip
def test_sub_bands_are_the_lowest_tones_and_their_parts_where_these_are_wide_enough(
    height, tones, bands
):
    recipe = fused_for(bare_run(height, ("HH", "VV"), tones))
    found = {name: np.array(band) / 1e9 for name, band in recipe.image.subbands.items()}
    assert list(found) == list(bands)
    for name, band in bands.items():
        np.testing.assert_allclose(found[name], band, atol=5e-4)
    assert recipe.prescreen.subband == ("all" if len(bands) > 1 else "F0")
    assert recipe.contrast.subband in bands


@pytest.mark.parametrize("height", [0.8, 1.5, 3.0, 5.0, 8.0])
@pytest.mark.parametrize("start", [0.3e9, 0.45e9, 0.75e9])
def test_a_range_cell_is_shorter_than_the_gap_after_the_grounds_echo(height, start):
    run = bare_run(height, ("HH", "VV"), start + 5e6 * np.arange(500))
    recipe = fused_for(run)
    assert recipe.image.y[0] == pytest.approx(0.8 * height, abs=0.03)
    gap = 2 * (np.hypot(height, 0.8 * height) - height)
    narrowest = min(high - low for low, high in recipe.image.subbands.values())
    cell = 299792458.0 / narrowest
    assert cell <= min(gap, 2 * recipe.map.settings.outer)
    assert f"range cells of at most {cell:.2g} m, shorter than the gap" in fit_recipe(
        run, like="fused"
    )


def test_a_band_too_narrow_for_the_gap_is_said_and_keeps_what_it_had():
    run = bare_run(2.0, ("HH", "VV"), 1e9 + 5e6 * np.arange(20), step=0.1)
    text = fit_recipe(run, like="fused")
    recipe = parse_recipe(text)
    assert "range cells of at most 3.2 m, but not shorter, for want of band, than the gap" in text
    assert (recipe.background.self_signature, recipe.clutter) == ("none", ())
    assert recipe.image.y[0] == pytest.approx(1.2 * 2.0)
    assert "not 0.8: nothing takes the ground's echo out" in text


@pytest.mark.parametrize(
    ("height", "expected"),
    [
        (5.0, (0.5, 1.2, 0.65, 1.55, 2.55, 2.5)),
        (1.5, (0.375, 0.6, 0.4, 0.65, 1.25, 1.3)),
        (0.8, (0.35, 0.5, 0.35, 0.45, 1.25, 1.3)),
        (9.0, (0.5, 1.2, 0.65, 1.55, 2.55, 2.5)),
    ],
)
def test_lengths_follow_the_height_from_fuseds_to_those_of_the_miniature(height, expected):
    recipe = fused_for(bare_run(height, ("HH", "VV"), 0.45e9 + 5e6 * np.arange(250)))
    table = recipe.map.settings
    patch = recipe.contrast.size * recipe.contrast.spacing
    lengths = (
        recipe.prescreen.radius,
        table.clear,
        table.guard,
        table.outer,
        recipe.background.mean,
    )
    assert lengths == pytest.approx(expected[:5])
    assert patch == pytest.approx(expected[5], abs=1.01 * recipe.contrast.spacing)
    assert table.inner == load_recipe("fused").map.settings.inner
    if height == 1.5:
        miniature = load_recipe("miniature")
        own = (miniature.prescreen.radius, miniature.background.mean)
        assert (recipe.prescreen.radius, recipe.background.mean) == own


def test_the_ground_s_echo_is_taken_out_where_no_self_signature_is():
    stands = bare_run(1.5, ("HH", "VV"), LOW_TONES, step=0.1)
    drives = bare_run(1.5, ("HH", "VV"), LOW_TONES, step=1.0)
    for like in ("fused", "wang2007", None):
        run = stands if like != "wang2007" else stands.isel(polarization=[0])
        recipe = parse_recipe(fit_recipe(run, like=like))
        assert [stage.stage for stage in recipe.clutter] == ["early"]
        assert recipe.background.self_signature == "none"
        assert not parse_recipe(fit_recipe(drives, like=like)).clutter


def test_a_model_that_takes_early_echoes_out_does_so_where_it_has_to(tmp_path):
    path = tmp_path / "early.toml"
    path.write_text(recipe_text("fused") + '\n[[clutter]]\nstage = "early"\n')
    stands = bare_run(1.5, ("HH", "VV"), LOW_TONES, step=0.1)
    recipe = parse_recipe(fit_recipe(stands, like=path))
    assert [stage.stage for stage in recipe.clutter] == ["early"]
    assert not parse_recipe(fit_recipe(bare_run(1.5, ("HH", "VV"), LOW_TONES), like=path)).clutter
    path.write_text(recipe_text("fused") + '\n[[clutter]]\nstage = "early"\npath = 3.0\n')
    with pytest.raises(ValueError, match=r"clutter\.early: its path is that of its own array"):
        fit_recipe(stands, like=path)


@pytest.mark.parametrize(("tones", "step"), [(0.3e9, 0.15), (0.75e9, 0.15), (3e9, 0.1)])
def test_the_step_of_a_chip_is_half_a_wavelength(tones, step):
    recipe = fused_for(bare_run(5.0, ("HH", "VV"), tones + 5e6 * np.arange(250)))
    assert recipe.map.settings.step == step


def test_images_are_as_wide_as_the_antennas_are_high():
    for height, half, view in ((0.8, 1.8, 1.8), (1.5, 1.8, 1.8), (3.0, 3.6, 3.0), (9.0, 6.0, 3.0)):
        recipe = fused_for(bare_run(height, ("HH", "VV"), LOW_TONES))
        assert recipe.image.x == pytest.approx((-half, half))
        assert recipe.run_view.x == pytest.approx((-view, view))


def test_lengths_of_a_model_whose_array_is_not_known_stay(tmp_path):
    run = bare_run(1.5, ("HH", "VV"), LOW_TONES)
    path = tmp_path / "own.toml"
    path.write_text(fit_recipe(bare_run(3.0, ("HH", "VV"), LOW_TONES), like="fused"))
    model = load_recipe(path)
    recipe = parse_recipe(fit_recipe(run, like=path))
    assert model.prescreen.radius == recipe.prescreen.radius == 0.425
    assert model.map.settings.outer == recipe.map.settings.outer


def test_too_few_tones_are_refused_with_the_rule():
    with pytest.raises(ValueError, match="frequency must hold neighbouring tones"):
        fit_recipe(bare_run(tones=np.array([1e9])), like="fused")
    for tones in (1e9 + 200e6 * np.arange(10), np.array([0.3e9, 0.5e9])):
        with pytest.raises(ValueError, match=r"frequency must have tones at most [\d.]+ MHz apart"):
            fit_recipe(bare_run(tones=tones), like="fused")
    with pytest.raises(ValueError, match=r"frequency must have tones at most [\d.]+ MHz apart"):
        fit_recipe(bare_run(tones=0.5e9 + 50e6 * np.arange(20)), like="fused")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("demo", "features.roadside: it reads one sub-band of its own array"),
    ],
)
def test_a_recipe_that_no_rule_fits_is_refused_with_the_reason(name, reason):
    run = bare_run()
    with pytest.raises(
        ValueError, match=f"like must be a recipe that can be fitted .*{name}"
    ) as error:
        fit_recipe(run, like=name)
    assert reason in str(error.value)
    with pytest.raises(ValueError, match="recipe must be a TOML file or one of"):
        fit_recipe(run, like="nobodys")


def test_all_other_packaged_recipes_fit_an_array():
    names = likeable_names()
    assert {*PAPERS, "fuse2018-wang2007", "fused", "miniature"} <= set(names)
    assert set(names) < set(recipe_names())
    run = bare_run(1.0, ("HH", "VV", "VH"), 1e9 + 5e6 * np.arange(300))
    for name in names:
        recipe = parse_recipe(fit_recipe(run, like=name))
        check_fit(run, recipe)
        assert recipe.lane is None
        assert (recipe.features is None) == (load_recipe(name).features is None)
    assert "# Left out: [lane]" in fit_recipe(run, like="demo-mean-self-signature")


def test_windows_of_pixels_keep_their_lengths():
    run = bare_run(0.4, ("HH", "VV", "VH"), 1e9 + 5e6 * np.arange(300))
    recipe = parse_recipe(fit_recipe(run, like="wang2007"))
    model = load_recipe("wang2007")
    assert recipe.contrast.spacing < model.contrast.spacing
    for entry in ("inner", "guard"):
        ours = np.array(getattr(recipe.contrast, entry)) * recipe.contrast.spacing
        models = np.array(getattr(model.contrast, entry)) * model.contrast.spacing
        np.testing.assert_allclose(ours, models, atol=recipe.contrast.spacing)
    no_cross = parse_recipe(fit_recipe(run.isel(polarization=[0]), like="wang2007"))
    assert no_cross.features is None


PAPERS = ("cosgrove2004", "flsar2004", "wang2007", "fuse2018")


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("array", sensor_presets())
def test_the_method_of_a_paper_fits_every_array_that_has_its_polarizations(paper, array):
    sensor = load_sensor(array)
    run = run_of(sensor)
    needed = {"wang2007": {"VV"}, "fuse2018": {"VV", "HV"}}.get(paper, {"HH", "VV"})
    if not needed <= set(sensor.polarization):
        with pytest.raises(ValueError, match=r"it needs (HH, VV|VV, and VH or HV); this run has"):
            fit_recipe(run, like=paper)
        return
    recipe = parse_recipe(fit_recipe(run, like=paper))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_fit(run, recipe)
    model = load_recipe(paper)
    assert list(recipe.named()) == list(model.named())
    assert recipe.detector == model.detector
    low, high = recipe.image.y
    if paper == "cosgrove2004":
        cut = recipe.map.settings.length * recipe.image.steps[1]
        assert cut == pytest.approx(28 * 0.02, abs=recipe.image.steps[1])
    if paper == "flsar2004":
        ranges = recipe.run_view.ranges
        assert low < ranges[0] < ranges[-1] < recipe.run_view.y_max <= high
    if paper == "fuse2018":
        masks = recipe.clutter[-1].settings
        assert (masks.edges[0], masks.edges[-1]) == pytest.approx((low, high))
        assert recipe.image.x[1] == masks.roadside[1] >= 3.0 > masks.roadside[0] >= 2.0


def test_views_at_several_distances_need_scans_closer_than_these():
    with pytest.raises(
        ValueError, match=r"a look at 3 distances ahead, 2\.4 m apart; .* 9 m apart"
    ):
        fit_recipe(bare_run(1.5, ("HH", "VV"), LOW_TONES, step=9.0), like="flsar2004")


def test_a_rail_takes_no_map(tmp_path):
    poses = np.zeros((40, 6))
    poses[:, 0] = np.linspace(-2, 2, 40)
    poses[:, 2] = 1.0
    signal = np.zeros((40, 1, 1, LOW_TONES.size), np.complex64)
    rail = make_run(signal, LOW_TONES, ["HH"], [[0.0, 0, 0]], [[0.1, 0, 0]], poses)
    with pytest.raises(
        ValueError, match="like must be a recipe without a map, masks or views, got fus"
    ):
        fit_recipe(rail, like="fused")
    with pytest.raises(ValueError, match="got flsar2004: the radar moves across"):
        fit_recipe(rail, like="flsar2004")
    assert parse_recipe(fit_recipe(rail, like="wang2007")).image.frames == "all"
    with pytest.raises(ValueError, match="sensor must look ahead"):
        sensor_for(rail)


def test_a_recipe_of_another_array_names_the_way_to_one_that_fits():
    run = bare_run(2.0, ("HH", "VV"), 2e9 + 5e6 * np.arange(100))
    with pytest.raises(
        ValueError, match="`flgpr recipe for RUN --like fused` writes one that fits"
    ):
        check_fit(run, load_recipe("fused"))
    only_hh = bare_run(5.0, ("HH",), LOW_TONES)
    with pytest.raises(
        ValueError, match=r"map\.polarizations must be one the run has \(HH\), got 'VV'"
    ):
        check_fit(only_hh, load_recipe("fused"))


def flgpr(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


SCENE = """name = "lane"
site = "arid-sand"
x_min = -1.5
x_max = 1.5
length = 18.0
[surface]
density = 3.0
[clutter]
bushes = 0
posts = 0
rocks = 0
patches = 0
[[draws]]
kind = "metal"
depth = -0.1
count = 6
[track]
start = -5.0
step = [1.4, 1.6]
"""


@pytest.mark.slow("simulates lanes and trains")
def test_recipe_train_and_detect_on_lanes_of_the_runs_own_array(tmp_path):
    """The documented sequence: a field run, lanes of its array, a model, alarms."""
    (tmp_path / "sensor.toml").write_text(SENSOR.replace("count = 4", "count = 3"))
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "fused.toml").write_text(
        recipe_text("fused").replace('kinds = ["metal"]', 'kinds = ["metal"]\ncopies = 2')
        .replace("depths = [0.0, 0.05, 0.10, 0.15]", "depths = [0.0, 0.1]")
    )  # fmt: skip
    field = tmp_path / "field.zarr"
    simulate_lane(tmp_path / "scene.toml", sensor=tmp_path / "sensor.toml", seed=1, output=field)
    save_run(open_run(field).drop_attrs(), tmp_path / "own.zarr")  # it says nothing of its sensor

    own = tmp_path / "own.toml"
    flgpr("recipe", "for", tmp_path / "own.zarr", "--like", tmp_path / "fused.toml", "-o", own)
    assert "good" in flgpr("recipe", "check", own)
    assert own.read_text() == recipe_for(tmp_path / "own.zarr", like=tmp_path / "fused.toml")
    lane = tmp_path / "a.zarr"
    flgpr("simulate", tmp_path / "scene.toml", "--sensor", tmp_path / "own.zarr", "--seed", 2,
          "-o", lane)  # fmt: skip
    for name in ("tx_position", "rx_position", "frequency"):
        np.testing.assert_allclose(open_run(lane)[name].values, open_run(field)[name].values)
    truth = tmp_path / "a-truth.csv"
    train = ("train", lane, "--truth", truth, "--recipe", own, "-o", tmp_path / "model")
    assert "simulated lanes" not in flgpr(*train, "--no-check")
    assert "simulated lanes" not in flgpr("info", tmp_path / "model")
    bundle = (tmp_path / "model" / "model.bundle").read_bytes()
    told = flgpr(*train)  # the model is there; it is checked now
    assert "simulated lanes of your array this recipe finds" in told
    assert (tmp_path / "model" / "model.bundle").read_bytes() == bundle
    sentence = next(line for line in told.splitlines() if "simulated lanes" in line)
    assert f"  check          {sentence}\n" in flgpr("info", tmp_path / "model")
    assert sentence in flgpr(*train)
    flgpr("detect", tmp_path / "own.zarr", "--recipe", own, "--model", tmp_path / "model",
          "-o", tmp_path / "result")  # fmt: skip
    alarms = read_table(tmp_path / "result" / "alarms.csv", "alarms")
    mines = read_table(tmp_path / "field-truth.csv", "truth")
    off = np.hypot(mines["x"] - alarms["x"][0], mines["y"] - alarms["y"][0])
    assert off.min() < 1.0
    assert len(alarms) > 3


def test_the_sensor_of_a_low_array_sees_the_ground_below_it():
    low = sensor_for(bare_run(1.0, ("HH", "VV"), LOW_TONES))
    assert low.has_specular_echo
    assert low.has_direct_wave
    left, right, behind, ahead = low.ground_in_view
    auto = low.model_copy(update={"footprint": "auto"}).ground_in_view
    assert (left <= auto[0], right >= auto[1]) == (True, True)
    assert behind == auto[2] < 0 < 4 < ahead
    high = sensor_for(bare_run(4.0, ("HH", "VV"), LOW_TONES))
    assert not high.has_specular_echo
    assert high.ground_in_view[2] > 0
