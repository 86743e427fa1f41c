"""The reproduction's scorer, tables, verdicts and page, on made-up detections; the simulated lanes by their counts."""

import re
from dataclasses import replace

import numpy as np
import pytest

from flgpr.features import FEATURES
from flgpr.imaging import ScanImager
from flgpr.method.classifier import CLASSIFIER_A
from flgpr.progress import silent
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.scoring import roc_of
from flgpr.scoring.bootstrap import make_design, make_scores
from flgpr.scoring.curve import held_pd_mean
from flgpr.simulate import Simulator
from flgpr.store import open_run, write_bundle
from flgpr_papers.kit.cache import store_lane
from flgpr_papers.kit.findings import (
    NO_VERDICT,
    Finding,
    over_experiments,
    read_findings,
    write_findings,
)
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007 import lanes, study
from flgpr_papers.wang2007.analysis import (
    MINES,
    SIMULANTS,
    Draw,
    Pool,
    Rescorer,
    matched,
    table_one,
)
from flgpr_papers.wang2007.examples import series_scans
from flgpr_papers.wang2007.findings import all_findings, blind_scores
from flgpr_papers.wang2007.study import likeness
from wang2007_lane import BANDS, fake_lane

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture(scope="module")
def results():
    return [fake_lane(name, seed) for seed, name in enumerate(("c1", "c2", "c3"))]


@pytest.fixture(scope="module")
def pool(results):
    return Pool(results)


def test_the_scorer_is_pd_mean_of_the_curve(results, pool):
    rng = np.random.default_rng(5)
    for _ in range(20):
        confidence = np.round(rng.normal(size=len(pool.labels)), 1)
        confidence[rng.random(confidence.size) < 0.1] = -np.inf
        for area in ("union", "paper"):
            want = held_pd_mean(roc_of(pool.match_of(confidence), MINES, area=area))
            assert Rescorer(pool.reference, MINES, area=area)(confidence) == pytest.approx(
                want, abs=1e-12
            )


def test_the_scorers_curve_is_that_of_the_bootstrap(pool):
    confidence = np.random.default_rng(6).normal(size=len(pool.labels))
    far = np.linspace(0, 0.1, 21)
    design = make_design(pool.reference, MINES, area="paper")
    want = make_scores(pool.match_of(confidence), design, MINES)
    ones = np.ones(len(want.target)), np.ones(len(design.block_lane))
    np.testing.assert_allclose(
        Rescorer(pool.reference, MINES, area="paper").pd_at(confidence, far),
        want.pd_at(far, *ones, pool.scorer.area),
    )


def test_training_anew_widens_the_band(pool):
    far = np.linspace(0, 0.1, 11)
    kept, anew = pool.bands(["C_HH_F1", "M_VV_F1", "P_alpha_F1"], "C", MINES, far, 40)
    assert kept.shape == anew.shape == (2, 11)
    assert (kept[0] <= kept[1]).all()
    assert np.ptp(anew, axis=0).mean() > np.ptp(kept, axis=0).mean()


def test_a_draw_of_everything_once_is_the_lanes_themselves(pool):
    once = Draw(np.ones(27), np.ones(len(pool.labels)), pool.scorer.area)
    for columns, method in ((["C_HH_F1"], "A"), (["C_HH_F1", "M_VV_F1"], "C")):
        cross = method in "CD"
        duplicate = method in "AC"
        plain, drawn = (pool.folds(columns, cross, duplicate, draw=draw) for draw in (None, once))
        for one, other in zip(plain, drawn, strict=True):
            np.testing.assert_array_equal(one.scatter, other.scatter)
        confidence = pool.confidence(columns, method)
        assert pool.scorer(confidence, once) == pytest.approx(pool.scorer(confidence), abs=1e-12)


