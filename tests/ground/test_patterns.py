"""Columns of the patch about an alarm: what they are of, what dictionaries learn from, and from nothing else."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sklearn.metrics import roc_auc_score

import flgpr
from few_mines import counts_of
from flgpr.detect.scorers.checks import Checked
from flgpr.method.detection import rank_alarms
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detect, engine_of
from flgpr.method.model import Model, load_model, save_model
from flgpr.method.sections import Section, lane_threshold
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.screen.views import grid_of
from flgpr.stages import TrainingView
from flgpr.stages.named import find_stage
from flgpr.stages.too_few import TooFewExamplesError
from flgpr.store import save_run
from flgpr_ground.entries import packaged_entries
from flgpr_ground.features.patch_descriptors import hog, lbp_histograms, normalize_by_border
from flgpr_ground.ground import load_ground
from flgpr_ground.stages.patterns import (
    FisherSettings,
    FisherVectors,
    Hog,
    HogSettings,
    Lbp,
    LbpSettings,
    VisualWords,
    WordSettings,
)
from small_lane import LANE, LANE_TOML, TARGETS, small_recipe, small_run

X = np.round(np.arange(-3, 3.05, 0.1), 9)
Y = np.round(np.arange(0, 20.05, 0.1), 9)
AREA = Lane(-1.5, 1.5, 1.5, 18.5)
TRUTH = pd.DataFrame({"x": [0.2, -0.6, 0.9], "y": [4.0, 9.0, 14.0], "kind": "metal"})
SMALL = {"most": 600, "directions": 6}
WORDS = WordSettings(words=12, **SMALL)
MIXTURE = FisherSettings(gaussians=5, **SMALL)


def view_of(seed=0, polarization=("HH", "VV"), bright=TRUTH):
    """Two sub-bands of Rayleigh clutter; targets are wide peaks."""
    rng = np.random.default_rng(seed)
    values = rng.rayleigh(1.0, (len(polarization), 2, Y.size, X.size))
    for x, y in bright[["x", "y"]].to_numpy():
        values += 6 * np.exp(-((X - x) ** 2 + (Y[:, None] - y) ** 2) / 0.15)
    coords = {"polarization": list(polarization), "subband": ["F1", "F2"], "y": Y, "x": X}
    return xr.DataArray(values.astype(np.float32), dims=tuple(coords), coords=coords)


def training(seed=0, truth=TRUTH):
    return TrainingView(view_of(seed), truth, AREA)


def places(count=20, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1.5, 1.5, count), rng.uniform(0, 20, count)])


def matrix(columns):
    return np.column_stack(list(columns.values()))


LEARNING = [(VisualWords, WORDS), (FisherVectors, MIXTURE)]
STATIC = [(Hog, HogSettings()), (Lbp, LbpSettings())]


def made(stage_class, settings, learnt=None):
    if stage_class.learns and learnt is None:
        learnt, _ = stage_class.fit(settings, [training(1), training(2)])
    return stage_class(settings, None, learnt)


def test_static_columns_are_the_descriptors_of_the_patch():
    view = view_of()
    row = 90
    column = 24
    place = [[X[column], Y[row]]]
    patch = view.values[:, 1, row - 12 : row + 13, column - 12 : column + 13].astype(float)
    patch = normalize_by_border(patch, np.ones_like(patch, dtype=bool))
    columns = Hog(HogSettings(subband="F2"), None).of_view(view, np.array(place))
    assert list(columns)[143:145] == ["hog_HH_143", "hog_VV_000"]
    np.testing.assert_allclose(matrix(columns)[0], hog(patch, 8).ravel(), atol=1e-5)
    only = LbpSettings(subband="F2", polarizations=("VV",))
    columns = Lbp(only, None).of_view(view, np.array(place))
    assert list(columns)[-1] == "lbp_VV_089"
    np.testing.assert_allclose(matrix(columns)[0], lbp_histograms(patch[1], 3), atol=1e-9)


def test_the_columns_of_the_learnt_ones_are_numbered_by_pool():
    words = made(VisualWords, WORDS).of_view(view_of(), places(3))
    assert list(words) == [f"word_{pool}_{number:02d}" for pool in range(4) for number in range(12)]
    np.testing.assert_allclose((matrix(words) ** 2).reshape(3, 4, 12).sum(axis=-1), 1.0)
    fisher = made(FisherVectors, MIXTURE).of_view(view_of(), places(3))
    assert list(fisher)[:2] == ["fisher_0_00", "fisher_0_01"]
    vectors = matrix(fisher).reshape(3, 4, 2 * 5 * 6)
    np.testing.assert_allclose((vectors**2).sum(axis=-1), 1.0)


@pytest.mark.parametrize(("stage_class", "settings"), [*STATIC, *LEARNING])
@pytest.mark.parametrize("polarizations", [(), ("VV",)])
def test_columns_are_counted_before_there_is_a_run_view(stage_class, settings, polarizations):
    settings = settings.model_copy(update={"polarizations": polarizations})
    columns = made(stage_class, settings).of_view(view_of(), places(1))
    count = stage_class.column_count(settings, 2, grid_of(view_of()))
    assert count == len(columns)


@pytest.mark.parametrize(("stage_class", "settings"), [*STATIC, *LEARNING])
def test_columns_do_not_depend_on_which_alarms_are_asked_for_together(stage_class, settings):
    stage = made(stage_class, settings)
    points = places(150)  # more than are described at once, some at the border
    every = matrix(stage.of_view(view_of(), points))
    assert np.isfinite(every).all()
    some = matrix(stage.of_view(view_of(), points[140:]))
    np.testing.assert_allclose(some, every[140:], rtol=1e-9, atol=1e-12)
    none = stage.of_view(view_of() * np.nan, np.zeros((0, 2)))
    assert list(none) == list(stage.of_view(view_of(), points[:1]))
    assert all(column.shape == (0,) for column in none.values())
    # A factor on all magnitudes says nothing.
    louder = matrix(stage.of_view(view_of() * 8, points[:20]))
    np.testing.assert_allclose(louder, every[:20], atol=1e-6)


@pytest.mark.parametrize(("stage_class", "settings"), [*STATIC, *LEARNING])
def test_what_no_scan_saw_says_nothing(stage_class, settings):
    """Pixels without a magnitude count as ground like the border, not as a dark edge."""
    stage = made(stage_class, settings)
    blind = view_of() * np.nan
    features = matrix(stage.of_view(blind, places(2)))
    assert np.isfinite(features).all()
    np.testing.assert_array_equal(features[0], features[1])


@pytest.mark.parametrize(("stage_class", "settings"), LEARNING)
def test_a_dictionary_is_learnt_from_its_lanes_without_their_truth(stage_class, settings):
    learnt, notes = stage_class.fit(settings, [training(1), training(2)])
    again, _ = stage_class.fit(settings, [training(1), training(2)])
    nobody = TRUTH.iloc[:0]
    unlabelled, _ = stage_class.fit(settings, [training(1, nobody), training(2, nobody)])
    others, _ = stage_class.fit(settings, [training(1), training(3)])
    for name, array in learnt.items():
        np.testing.assert_array_equal(again[name], array)
        np.testing.assert_array_equal(unlabelled[name], array)
        assert not np.array_equal(others[name], array)
    assert stage_class.targets_used_for_training(settings, [training(1)]) == []
    assert 550 < notes["windows"] <= settings.most
    assert 40 < notes["patches"] < 80


@pytest.mark.parametrize(("stage_class", "settings"), LEARNING)
def test_a_dictionary_comes_back_from_a_model(tmp_path, stage_class, settings):
    learnt, _ = stage_class.fit(settings, [training(1)])
    name = f"features.{stage_class.__name__}"
    save_model(Model(stages={name: learnt}), tmp_path / "model")
    restored = load_model(tmp_path / "model").stages[name]
    before = matrix(stage_class(settings, None, learnt).of_view(view_of(), places(4)))
    after = matrix(stage_class(settings, None, restored).of_view(view_of(), places(4)))
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize(("stage_class", "settings"), LEARNING)
def test_other_polarizations_than_those_of_training_are_refused(stage_class, settings):
    stage = made(stage_class, settings)
    with pytest.raises(ValueError, match=r"trained on 1 polarizations of \d+ components, as"):
        stage.of_view(view_of(polarization=["HH"]), places(2))
    other = stage_class(settings.model_copy(update={"polarizations": ("HV",)}), None, stage.learnt)
    with pytest.raises(ValueError, match="polarization must be one of HH, VV, got 'HV'"):
        other.of_view(view_of(), places(2))


@pytest.mark.parametrize(
    ("stage", "entry"), [("visual-words", "words"), ("fisher-vectors", "gaussians")]
)
def test_too_few_windows_are_told_with_a_smaller_dictionary(stage, entry):
    stage_class = find_stage("features", stage)
    settings = stage_class.Settings(**{entry: 200, "most": 40})
    with pytest.raises(TooFewExamplesError) as error:
        stage_class.fit(settings, [training(1)])
    message = str(error.value.of_stage(f"features.{stage}"))
    assert f'{entry} = 40 in [[columns]] of stage "{stage}" (now 200)' in message.replace(
        "39", "40"
    )
    assert list(counts_of(message).values())[-1] == 40
    flat = TrainingView(view_of() * np.nan, TRUTH, AREA)
    with pytest.raises(TooFewExamplesError, match="200 windows or more, got 0"):
        stage_class.fit(settings, [flat])


@pytest.mark.parametrize(
    ("name", "entries", "words"),
    [
        ("hog", "cell = 2.0", "2 cells of 20 pixels"),
        ("visual-words", "window = 3.0", "window must be at most size"),
        ("visual-words", "words = 1", "words: input should be greater than or equal to 2"),
        (
            "fisher-vectors",
            "gaussians = 1000",
            "gaussians: input should be less than or equal to 256",
        ),
        ("lbp", "cell = 0.8", "cell"),
    ],
)
def test_entries_that_fit_no_patch_are_refused(name, entries, words):
    text = f'{PLAIN}\n[[columns]]\nstage = "{name}"\n{entries}\n'
    with pytest.raises(ValueError, match=words):
        ImagedRun(small_run(scans=3), parse_recipe(text), LANE).alarms()


PLAIN = small_recipe(3).replace("variants = true", "variants = false")
PATCH = "size = [1.1, 1.1]\n"
DICTIONARY = PATCH + "window = 0.5\ndirections = 5\nmost = 400\nradius = 0.4\n"
STAGES = {
    "hog": PATCH + "cell = 0.5\n",
    "lbp": PATCH,
    "visual-words": DICTIONARY + "words = 9\n",
    "fisher-vectors": DICTIONARY + 'local = "pixels"\ngaussians = 4\n',
}
PREFIX = {"hog": "hog", "lbp": "lbp", "visual-words": "word", "fisher-vectors": "fisher"}


def recipe_of(name):
    detector = f'[detector]\nestimator = "svm"\nfeatures = ["{PREFIX[name]}_*"]\n'
    options = '[detector.options]\nkernel = "linear"\n'
    return f'{PLAIN}\n[[columns]]\nstage = "{name}"\n{STAGES[name]}\n{detector}{options}'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A lane of three mines with its truth, and the recipes of the four stages."""
    folder = tmp_path_factory.mktemp("patterns")
    save_run(small_run(), folder / "run.zarr")
    truth = pd.DataFrame({"x": TARGETS[:, 0], "y": TARGETS[:, 1], "kind": "metal"})
    truth.assign(target_id=["a", "b", "c"], depth=0.0).to_csv(folder / "truth.csv", index=False)
    (folder / "lane.toml").write_text(LANE_TOML)
    for name in STAGES:
        (folder / f"{name}.toml").write_text(recipe_of(name))
    return folder


