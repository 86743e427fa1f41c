"""The streaming chain with features, training and detection with a model, on a small run of point scatterers."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import flgpr
from alone import needs
from flgpr.clutter import gain_background, remove_background, self_signature
from flgpr.features import FEATURES, local_contrast
from flgpr.imaging import ScanImager
from flgpr.method.classifier import CLASSIFIER_A, make_training_set, train
from flgpr.method.detection import MAIN
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detect, detection_of, engine_of
from flgpr.method.model import load_model, save_model
from flgpr.progress import silent
from flgpr.recipe.schema import lane_of, parse_recipe, recipe_text
from flgpr.results.result import read_result
from flgpr.screen import prescreen, run_view, select
from flgpr.store import Bundle, save_run, write_table
from small_lane import LANE, TARGETS, cut_down, small_recipe, small_run


@pytest.fixture(scope="module")
def run():
    return small_run()


@pytest.fixture(scope="module")
def truth():
    return pd.DataFrame(
        {
            "target_id": ["a", "b", "c"],
            "x": TARGETS[:, 0],
            "y": TARGETS[:, 1],
            "kind": ["metal", "plastic", "simulant"],
            "depth": [0.0, 0.0, 0.0],
        }
    )


@pytest.fixture(scope="module")
def recipe():
    return parse_recipe(small_recipe())


@pytest.fixture(scope="module")
def found(run, recipe):
    return detect(run, recipe, LANE)


def test_the_chain_equals_its_plain_parts(run, recipe, found):
    images = list(ScanImager(run, recipe.image.grid(), recipe.image.subbands, tolerance=1e-5))
    signature = self_signature([one.values for one in images])
    gain = gain_background(
        [one.values for one in images], signature, *recipe.background.windows(0.05)
    )
    cleaned = [one.copy(data=remove_background(one.values, signature, gain)) for one in images]
    view = run_view(cleaned, recipe.run_view.grid(LANE), 4.5)
    assert (
        np.nanmax(np.abs(found.view.values / view.values - 1)) < 0.05
    )  # the imaging tolerance, after a subtraction
    assert np.nanmean(np.abs(found.view.values / view.values - 1)) < 0.003
    alarms = prescreen(select(view, "HH", "F1"), LANE, 0.4, 0.75, "view")
    contrast = local_contrast(cleaned, alarms, "HH", "F1", 4.5)
    want = (
        alarms.assign(contrast=contrast["contrast"])
        .dropna()
        .sort_values("contrast", ascending=False)
    )
    assert len(want) == len(found.alarms)
    np.testing.assert_allclose(found.alarms["confidence"], want["contrast"], rtol=0.02)
    np.testing.assert_allclose(found.alarms[["x", "y"]], want[["x", "y"]], atol=1e-9)


def test_every_alarm_has_its_features_and_their_variants(found):
    names = [f"{name}_{band}" for band in ("F1", "F2") for name in FEATURES]
    polarimetric = [f"paper.{name}" for name in names if "P_" in name]
    own = (f"linear.P_psi_{band}" for band in ("F1", "F2"))
    paper = (f"paper.circular.P_psi_{b}" for b in ("F1", "F2"))
    swapped = [f"swapped.{n}" for n in names]
    assert list(found.features.columns) == ["scans", *names, *own, *swapped, *polarimetric, *paper]
    turned = found.features[["P_psi_F1", "paper.circular.P_psi_F1"]]
    assert (turned.abs() <= np.pi / 2).all().all()
    assert not np.allclose(found.features["P_psi_F1"], found.features["linear.P_psi_F1"])
    assert len(found.features) == len(found.alarms) > 5
    np.testing.assert_array_equal(found.features["C_HH_F1"], found.alarms["confidence"])
    assert found.features[names].notna().all().all()
    tau = found.features["P_tau_F1"]
    assert ((tau >= 0) & (tau <= np.pi / 4)).all()


def test_the_targets_are_among_the_strongest_alarms(found):
    best = found.alarms.iloc[:6][["x", "y"]].to_numpy()
    for place in TARGETS:
        assert np.linalg.norm(best - place, axis=1).min() < 0.3


def test_train_and_detect_with_a_model_that_never_sees_truth(tmp_path, run, truth, found):
    (tmp_path / "small.toml").write_text(small_recipe())
    lane = tmp_path / "lane.toml"
    lane.write_text("x_min = -0.75\nx_max = 0.75\ny_min = 3.0\ny_max = 10.0\n")
    save_run(run, tmp_path / "train.zarr")
    write_table(truth, tmp_path / "truth.csv")
    columns = ("C_HH_F1", "M_VV_F1", "R_HH_HV_F2")
    model = flgpr.train(
        [tmp_path / "train.zarr"],
        [tmp_path / "truth.csv"],
        tmp_path / "small.toml",
        tmp_path / "model",
        columns,
        [lane],
    )
    assert [path.name for path in (tmp_path / "model").iterdir()] == ["model.bundle"]
    assert not list(tmp_path.glob("*.work"))
    elsewhere = tmp_path / "field"
    elsewhere.mkdir()
    shutil.move(tmp_path / "train.zarr", elsewhere / "run.zarr")
    (tmp_path / "truth.csv").unlink()
    result = flgpr.detect(
        elsewhere / "run.zarr", tmp_path / "small.toml", elsewhere / "result", lane, report=False,
        model=tmp_path / "model",
    )  # fmt: skip
    main = read_result(result.folder).detections[0]
    assert main.name == MAIN
    assert main.features is not None
    np.testing.assert_allclose(
        main.alarms["confidence"], model.detector.confidence(main.features), rtol=1e-9
    )
    assert main.alarms["confidence"].is_monotonic_decreasing
    assert main.notes["confidence"] == "C_HH_F1 + M_VV_F1 + R_HH_HV_F2"
    assert len(main.alarms) == len(found.alarms)
    shown = json.loads((result.folder / "view" / "index.json").read_text())
    added = shown["detections"][0]["contributions"]
    assert set(added) == {*columns, "threshold"}
    total = np.sum([np.array(column) for column in added.values()], axis=0)
    np.testing.assert_allclose(total, main.alarms["confidence"], atol=1e-4)
    assert {layer["detection"] for layer in shown["layers"]} == {"before", "main"}
    assert shown["channel"] == ["HH", "F1"]
    assert all(scans for scans in shown["detections"][0]["evidence"]["scans"])


def test_a_model_read_back_scores_alike_and_tells_when_it_was_altered(tmp_path, truth, found):
    examples = make_training_set([("one", found.alarms, found.features, truth, LANE)], 0.5)
    assert examples.label.sum() >= 3
    model = train(examples, ("C_HH_F1", "P_alpha_F1"))
    folder = save_model(model, tmp_path / "model", {"site": "yard"})
    again = load_model(folder)
    np.testing.assert_array_equal(
        again.detector.confidence(found.features), model.confidence(found.features)
    )
    assert again.notes["site"] == "yard"
    data = bytearray((folder / "model.bundle").read_bytes())
    data[-100] ^= 1
    (folder / "model.bundle").write_bytes(data)
    with pytest.raises(ValueError, match="differs"):
        load_model(folder)
    (folder / "model.bundle").unlink()
    with pytest.raises(ValueError, match="missing"):
        load_model(folder)
    with pytest.raises(ValueError, match="missing: P_alpha_F1"):
        model.confidence(found.features[["C_HH_F1"]])
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "note.txt").write_text("mine")
    with pytest.raises(FileExistsError):
        save_model(model, tmp_path / "other")


def test_a_single_feature_model_ranks_alarms_as_the_feature(found, truth):
    model = train(
        make_training_set([("one", found.alarms, found.features, truth, LANE)], 0.5), CLASSIFIER_A
    )
    score = model.confidence(found.features)
    order = np.argsort(-found.features["C_HH_F1"].to_numpy())
    assert (
        np.diff(score[order]) <= 1e-12
    ).all()  # mines stand out, so that the higher contrast is the likelier mine
    assert score[order[0]] > score[order[-1]]


def test_simulants_weigh_half(found):
    alarms = found.alarms.iloc[:2].assign(x=[0.0, 0.0], y=[4.0, 8.0])
    alarms = pd.concat(
        [alarms] + [found.alarms.iloc[[2]].assign(x=0.0, y=6.0)] * 40, ignore_index=True
    )
    features = found.features.iloc[[0] * 42].reset_index(drop=True)
    truth = pd.DataFrame(
        {
            "target_id": ["m", "s"],
            "x": [0.0, 0.0],
            "y": [4.0, 8.0],
            "kind": ["metal", "simulant"],
            "depth": [0.0, 0.0],
        }
    )
    examples = make_training_set([("one", alarms, features, truth, LANE)])
    assert examples.weight[:2].tolist() == [40, 20]  # W0 = 40 false alarms over the one actual mine
    assert (examples.weight[2:] == 1).all()


def test_a_run_without_a_lane_is_searched_where_it_was_seen(run, recipe):
    lane = lane_of(run, recipe)
    assert (lane.y_min, lane.y_max) == pytest.approx((2.0, 10.6))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('self_signature = "mean"', 'self_signature = "mode"', "self_signature"),
        ("[features]", "[unknown]", "unknown"),
        ("psi = ", "phi = ", "features.phi"),
        ("median_step = 3", "median_step = 0", "median_step"),
    ],
)
def test_broken_recipes(old, new, words):
    text = recipe_text("wang2007")
    assert old in text
    with pytest.raises(ValueError, match=words):
        parse_recipe(text.replace(old, new, 1))


def test_training_needs_one_truth_per_run(tmp_path):
    with pytest.raises(ValueError, match="one truth per run"):
        flgpr.train([tmp_path], [], "wang2007", tmp_path / "m")
    with pytest.raises(ValueError, match="features"):
        flgpr.train([tmp_path], [tmp_path], "demo-mean-self-signature", tmp_path / "m")


def cleaned_run(run, recipe) -> ImagedRun:
    setup = ImagedRun(run, recipe, LANE, whole_background=True)
    engine_of(setup).run(names=("signature", "gain"))
    return setup


def test_a_background_as_far_ahead_as_counts_finds_what_that_of_whole_images_does(run):
    recipe = parse_recipe(cut_down(small_recipe(3), [("y = [2.5, 5.5]", "y = [2.5, 8.5]")]))
    near, whole = (ImagedRun(run, recipe, LANE, whole_background=whole) for whole in (False, True))
    for setup in (near, whole):
        engine_of(setup).run()
    assert (
        near.results["gain"]["gain"].shape[2]
        < whole.results["gain"]["gain"].shape[2]
        == recipe.image.grid().ny
    )
    one = detection_of(near)
    other = detection_of(whole)
    np.testing.assert_array_equal(one.view.values, other.view.values)
    pd.testing.assert_frame_equal(one.alarms, other.alarms, check_exact=True)
    pd.testing.assert_frame_equal(one.features, other.features, check_exact=True)


@needs("flgpr_papers")
def test_the_full_range_view_is_that_of_whole_images(run, recipe):
    from flgpr_papers.wang2007.study import other_views

    cleaned = cleaned_run(run, recipe)
    views = other_views(cleaned, silent)
    images = []
    for image, gain in zip(
        ScanImager(run, recipe.image.grid(), recipe.image.subbands), cleaned.gains, strict=True
    ):
        images.append(image.copy(data=cleaned.whole_background.magnitude(image.values, gain)))
    want = run_view(images, recipe.run_view.grid(LANE), recipe.image.y[1])
    second = select(want, "HH", "F1").values
    np.testing.assert_allclose(views["wide"], second, rtol=1e-2, atol=1e-3)
    assert (views["wide looks"] == want["looks"].values).all()
    near = run_view(images, recipe.run_view.grid(LANE), recipe.run_view.y_max)
    second, seen = select(near, "HH", "F1").values, near["looks"].values > 1
    assert (views["largest"][seen] >= second[seen] * 0.99 - 1e-3).all()
    assert (views["largest"][seen] > second[seen]).any()
    assert (views["mean"][seen] <= views["largest"][seen] + 1e-3).all()


@needs("flgpr_papers")
def test_examples_show_the_targets_where_they_are(tmp_path, run, recipe, truth, found):
    from flgpr_papers.wang2007.examples import save_examples

    cleaned = cleaned_run(run, recipe)
    away = found.alarms.iloc[[0]].assign(x=0.0, y=2.3, confidence=0.1)
    alarms = pd.concat([found.alarms, away], ignore_index=True)
    save_examples(tmp_path / "examples.bundle", cleaned, truth, alarms)
    arrays = Bundle(tmp_path / "examples.bundle")
    assert arrays["patches_metal"].shape[1:] == (3, 2, 25, 25)
    patches = arrays["patches_metal"][:, 0, 0]  # the nearest may reach over the image's border
    centre = patches[1:, 10:15, 10:15].max(axis=(-2, -1))
    assert np.median(centre / np.nanmedian(patches[1:], axis=(-2, -1))) > 2
    assert arrays["series"].shape[0] == 5
    assert (np.diff(arrays["distances_metal"]) > 0).all()