def test_a_draw_weighs_what_hits_a_target_as_the_target_and_trains_on_it(pool):
    draws = list(pool.draws(5, seed=3))
    hit = pool.labels["target"].to_numpy()
    for draw in draws:
        np.testing.assert_array_equal(draw.alarm[hit >= 0], draw.target[hit[hit >= 0]])
        assert (
            len(
                {
                    name
                    for name, weight in zip(pool.labels["lane"], draw.alarm, strict=True)
                    if weight
                }
            )
            > 1
        )
    changed = [
        pool.folds(["C_HH_F1", "M_VV_F1"], False, True, draw=draw)[0].scatter for draw in draws
    ]
    assert not any(np.allclose(changed[0], one) for one in changed[1:])
    spread = pool.retrained(["C_HH_F1", "M_VV_F1"], "C", 30).std()
    low, high = pool.interval(pool.confidence(["C_HH_F1", "M_VV_F1"], "C"), 100)
    assert 0.3 * (high - low) / 4 < spread < 3 * (high - low) / 4


def test_every_draw_for_simulants_holds_one(results):
    # Of two mines and one simulant a lane, three in all, many draws hold no simulant.
    few = [replace(one, truth=one.truth.iloc[[1, 3, 7]].reset_index(drop=True)) for one in results]
    pool = Pool(few)
    simulants = (pool.reference.truth["kind"] == "simulant").to_numpy()
    assert not all(draw.target[simulants].any() for draw in pool.draws(40))
    assert all(draw.target[simulants].any() for draw in pool.draws(40, subset=SIMULANTS))
    assert np.isfinite(pool.retrained(["C_HH_F1"], "A", 40, SIMULANTS)).all()
    with pytest.raises(ValueError, match="subset must select at least one target"):
        next(pool.draws(1, subset={"kind": "bush"}))


def test_five_scans_see_the_mine_and_what_stays_in_place_is_alike():
    poses = np.zeros((40, 6))
    poses[:, 1] = 2.8 * np.arange(40) - 20
    for y in (10.0, 31.0, 60.0):
        chosen = series_scans(np.arange(40), poses, y, 16.5)
        ahead = y - poses[chosen, 1]
        assert np.diff(chosen).tolist() == [1] * 4
        assert ((ahead > 7) & (ahead < 26)).all()
    assert len(series_scans(np.arange(6), poses, 200.0, 16.5)) == 5
    rng = np.random.default_rng(0)
    stays = rng.rayleigh(size=(30, 30))
    assert likeness(np.stack([stays, 2 * stays, stays])) == pytest.approx(1)
    assert abs(likeness(rng.rayleigh(size=(3, 30, 30)))) < 0.1


def test_table_one_holds_what_scoring_says_of_each_confidence(pool):
    table = table_one(pool)
    for method in "ABCD":
        for name in ("C_HH", "P_H", "M_VV"):
            curve = roc_of(
                pool.match_of(pool.confidence([f"{name}_F1"], method)), MINES, area="paper"
            )
            assert table.loc[method, name] == pytest.approx(
                held_pd_mean(curve), abs=0.03
            )  # P_H lacks one alarm
    strong = [
        "C_HH",
        "M_HH",
        "C_VV",
    ]  # a weak feature's sign may turn with the weights, a strong one's ROC may not
    np.testing.assert_allclose(table.loc["A", strong], table.loc["B", strong], atol=1e-12)
    assert table.loc["A"].idxmax() == "C_HH"


def test_cross_validation_never_scores_a_lane_with_its_own_alarms(results):
    pool = Pool(results)
    altered = [results[0], results[1], fake_lane("c3", 77)]
    for one, other in zip(pool.folds(["C_HH_F1", "M_VV_F1"], True, True),
                          Pool(altered).folds(["C_HH_F1", "M_VV_F1"], True, True), strict=True):  # fmt: skip
        lane = pool.labels["lane"].to_numpy()[one.samples]
        assert len(set(lane)) == 1
        same = np.array_equal(one.scatter, other.scatter)
        assert same == (lane[0] == "c3")  # only the fold that tests c3 has not learned from it


def test_nested_choice_leaves_the_tested_lane_out(results):
    columns = [f"{name}_F1" for name in FEATURES]
    score, confidence, chosen = Pool(results).nested(columns, 2)
    altered = [*results[:2], fake_lane("c3", 99)]
    assert Pool(altered).nested(columns, 2)[2][2] == chosen[2]
    assert 0 <= score <= 1
    assert np.isfinite(confidence).sum() >= len(confidence) - 3