def trained(folder, name, output, workers=1):
    return flgpr.train(
        [folder / "run.zarr"],
        [folder / "truth.csv"],
        folder / f"{name}.toml",
        folder / output,
        lanes=[folder / "lane.toml"],
        workers=workers,
    )


@pytest.mark.parametrize("name", STAGES)
def test_an_svm_is_trained_on_them_and_ranks(folder, name):
    model = trained(folder, name, f"model-{name}")
    count = len([one for one in model.detector.features if one.startswith(PREFIX[name])])
    assert count == len(model.detector.features) > 8
    recipe = load_recipe(folder / f"{name}.toml")
    loaded = load_model(folder / f"model-{name}")
    found = detect(small_run(), recipe, LANE, model=loaded)
    assert (np.diff(found.alarms["confidence"]) <= 0).all()
    # What it was trained on it tells apart: alarms of the lane within 1 m of a target, and others.
    alarms = found.alarms[LANE.contains(found.alarms["x"], found.alarms["y"])]
    offsets = alarms[["x", "y"]].to_numpy()[:, None] - TARGETS
    is_hit = np.hypot(offsets[..., 0], offsets[..., 1]).min(axis=1) <= 1.0
    assert roc_auc_score(is_hit, alarms["confidence"]) > 0.9


@pytest.mark.slow("trains three times")
def test_a_model_is_the_same_with_two_workers_and_made_anew(folder):
    name = "visual-words"
    trained(folder, name, "one")
    trained(folder, name, "two", workers=2)
    trained(folder, name, "three")
    first = (folder / "one" / "model.bundle").read_bytes()
    assert (folder / "two" / "model.bundle").read_bytes() == first
    assert (folder / "three" / "model.bundle").read_bytes() == first


