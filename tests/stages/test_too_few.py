"""Training on too few mines: learning stages and detectors tell what was left, step by step, and what to change."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import flgpr
from alone import needs
from few_mines import counts_of, follow, resized
from flgpr.clutter import ThresholdCalibration
from flgpr.method.classifier import TrainingSet, train
from flgpr.method.estimators import train_estimator
from flgpr.model import Lane
from flgpr.recipe.tables import DetectorTable
from flgpr.stages import TrainingView
from flgpr.stages.clusters import subset
from flgpr.stages.named import find_stage
from flgpr.stages.too_few import TooFewExamplesError, count_in_views

RIVAL = needs("flgpr_ground")

NO_MINES = "target_id,x,y,kind,depth,radius,height,lane\n"
OUT_OF_SIGHT = (
    NO_MINES
    + "T001,0.0,300.0,metal,-0.15,0.16,0.15,lane\nT002,0.0,310.0,metal,-0.15,0.16,0.15,lane\n"
)
AREA = Lane(-1.5, 1.5, 0.0, 10.0)


# --- whole trainings on the lane of three mines ---


@pytest.fixture(scope="module")
def lane(three_mines):
    (three_mines / "none.csv").write_text(NO_MINES)
    (three_mines / "away.csv").write_text(OUT_OF_SIGHT)
    return three_mines


def run_training(lane, text, output, truth="truth.csv"):
    recipe = output.with_suffix(".toml")
    recipe.write_text(text)
    return flgpr.train(
        [lane / "run.zarr"], [lane / truth], recipe, output, lanes=[lane / "lane.toml"]
    )


def refused(lane, text, output, truth="truth.csv"):
    with pytest.raises(ValueError, match="cannot be trained: ") as error:
        run_training(lane, text, output, truth)
    assert not output.exists()
    return str(error.value)


def changed(text, old, new):
    assert old in text, old
    return text.replace(old, new)


COSGROVE = "map.deflection"
MASKS = "clutter.masks"


@pytest.mark.slow("trains for every advice")
@pytest.mark.parametrize(
    ("recipe", "old", "new", "stage", "counted"),
    [
        ("cosgrove2004", "length = 10", "length = 100", COSGROVE, "looks at targets whose whole cut lies in the image"),
        ("cosgrove2004", "clear = 1.0", "clear = 40.0", COSGROVE, "cuts of clutter"),
        ("fuse2018", "edges = [3.5, 5.0, 8.0]", "edges = [3.5, 3.55, 8.0]", MASKS,
         "looks at targets from 3.5 to 3.55 m ahead"),
    ],
)  # fmt: skip
def test_what_a_stage_advises_lets_it_train(lane, tmp_path, recipe, old, new, stage, counted):
    text = changed(resized(recipe, lane), old, new)
    message = refused(lane, text, tmp_path / "model")
    assert message.startswith(f"{stage} cannot be trained: it needs ")
    counts = counts_of(message)
    assert counts["targets in the truth (3 metal)"] == 3
    assert counts[counted] == 0
    for _ in range(5):
        text = follow(text, message)
        try:
            model = run_training(lane, text, tmp_path / "model")
            break
        except ValueError as error:
            message = str(error)
    assert list(model.stages) == [stage]


def test_a_truth_without_targets_is_told_for_every_kind_of_stage(lane, tmp_path):
    for recipe, stage in (
        ("cosgrove2004", COSGROVE),
        ("fuse2018", MASKS),
        ("flsar2004", "screen.clusters"),
    ):
        message = refused(lane, resized(recipe, lane), tmp_path / recipe, "none.csv")
        assert message.startswith(f"{stage} cannot be trained: ")
        assert counts_of(message)["targets in the truth"] == 0
        assert "give more lanes with mines" in message.lower()


def test_targets_that_no_scan_saw_are_told(lane, tmp_path):
    message = refused(lane, resized("flsar2004", lane), tmp_path / "model", "away.csv")
    assert message.startswith("screen.clusters cannot be trained: ")
    counts = counts_of(message)
    assert counts["targets in the truth (2 metal)"] == 2
    assert counts["in the run-view"] == counts["seen in all of its channels"] == 0
    assert counts["taken for this stage"] == 1


@pytest.mark.slow("trains for every advice")
def test_a_prescreener_that_raises_nothing_is_named_and_what_it_advises_lets_train(lane, tmp_path):
    text = changed(resized("wang2007", lane), "density = 0.75", "density = 0.001")
    message = refused(lane, text, tmp_path / "model")
    assert (
        "detector cannot be trained: it needs hits and false alarms, got 0 hits and 0 false alarms"
        in message
    )
    assert "the prescreener raised no alarm at the targets left for the detector" in message
    assert counts_of(message)["alarms raised by the prescreener"] == 0
    assert "Set density = 0.75 in [prescreen] (now 0.001)" in message
    assert run_training(lane, follow(text, message), tmp_path / "model").detector is not None


@RIVAL
def test_a_stage_that_takes_all_targets_is_named(lane, tmp_path):
    matched = '[[columns]]\nstage = "matched"\n\n[detector]\nfeatures = ["ace"]\n\n[score]'
    text = changed(resized("wang2007", lane), "[score]", matched)
    message = refused(lane, text, tmp_path / "model")
    assert "features.matched took all targets" in message
    counts = counts_of(message)
    assert counts["taken by features.matched"] == 3
    assert counts["targets left for the detector"] == 0
    assert counts["hits, within 1 m of a target"] > 0
    assert 'Set share = 0.5 in [[columns]] of stage "matched" (now 1.0)' in message
    assert run_training(lane, follow(text, message), tmp_path / "model").detector is not None


# --- the stages by themselves ---


def view_of(truth, seen=(0.0, 10.0)):
    """Two channels of noise of the magnitude one, with bright mines; nothing was seen before and after ``seen``."""
    rng = np.random.default_rng(0)
    y = np.arange(0, 10.05, 0.1)
    x = np.arange(-2, 2.05, 0.1)
    values = rng.rayleigh(1.0, (1, 2, y.size, x.size))
    for mine_x, mine_y in truth[["x", "y"]].to_numpy(dtype=float):
        values += 5 * np.exp(-((x - mine_x) ** 2 + (y[:, None] - mine_y) ** 2) / 0.1)
    values[:, :, (y < seen[0]) | (y > seen[1])] = np.nan
    coords = {"polarization": ["HH"], "subband": ["F1", "F2"], "y": y, "x": x}
    return TrainingView(xr.DataArray(values.astype(np.float32), coords, tuple(coords)), truth, AREA)


def targets(*places, kind="metal"):
    rows = [(f"T{number}", x, y, kind, -0.1) for number, (x, y) in enumerate(places)]
    return pd.DataFrame(rows, columns=["target_id", "x", "y", "kind", "depth"])


THREE = targets((0.0, 2.0), (0.5, 5.0), (-0.5, 8.0))


def too_few(kind, name, examples, **entries):
    stage = find_stage(kind, name)
    with pytest.raises(TooFewExamplesError) as error:
        stage.fit(stage.Settings(**entries), examples)
    return str(error.value.of_stage(f"{kind}.{name}"))


@RIVAL
@pytest.mark.parametrize("name", ["matched", "network"])
def test_kinds_that_are_not_there_are_told_with_those_that_are(name):
    message = too_few("features", name, [view_of(THREE)], kinds=("wood",))
    assert f'Set kinds = ["metal"] in [[columns]] of stage "{name}" (now ["wood"])' in message
    assert next(iter(counts_of(message).values())) == 0


@RIVAL
@pytest.mark.parametrize("name", ["matched", "network"])
def test_no_clutter_between_the_targets_is_told_with_a_nearer_border(name):
    message = too_few("features", name, [view_of(THREE)], clear=30.0)
    assert f'Set clear = 1.0 in [[columns]] of stage "{name}" (now 30.0)' in message
    assert list(counts_of(message).values())[-1] == 0


def cuts(looks, clutter, pixels, size=20):
    rng = np.random.default_rng(0)
    shapes = {"target": (looks, size), "clutter": (clutter, size), "pixel": (pixels, 2)}
    return {
        name: rng.normal(size=shape) + 1j * rng.normal(size=shape) for name, shape in shapes.items()
    }


@pytest.mark.parametrize("name", ["deflection", "neyman-pearson", "whitening", "magnitude"])
def test_every_map_by_forms_tells_looks_and_clutter(name):
    for looks, clutter, pixels, advice in (
        (1, 40, 40, "length = 5 in [map] (now 10)"),
        (3, 1, 40, "clear = 0.5 in [map] (now 1.0)"),
        (3, 40, 0, "clear = 0.5 in [map] (now 1.0)"),
    ):
        message = too_few("map", name, [cuts(looks, clutter, pixels)], length=10)
        assert list(counts_of(message).values()) == [looks, clutter, pixels]
        assert f"Set {advice}" in message


@pytest.mark.parametrize("name", ["deflection", "neyman-pearson"])
def test_moments_that_need_more_clutter_are_told_with_those_that_do_not(name):
    few = [cuts(3, 15, 15)]
    message = too_few("map", name, few, length=10, moments="sample")
    assert 'Set moments = "ledoit-wolf" in [map] (now "sample")' in message
    assert counts_of(message)["cuts of clutter"] == 15
    stage = find_stage("map", name)
    assert stage.fit(stage.Settings(length=10), few)[0]["constant"].size


def test_fewer_looks_than_ddof_are_told():
    few = [cuts(3, 60, 60)]
    message = too_few("map", "deflection", few, length=10, ddof=3)
    assert "Set ddof = 1 in [map] (now 3)" in message
    stage = find_stage("map", "deflection")
    assert stage.fit(stage.Settings(length=10, ddof=1), few)[0]["constant"].size


def calibrated(looks, roadside=True):
    """State of a calibration with so many looks at targets in each of its sub-regions."""
    learnt = ThresholdCalibration(len(looks))
    region = np.repeat(np.arange(len(looks)), 2)[:, None] * np.ones((1, 4), int)
    halo = [np.zeros(region.shape, bool) for number in looks for _ in range(number)]
    for one, where in zip(halo, np.repeat(np.arange(len(looks)), looks), strict=True):
        one[2 * where, 1] = True
    beside = np.zeros(region.shape, bool)
    beside[:, 3] = roadside
    learnt.add(np.ones(region.shape), np.ones(region.shape), region, halo, beside)
    return learnt.state()


@pytest.mark.parametrize(
    ("looks", "edges"),
    [([2, 0, 3], "[5.0, 9.0]"), ([0, 1, 3], "[5.0, 7.0, 9.0]"), ([1, 2, 0], "[5.0, 6.0, 9.0]"),
     ([0, 0, 1], "[5.0, 9.0]")],
)  # fmt: skip
def test_masks_tell_looks_by_sub_region_and_which_to_join(looks, edges):
    message = too_few("clutter", "masks", [calibrated(looks)], edges=(5.0, 6.0, 7.0, 9.0))
    assert list(counts_of(message).values()) == looks
    assert (
        f'Set edges = {edges} in [[clutter]] of stage "masks" (now [5.0, 6.0, 7.0, 9.0])' in message
    )


def test_masks_without_a_roadside_or_any_target_say_so():
    message = too_few(
        "clutter", "masks", [calibrated([1, 2], roadside=False)], edges=(5.0, 6.0, 9.0)
    )
    assert 'Set roadside = [2.0, 10.0] in [[clutter]] of stage "masks" (now [4.0, 10.0])' in message
    message = too_few("clutter", "masks", [calibrated([0, 0])], edges=(5.0, 6.0, 9.0))
    assert message.endswith("Give more lanes with mines.")


def test_the_likelihood_tells_its_places_of_ground():
    empty = {
        "bodies": np.zeros((0, 4)),
        "ahead": np.zeros(0),
        "stones": np.zeros((0, 4)),
        "stones_ahead": np.zeros(0),
    }
    few = {"covariance": np.zeros((2, 4, 4)), "count": np.array([1.0, 2.0])} | empty
    message = too_few("map", "likelihood", [few], clear=8.0, sensor="sri-array")
    assert counts_of(message) == {"places in the lane away from all targets": 3}
    assert "4 places of target-free ground or more, got 3" in message
    assert "in [map] (now 8.0)" in message


def test_targets_are_counted_in_the_run_view_and_where_it_was_seen():
    truth = targets((0.0, 2.0), (0.5, 5.0), (-0.5, 8.0), (0.0, 30.0))
    views = [view_of(truth, seen=(4.0, 10.0)), view_of(targets((0.0, 1.0)), seen=(4.0, 10.0))]
    spent = [truth.iloc[[0, 1]], views[1].truth]
    numbers = [one.number for one in count_in_views(views, spent)]
    assert numbers == [4, 2, 3, 1]  # in the run-view, seen, taken, of these seen


def test_of_few_mines_some_are_left_for_a_detector():
    for total in range(2, 60):
        lanes = [view_of(targets(*[(0.0, 0.1 * k) for k in range(total)]))]
        taken = len(subset(lanes, 0.1)[0])
        assert 0 < taken <= (total + 1) // 2
        assert taken >= min(4, total // 2)
    assert len(subset([view_of(THREE)], 1.0)[0]) == 3


# --- the detectors ---


def examples(hits, false_alarms):
    count = hits + false_alarms
    rng = np.random.default_rng(1)
    features = pd.DataFrame(rng.normal(size=(count, 2)), columns=["a", "b"])
    return TrainingSet(
        features,
        np.repeat([1, 0], [hits, false_alarms]),
        np.ones(count, int),
        np.repeat("lane", count),
    )


@pytest.mark.parametrize(
    ("name", "on", "hits", "false_alarms", "needed"),
    [
        ("rvm", "all", 0, 5, "hits and false alarms, got 0 hits and 5 false alarms"),
        ("svm", "all", 5, 0, "hits and false alarms, got 5 hits and 0 false alarms"),
        ("one-class-rvm", "mines", 0, 5, "hits, got 0 hits and 5 false alarms"),
        ("one-class-svm", "mines", 0, 5, "hits, got 0 hits and 5 false alarms"),
        pytest.param(
            "isolation-forest",
            "clutter",
            5,
            0,
            "false alarms, got 5 hits and 0 false alarms",
            marks=RIVAL,
        ),
        pytest.param(
            "mixture", "mines", 1, 5, "2 examples or more for mixture, got 1", marks=RIVAL
        ),
        ("lda", "all", 1, 1, "3 examples or more for lda, got 2"),
        pytest.param("knn", "mines", 3, 50, "6 examples or more for knn, got 3", marks=RIVAL),
    ],
)
def test_every_detector_tells_how_many_examples_it_needs(name, on, hits, false_alarms, needed):
    some = examples(hits, false_alarms)
    table = DetectorTable(estimator=name, on=on)
    with pytest.raises(TooFewExamplesError, match=f"^training needs {needed}$"):
        train_estimator(some, table, ["a", "b"])


def test_the_discriminant_tells_how_many_examples_it_needs():
    with pytest.raises(
        TooFewExamplesError, match="needs hits and false alarms, got 3 hits and 0 false alarms"
    ):
        train(examples(3, 0), ["a", "b"])


@RIVAL
def test_fewer_neighbours_are_advised_and_let_train():
    pytest.importorskip("pyod", reason="PyOD is an extra")
    with pytest.raises(TooFewExamplesError) as error:
        train_estimator(examples(3, 50), DetectorTable(estimator="knn", on="mines"), ["a", "b"])
    assert list(map(str, error.value.changes)) == ["n_neighbors = 2 in [detector.options] (now 5)"]
    table = DetectorTable(estimator="knn", on="mines", options={"n_neighbors": 2})
    assert train_estimator(examples(3, 50), table, ["a", "b"]).notes["hits"] == 3