def fake_examples(path):
    rng = np.random.default_rng(0)
    arrays = {"polarization": np.array(["HH", "VV", "HV"]), "subband": np.array(BANDS)}
    arrays |= {
        "x": np.linspace(-6, 6, 25),
        "y": np.linspace(7, 26, 39),
        "titles": np.array(list("abcde")),
    }
    arrays["names"] = np.array(["surface", "metal", "shallow", "plastic", "false"])
    for name in arrays["names"]:
        arrays |= {
            f"raw_{name}": rng.random((3, 5, 39, 25)),
            f"clean_{name}": rng.random((3, 5, 39, 25)),
        }
        arrays |= {
            f"place_{name}": np.array([0.0, 11.0]),
            f"patches_{name}": rng.random((3, 3, 5, 25, 25)),
        }
        arrays[f"distances_{name}"] = np.array([9.0, 11.0, 13.0])
    arrays |= {"series": rng.random((5, 39, 25)), "series_place": np.zeros((5, 2))}
    arrays |= {"signature": rng.random((39, 25)), "gain": rng.random((39, 25))}
    path.parent.mkdir(parents=True)
    write_bundle(path, arrays)


@pytest.mark.slow("runs a quick form of the whole study")
def test_the_page_holds_every_table_figure_and_finding(tmp_path, results, pool, monkeypatch):
    draws = Pool.draws
    monkeypatch.setattr(
        Pool, "draws", lambda pool, count, **rest: draws(pool, min(count, 3), **rest)
    )
    fake_examples(tmp_path / "results" / "examples.bundle")
    blind = fake_lane("b1", 5)
    has_mine = blind.truth["kind"] != "simulant"
    blind = replace(blind, truth=blind.truth[has_mine].reset_index(drop=True))
    made_up = {one.name: one for one in (*results, blind)}
    monkeypatch.setattr(study, "make_part", lambda _, name, *rest: made_up[name])
    as_found = tmp_path / "as-found"
    as_found.mkdir()
    (as_found / "wang2007.html").write_text("")
    beside = Finding("C_HH is the best single feature", "", "no", "cannot say")
    write_findings(as_found, [beside], True, world="as-found")
    page = study.STUDY.reproduce(tmp_path, quick=True).read_text("utf-8")
    judged = [one for one in read_findings(tmp_path) if one.verdict != "open"]
    assert "The world of this page: prepared test lanes" in page
    assert "<code>prepared-earth</code>" in page
    assert page.count("<td>no</td>") == 1  # no verdicts in a quick run
    assert page.count("<td>not asked</td>") == len(judged)  # and that of the mean look is asked
    assert page.count("<img src=") == 14
    assert all(f"Table {number}." in page for number in ("I", "II", "III", "IV"))
    assert page.count(f"<b>{NO_VERDICT}</b>") == len(judged) >= 25
    assert "Quick run" in page
    assert "still to be run" not in page
    best = table_one(pool).loc["A", "C_HH"]
    assert f"PD_mean of C_HH {best:.2f}." in page
    assert "Pd at 0.05 per m², 95 %, chance" in page
    assert all(one.interval is not None for one in judged)
    shares = [
        one for one in judged if not re.search("level of clutter|part as features grow", one.claim)
    ]
    assert len(shares) == len(judged) - 2
    assert all(
        abs(end) <= 1 + 0.15 for one in shares for end in one.interval
    )  # a limit less a share may pass 1 by it
    assert page.count("<section class=twin>") == page.count("<th>paper</th><th>here</th>") == 14
    assert not re.search(r"\bnan\b", re.sub(r'src="data:[^"]*"', "", page))
    assert "http" not in re.sub(r'src="data:[^"]*"', "", page)


@pytest.mark.slow("runs a quick form of the whole study")
def test_a_replicate_judges_all_but_the_blind_lanes(results, monkeypatch):
    draws = Pool.draws
    monkeypatch.setattr(
        Pool, "draws", lambda pool, count, **rest: draws(pool, min(count, 3), **rest)
    )
    recipe = parse_recipe(packaged_text("wang2007"))
    found, tables = all_findings(results, [], recipe, 5)
    assert not tables.blind
    assert not [one for one in found if "blind lanes, classifier" in one.claim]
    (alike,) = [one for one in found if one.claim.startswith("Classifiers A and B")]
    assert len(alike.parts) == 2
    repeated = over_experiments([found[0], found[0]])
    assert repeated.names == found[0].names
    assert repeated.shown[1] == 2