def test_a_model_s_dictionary_is_that_of_its_training_lane(folder):
    model = trained(folder, "fisher-vectors", "own")
    recipe = load_recipe(folder / "fisher-vectors.toml")
    lane = ImagedRun(small_run(), parse_recipe(PLAIN), LANE, explains=False)
    engine_of(lane).run()
    example = TrainingView(lane.view(), TRUTH, LANE)
    settings = recipe.named()["features.fisher-vectors"].settings
    learnt, notes = FisherVectors.fit(settings, [example])
    assert model.notes["features.fisher-vectors"] == notes
    for name, array in model.stages["features.fisher-vectors"].items():
        np.testing.assert_array_equal(learnt[name], array)


def test_sections_rank_alike(folder):
    recipe = load_recipe(folder / "hog.toml")
    model = trained(folder, "hog", "sections")
    whole = ImagedRun(small_run(), recipe, LANE, explains=False, model=model)
    engine_of(whole).run()
    alarms = rank_alarms(whole).alarms
    known = whole.results["alarms"]
    rows = whole.grid.ny
    maxima = pd.DataFrame({name: known[f"maximum|{name}"] for name in ("x", "y", "magnitude")})
    threshold = lane_threshold(recipe, LANE, maxima, int(known["seen"]))
    parts = []
    for section in (Section(0, rows // 2, threshold), Section(rows // 2, rows, threshold)):
        part = ImagedRun(small_run(), recipe, LANE, section=section, explains=False, model=model)
        engine_of(part).run()
        parts.append(rank_alarms(part).alarms)
    table = pd.concat(parts).sort_values(["y", "x"])
    want = alarms.sort_values(["y", "x"])
    columns = ["x", "y", "confidence"]
    np.testing.assert_allclose(table[columns], want[columns], rtol=1e-4, atol=1e-4)


def test_the_entries_share_the_alarms_of_wang2007_and_read_their_own_columns_alone():
    entries = packaged_entries(load_ground(False))
    plain = parse_recipe(entries["wang2007"].text)
    for name in ("hog-svm", "lbp-svm", "bag-of-words", "fisher-vector"):
        recipe = parse_recipe(entries[name].text)
        same = {"columns": plain.columns, "detector": plain.detector}
        assert recipe.model_copy(update=same) == plain
        (stage,) = recipe.columns
        assert stage.settings.subband == plain.prescreen.subband
        prefix = PREFIX[stage.stage]
        assert recipe.detector.features == (f"{prefix}_*",)
        assert recipe.detector.estimator == "svm"


def test_a_model_of_another_spacing_is_refused_before_it_works():
    learnt, _ = VisualWords.fit(WORDS, [training(1)])
    setup = SimpleNamespace(view=SimpleNamespace(dx=0.05), imaged=[0, 1])
    with pytest.raises(ValueError, match=r"'mean' must have 196 components of each of 1 to 2"):
        VisualWords.check_learnt(WORDS, setup, Checked({}, learnt))
