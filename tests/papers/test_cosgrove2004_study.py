"""The study of Cosgrove et al. 2004 on lanes small enough for a test."""

import json
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from few_tones import few_tones
from flgpr.clutter import ClutterWhitener
from flgpr.method.model import load_model
from flgpr_papers.cosgrove2004 import findings as findings_module
from flgpr_papers.cosgrove2004 import images as images_module
from flgpr_papers.cosgrove2004 import study as cosgrove2004
from flgpr_papers.cosgrove2004.detect import (
    box_values,
    calibrated,
    detectors,
    eigenvalue_ratios,
    eigenvectors,
    example_detectors,
    learn,
    one_polarization,
    score_looks,
)
from flgpr_papers.cosgrove2004.images import (
    _direction,
    lane_looks,
    lane_scene,
    study_sensor,
    tone_weight,
)
from flgpr_papers.cosgrove2004.signature import (
    look_measures,
)
from flgpr_papers.kit import study
from flgpr_papers.kit.findings import NO_VERDICT
from flgpr_papers.kit.scenes import changed
from reference.cosgrove2004 import equations_7_to_12

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture
def rng():
    return np.random.default_rng(2004)


@pytest.fixture(scope="module", autouse=True)
def folded_ranges():
    """Few tones make these tests quick; test_tones.py asks whether the study refuses them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(images_module, "check_tones", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def recipe():
    return few_tones()


@pytest.fixture(scope="module")
def looks(recipe):
    return lane_looks(recipe, "sand", 3, 0.1)


def test_what_stands_beside_the_lane_brings_no_ground_of_its_own(recipe):
    """Echoes are added: with nothing beside the lane the two worlds must be one, soil and holes counted once."""
    scene, trains, depths = lane_scene(recipe, recipe.sites["sand"], 3000, 0.1)
    bare = changed(scene, clutter={"bushes": 0.0, "posts": 0.0})
    looks = _direction(recipe, bare, 3000, False, list(zip(depths, trains, strict=True)))
    for beside, alone in zip(looks["roadside"], looks["open"], strict=True):
        np.testing.assert_array_equal(beside.image.values, alone.image.values)


def test_ramp_on_calibrated_data_leaves_amplitudes_that_grow_with_frequency(recipe):
    sensor = study_sensor(recipe)
    frequency = sensor.tones.axis()
    # Gain grows as f² and the wavelength falls as 1/f: the raw data already carry the ramp.
    assert np.allclose(tone_weight(recipe, sensor), 1)
    image = recipe.image.model_copy(update={"calibrate": False})
    plain = recipe.model_copy(update={"image": image})
    assert np.allclose(tone_weight(plain, sensor), frequency / frequency[-1])


def test_every_mine_is_seen_twice_at_the_studys_range(recipe, looks):
    depths, trains = recipe.sites["sand"].depths(0.1)
    for world in ("roadside", "open"):
        seen = looks[world]
        assert len(seen) == 2 * depths.size
        assert sum(look.trains for look in seen) == 2 * trains.sum()
        assert sorted({look.depth for look in seen}) == sorted(set(depths))
        assert all(
            abs(look.position[1] - 15) < 0.7 and abs(look.position[0]) < 1.1 for look in seen
        )
    forth = looks["open"][: depths.size]
    back = looks["open"][depths.size :][::-1]
    for one, other in zip(forth, back, strict=True):
        # Seen from the other end, left is right and far is near; heading and position have errors
        # of a few cm.
        assert one.depth == other.depth
        assert one.position[0] == pytest.approx(-other.position[0], abs=0.2)
        assert one.position[1] - 15 == pytest.approx(15 - other.position[1], abs=0.1)


def test_lanes_are_the_same_again_and_the_roadside_is_what_the_worlds_differ_in(recipe, looks):
    again = lane_looks(recipe, "sand", 3, 0.1)
    for world in looks:
        assert all(
            np.array_equal(a.image, b.image)
            for a, b in zip(looks[world], again[world], strict=True)
        )
    assert not np.array_equal(looks["open"][0].image, looks["roadside"][0].image)
    assert np.array_equal(looks["open"][0].position, looks["roadside"][0].position)


def test_detectors_of_few_examples_are_trained_on_as_many(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    made = example_detectors(recipe, "sand", 3, training, looks["open"])
    form = made["deflection of rank 56, 4 examples"].forms[0]
    assert len(form.vectors) == 4  # no other direction is reached
    assert len(made["Neyman-Pearson of rank 1, 4 examples"].forms[0].vectors) <= 1
    assert not any(name.endswith("36 examples") for name in made)


def test_one_polarization_and_one_band_are_scored_on_the_same_mines(recipe, looks):
    alone = one_polarization(recipe, looks["open"])
    test = [look.depth for look in looks["open"] if not look.trains]
    assert list(alone) == ["HH cuts alone", "VV cuts alone"]
    assert all(peaks.depth == test for peaks in alone.values())
    bands = {"low": (0.3e9, 1.1e9), "high": (1.4e9, 3.0e9)}
    in_bands = lane_looks(recipe, "sand", 3, 0.1, bands)
    for name in bands:
        for look, other in zip(looks["open"], in_bands[name], strict=True):
            assert (look.depth, look.trains) == (other.depth, other.trains)
            np.testing.assert_array_equal(look.position, other.position)
    assert not np.array_equal(in_bands["low"][0].image, in_bands["high"][0].image)


def test_likelihood_of_a_cut_is_that_of_the_slow_twin(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    made = detectors(recipe, training)["rank 2"]
    look = looks["open"][5]
    stack = np.asarray(look.image.values)
    value = made.likelihood(stack)
    row, column = 70, 30
    cut = np.concatenate([stack[c, row - 14 : row + 14, column] for c in range(2)])
    white = training.whitener.transform(cut[None])[0]
    expected = equations_7_to_12(white, training.white, 2, recipe.detector.ddof)
    assert value[row, column] == pytest.approx(expected, rel=1e-3)


def test_eigenvectors_are_shown_as_they_look_in_the_image(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    shown = eigenvectors(recipe, training)
    white = shown @ training.whitener.matrix_.T
    white /= np.linalg.norm(white, axis=1, keepdims=True)
    assert np.allclose(white @ white.conj().T, np.eye(len(shown)), atol=1e-6)
    second = training.white.T @ training.white.conj()
    assert np.allclose(np.linalg.norm(second @ white[0]), np.linalg.norm(second, 2))


def test_simulated_signatures_get_the_level_of_the_examples(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    rng = np.random.default_rng(1)
    shape = training.white.shape
    found = calibrated(training, rng.normal(size=shape) + 1j * rng.normal(size=shape))
    energy = np.mean(np.sum(np.abs(found) ** 2, axis=1))
    wanted = np.mean(np.sum(np.abs(training.white) ** 2, axis=1)) - training.clutter_energy
    assert energy == pytest.approx(max(wanted, 1.0))


def test_peaks_are_taken_at_and_off_the_mine(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    made = {"HH": detectors(recipe, training)["HH"]}
    look = looks["open"][6]
    peaks = score_looks(recipe, [look], made)["HH"]
    x, y = look.image["x"].values, look.image["y"].values
    power = np.abs(look.image.sel(polarization="HH").values) ** 2
    near = (np.abs(x - look.position[0]) <= 0.5)[None, :] & (np.abs(y - look.position[1]) <= 0.5)[
        :, None
    ]
    assert peaks.target[0] == pytest.approx(power[near].max(), rel=1e-3)
    assert len(peaks.rock) == len(peaks.clutter) == len(peaks.clutter_quantile) > 0
    assert (np.array(peaks.clutter_quantile) < np.array(peaks.clutter)).all()
    empty, _ = box_values(
        np.zeros((4, 4), np.float32), np.arange(4.0), np.arange(4.0), np.array([[9.0, 9.0]]), 1, 0.9
    )
    assert np.isnan(empty).all()


def case(seed, target, clutter, names=("HH", "PWF", "rank 1", "rank 3")):
    def peaks(name):
        clear = {"rank 1": 2.5, "rank 3": 2.0}.get(name, 0.0)
        values = [float(v) for v in target + clear]
        return {
            "target": values,
            "clutter": clutter.tolist(),
            "target_quantile": values,
            "clutter_quantile": clutter.tolist(),
            "depth": [0.05] * 20 + [0.15] * (len(values) - 20),
            "rock": [k == int(np.argmax(clutter)) for k in range(clutter.size)],
        }

    return {
        "seed": seed,
        "ratios": [1, *(np.array([0.089, 0.5, 0.028, 0.019, 0.014]) * (1 + 0.001 * seed)).tolist()],
        "peaks": {n: peaks(n) for n in names},
        **premises(seed),
    }


def premises(seed):
    """Measures of images as the paper describes them, but for the correlation, which is that of clutter."""
    some = seed % 2
    return {
        "point_width": 0.4,
        "premises": {
            "mine": {
                "HH": [2, 2, 2, 2 + some],
                "VV": [1, 1, 4, 4],
                "correlation": [0.5, 0.5 + 0.01 * some],
            },
            "clutter": {"HH": [1, 3, 4, 2], "VV": [2, 2, 2, 2 + some], "correlation": [0.51, 0.5]},
            "across": {"humps": [1, 1, 1 + some], "width": [0.4, float("nan"), 0.5 + 0.01 * some]},
            "fourth_moment_ratio": 3.0 + 0.1 * some,
        },
    }


def test_ratios_are_unknown_where_no_example_reaches(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    ratios = eigenvalue_ratios(recipe, training)
    reached = np.linalg.matrix_rank(training.white)
    assert reached < 6
    assert np.isfinite(ratios[:reached]).all()
    assert np.isnan(ratios[reached:]).all()
    statements = findings_module._eigenvalue_statements(recipe, [{"ratios": ratios.tolist()}] * 2)
    assert [one.verdict for one in statements[reached - 1 :]] == ["cannot say"] * (6 - reached)


def test_measures_of_looks_are_of_mines_and_clutter(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    measures = look_measures(recipe, looks["open"][4:6], training.whitener)
    assert len(measures["mine"]["HH"]) == len(measures["across"]["width"]) == 2
    assert len(measures["clutter"]["correlation"]) > 10
    assert all(0 <= value <= 1 for value in measures["clutter"]["correlation"])
    assert measures["fourth_moment_ratio"] > 1


@pytest.mark.slow("runs a quick form of the whole study")
def test_quick_study_writes_its_page_and_goes_on_where_it_stopped(recipe, tmp_path, monkeypatch):
    first: dict = {}

    def run_once(study, seed, *rest):
        """The lanes of the first seed stand for those of the second."""
        first.update(first or run_seed(study, seed, *rest))
        return {
            world: {site: case | {"seed": seed} for site, case in of.items()}
            for world, of in first.items()
        }

    run_seed = cosgrove2004.run_seed
    monkeypatch.setattr(cosgrove2004, "run_seed", run_once)
    monkeypatch.setattr(cosgrove2004, "study_recipe", lambda *_: recipe)
    page = cosgrove2004.STUDY.reproduce(tmp_path, quick=True)
    text = page.read_text(encoding="utf-8")
    assert "Quick run" in text
    assert "inf to inf" not in text
    assert "(in all seeds)" in text  # the two seeds are equal
    assert "://" not in text
    summary = json.loads((tmp_path / "findings.json").read_text())
    assert summary["quick"] is True
    assert {one["verdict"] for one in summary["findings"]} <= {NO_VERDICT, "open"}
    assert {one["group"] for one in summary["findings"]} == {"open", "roadside"}
    for number in range(1, 8):
        assert list(tmp_path.glob(f"figure-{number}*.png"))
    model = load_model(tmp_path / "models" / "sand-open")
    assert model.stages["map.deflection"]["linear-0"].shape == (
        2 * 28,
    )  # as the recipe cosgrove2004 takes it
    assert model.notes["detector"].startswith("DeflectionDetector")
    assert set(pd.read_csv(tmp_path / "pd.csv")["seed"]) == {1, 2}
    before = (tmp_path / "pd.csv").read_bytes()
    monkeypatch.setattr(cosgrove2004, "run_seed", lambda *_: pytest.fail("ran a seed again"))
    monkeypatch.setattr(study, "draw", lambda *_: b"")
    replace(cosgrove2004.STUDY, figures=MagicMock()).reproduce(tmp_path, quick=True)
    assert (tmp_path / "pd.csv").read_bytes() == before

    third = []
    monkeypatch.setattr(
        cosgrove2004, "run_seed", lambda _, seed, *rest: third.append(seed) or first
    )
    more = recipe.model_copy(update={"study": recipe.study.model_copy(update={"seeds": 3})})
    monkeypatch.setattr(cosgrove2004, "study_recipe", lambda *_: more)
    replace(cosgrove2004.STUDY, figures=MagicMock()).reproduce(tmp_path, quick=True)
    assert third == [3], "more seeds keep those that are done"


def test_whitener_of_the_study_is_ledoit_and_wolfs(recipe, looks):
    training = learn(recipe, looks["open"][:4])
    assert training.whitener.moments == "ledoit-wolf"
    assert isinstance(training.unshrunk, ClutterWhitener)
    condition = [np.linalg.cond(one.covariance_) for one in (training.whitener, training.unshrunk)]
    assert condition[0] < 1e-2 * condition[1]