def test_blind_lanes_are_scored_by_a_classifier_trained_elsewhere(results):
    blind = [fake_lane("b1", 5)]
    plain = matched(blind, [blind[0].alarms.assign(confidence=blind[0].features[CLASSIFIER_A[0]])])
    assert set(blind_scores(results, blind)) == {"A", "B"}
    a = roc_of(blind_scores(results, blind)["A"], MINES)
    np.testing.assert_allclose(a["pd"], roc_of(plain, MINES)["pd"])  # one feature: monotone
    np.testing.assert_allclose(a["far"], roc_of(plain, MINES)["far"])


def test_the_study_takes_the_packaged_recipe_and_the_other_readings_beside_it():
    own = parse_recipe(packaged_text("wang2007"))
    packaged = load_recipe("wang2007-printed")
    assert own.features.variants
    assert not packaged.features.variants
    plain = own.model_copy(update={"features": own.features.model_copy(update={"variants": False})})
    assert plain == packaged


@pytest.mark.slow("runs a quick form of the whole study")
def test_a_blind_lane_in_one_sub_band_gives_what_it_gives_in_all(tmp_path, monkeypatch):
    def sensor(band=None):
        array = lanes.sensor(band)
        return array.model_copy(update={"rx": array.rx[::3]})

    monkeypatch.setattr(study, "sensor", sensor)
    one = study.make_part(tmp_path, "b1", True)
    assert len(one.alarms) > 20
    scene, seed = lanes.quick_scenes()[1]["b1"]
    assert {name.rpartition("_")[2] for name in one.features if name[-2] == "F"} == {"F1"}
    table = parse_recipe(packaged_text("wang2007")).image
    few = sensor((0.75e9, 1.35e9))
    wide = sensor()
    # The same recording with its other tones left out: both images are right to the imaging
    # tolerance.
    scene = scene.model_copy(
        update={"track": scene.track.model_copy(update={"positions": (0.0, 2.8)})}
    )
    run = open_run(store_lane(tmp_path / "all", scene, seed, wide, silent)[0])
    part = run.sel(frequency=few.tones.axis())
    assert part.sizes["frequency"] == few.tones.count < wide.tones.count / 4
    all_bands, alone = (
        ScanImager(data, table.grid(), bands, table.window, table.tolerance)
        for data, bands in ((run, table.subbands), (part, {"F1": table.subbands["F1"]}))
    )
    for full, narrow in zip(all_bands, alone, strict=True):
        image = full.sel(subband="F1")
        np.testing.assert_allclose(
            narrow.sel(subband="F1"), image, atol=2e-3 * float(abs(image).max())
        )


@pytest.mark.slow("runs a quick form of the whole study")
def test_a_stored_lane_is_not_made_again_unless_it_changed(tmp_path, monkeypatch):
    scene, seed = lanes.quick_scenes()[1]["b1"]
    data = scene.model_dump(exclude_unset=True) | {
        "length": 6.0,
        "track": {"step": (9.0, 9.0), "start": -12.0},
    }
    small = type(scene).model_validate(data)
    sensor = lanes.sensor()
    few = sensor.model_copy(
        update={
            "tones": sensor.tones.model_copy(update={"start": 0.75e9, "step": 5e6, "count": 16})
        }
    )
    calls = []
    plain = Simulator.scan
    monkeypatch.setattr(
        Simulator, "scan", lambda self, index: calls.append(index) or plain(self, index)
    )
    path, truth, lane = store_lane(tmp_path, small, seed, few, silent)
    made = len(calls)
    assert made > 0
    assert path.is_dir()
    assert lane.y_max == 6.0
    assert len(truth) == 4
    store_lane(tmp_path, small, seed, few, silent)
    assert len(calls) == made
    store_lane(tmp_path, small, seed + 1, few, silent)
    assert len(calls) == 2 * made
