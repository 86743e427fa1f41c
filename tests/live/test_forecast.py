"""What further looks will make of an alarm: the numbers, what is learnt of alarms, what events tell."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.forecast import (
    NAME,
    Followed,
    Forecast,
    follow,
    forecast_event,
    forecast_of,
    foresees,
    learn,
)
from flgpr.method.classifier import TrainingSet
from flgpr.method.estimators import train_estimator
from flgpr.method.model import Model, load_model, save_model
from flgpr.model import complete_scans
from flgpr.recipe.schema import parse_recipe
from flgpr.recipe.tables import DetectorTable
from flgpr.store import describe_for_live
from flgpr.store.scan_file import stored_scan
from live_lane import LANE, make_lane_run, small_recipe
from small_lane import cut_down

KNOWN = Forecast((-1.2, -0.35, 0.4), (-0.2, 1.0), 0.6)
RECIPE = cut_down(small_recipe(), [("y_max = 4.5", 'y_max = 4.5\nlook = "mean"\nfalloff = 2')])
LOGISTIC = DetectorTable(estimator="logistic", features=("magnitude",))


def stored_scans(run):
    """The complete scans of a stored run, as if they arrived."""
    return [stored_scan(run, int(number)) for number in np.flatnonzero(complete_scans(run))]


def trained(features=("magnitude",), table=LOGISTIC):
    """Log odds that grow with the magnitude."""
    rng = np.random.default_rng(2)
    label = np.repeat([0, 1], 40)
    values = pd.DataFrame({name: rng.normal(3.0 + 2.0 * label, 1.5) for name in features})
    return train_estimator(
        TrainingSet(values, label, np.ones(80, int), np.repeat("a", 80)), table, features
    )


@pytest.fixture(scope="module")
def run():
    return make_lane_run()


@pytest.fixture(scope="module")
def model():
    return Model(trained(), {NAME: KNOWN.arrays()})


def started(run, model, **settings):
    return LiveDetector(
        describe_for_live(run), parse_recipe(RECIPE), LANE, model, LiveSettings(**settings)
    )


def drawn(count, seed, looks=2):
    """Alarms that become what KNOWN says, by its covariance of single looks."""
    rng = np.random.default_rng(seed)
    (a, b, c), (g, h), rho = KNOWN.mean, KNOWN.spread, KNOWN.correlation
    alike = np.linalg.cholesky(rho + (1 - rho) * np.eye(looks))
    for z in rng.normal(-1.5, 2.0, count):
        p = 1 / (1 + math.exp(-z))
        seen = rng.uniform(0.02, 0.04)
        weights = rng.uniform(0.008, 0.02, looks)
        values = z + a + (b + c * p) * z + math.exp(g + h * p) * (alike @ rng.normal(size=looks))
        for k in range(1, looks + 1):
            w = weights[:k]
            yield Followed(z, seen, w.sum(), w @ w, (seen * z + w @ values[:k]) / (seen + w.sum()))


def test_log_odds_after_further_looks_are_the_weighed_mean_with_them():
    rng = np.random.default_rng(3)
    z = -0.8
    weights = np.array([0.01, 0.015, 0.02])
    mean, deviation = KNOWN.after(z, 0.03, weights)
    p = 1 / (1 + math.exp(-z))
    alike = np.linalg.cholesky(0.6 + 0.4 * np.eye(3))
    values = (
        z
        - 1.2
        + (-0.35 + 0.4 * p) * z
        + math.exp(-0.2 + p) * (rng.normal(size=(200_000, 3)) @ alike.T)
    )
    later = (0.03 * z + values @ weights) / (0.03 + weights.sum())
    assert mean == pytest.approx(later.mean(), abs=5 * deviation / 200_000**0.5)
    assert deviation == pytest.approx(later.std(), rel=0.01)


def test_the_numbers_are_learnt_of_what_alarms_became():
    arrays, notes = learn(drawn(4000, 4))
    assert notes["looks"] == 8000
    assert notes["within"] == pytest.approx(0.8, abs=0.02)
    np.testing.assert_allclose(arrays["mean"], KNOWN.mean, atol=0.15)
    np.testing.assert_allclose(arrays["spread"], KNOWN.spread, atol=0.15)
    assert float(arrays["correlation"]) == pytest.approx(0.6, abs=0.1)
    assert learn(drawn(10, 5)) == ({}, {"looks": 20})


def test_looks_to_come_weigh_as_they_then_do(run, model):
    detector = started(run, model, looks=1)
    checked = 0
    for scan in (one for one in stored_scans(run) if one.number < 30):
        before = {
            one.alarm_id: (one, detector.expected_looks(one))
            for one in detector.alarms.open.values()
        }
        seen = {name: detector.mean_of_looks(one)[1] for name, (one, _) in before.items()}
        detector.add(scan)
        for name, (alarm, looks) in before.items():
            if alarm.y > detector.closed and looks:
                np.testing.assert_allclose(
                    np.diff([0.0] + [way for way, _ in looks]), 0.4, atol=0.05
                )
                came = detector.mean_of_looks(alarm)[1] - seen[name]
                assert came == pytest.approx(looks[0][1], rel=0.1) or came == pytest.approx(
                    0.0, abs=1e-12
                )
                checked += came > 0
    assert checked > 100


def test_an_alarm_stands_at_the_mean_of_its_looks(run, model):
    detector = started(run, model)
    for scan in stored_scans(run):
        detector.add(scan)
        for alarm in detector.alarms.open.values():
            assert detector.mean_of_looks(alarm)[0] == pytest.approx(alarm.magnitude, rel=1e-5)


@pytest.mark.slow("plays a drive to its end")
def test_what_is_followed_is_what_alarms_became(run, model):
    followed = list(follow(started(run, model, looks=2), run))
    assert len(followed) > 100
    detector = started(run, model, looks=2)
    odds = set()
    for scan in stored_scans(run):
        detector.add(scan)
        odds |= {one.confidence for one in detector.alarms.open.values()}
    assert {one.odds for one in followed} <= odds
    assert np.mean([one.later in odds for one in followed]) > 0.5  # others were withdrawn
    assert max(one.total**2 / one.squares for one in followed) > 2  # so many looks of one weight
    arrays, notes = learn(followed)
    assert 0.7 < notes["within"] < 0.9
    assert set(arrays) == {"mean", "spread", "correlation"}


def test_to_wait_needs_room_and_a_doubt(run, model):
    detector = started(run, model, looks=1)
    for scan in stored_scans(run):
        detector.add(scan)
        if scan.number == 20:
            break
    alarm = next(
        one for one in detector.alarms.open.values() if len(detector.expected_looks(one)) >= 3
    )
    step = detector.expected_looks(alarm)[0][0]
    sure = forecast_event(KNOWN, detector, replace(alarm, confidence=20.0), 9.0, 0.0, 0.1)
    doubt = forecast_event(KNOWN, detector, replace(alarm, confidence=0.2), 9.0, 0.0, 0.1)
    assert (sure["wait"], doubt["wait"]) == (False, True)
    assert sure["change"] < 0.05 < 0.3 < doubt["change"]
    near = forecast_event(KNOWN, detector, replace(alarm, confidence=0.2), 0.9 * step, 0.0, 0.1)
    assert (near["wait"], near["looks_left"], "last_p" in near) == (False, 0, False)
    assert near["next_p"] == doubt["next_p"]
    assert forecast_event(KNOWN, detector, alarm, 2.5 * step, 0.0, 0.1)["looks_left"] == 2
    assert "wait" not in forecast_event(KNOWN, detector, alarm, None, 0.0, 0.1)
    low, high = doubt["last_p"]
    assert low < doubt["next_p"][0]
    assert high - low > 0
    assert not forecast_event(KNOWN, detector, replace(alarm, confidence=0.2), 9.0, 8.0, 0.1)[
        "wait"
    ]


def test_no_look_comes_to_who_stands_or_drives_back(run, model):
    detector = started(run, model, looks=1)
    for scan in stored_scans(run):
        detector.add(scan)
        if scan.number == 20:
            break
    alarm = next(
        one for one in detector.alarms.open.values() if len(detector.expected_looks(one)) >= 3
    )
    history = detector.history
    newest = detector.history[-1].pose
    for step in (0.0, 1e-9, -0.4):
        detector.history = [
            replace(one, pose=newest + [0, step * k, 0, 0, 0, 0]) for k, one in enumerate(history)
        ]
        assert detector.expected_looks(alarm) == []
        assert forecast_event(KNOWN, detector, alarm, 9.0, 0.0, 0.1)["wait"] is False


def test_odds_beyond_all_bounds_end_no_training():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        for seed in range(6):
            rng = np.random.default_rng(seed)
            odds = rng.normal(-300, 400, 160)
            later = rng.normal(-300, 400, 160)
            seen = rng.uniform(0.01, 0.02, 160)
            arrays, notes = learn(map(Followed, odds, seen, seen, seen**2, later))
            assert notes["looks"] == 160
            assert all(np.isfinite(one).all() for one in arrays.values())


def test_a_model_keeps_it_and_one_of_other_shapes_is_refused(model, tmp_path):
    recipe = parse_recipe(RECIPE)
    kept = load_model(save_model(model, tmp_path / "model"))
    assert forecast_of(recipe, kept) == KNOWN
    for name, value in (("mean", np.zeros(2)), ("spread", np.array([0.0, np.nan]))):
        wrong = replace(model, stages={NAME: KNOWN.arrays() | {name: value}})
        with pytest.raises(
            ValueError, match=r"model must hold finite live\.forecast of shapes .* train it again"
        ):
            forecast_of(recipe, wrong)
    with pytest.warns(UserWarning, match="its lanes gave too few"):
        assert forecast_of(recipe, Model(model.detector, {}, {NAME: {"looks": 3}})) is None


def test_it_is_told_of_means_whose_confidence_is_their_log_odds_alone(model):
    recipe = parse_recipe(RECIPE)
    assert foresees(recipe, model)
    assert not foresees(parse_recipe(small_recipe()), model)
    assert not foresees(recipe, Model())
    assert not foresees(
        recipe, Model(trained(table=DetectorTable(estimator="lda", features=("magnitude",))))
    )
    assert not foresees(recipe, Model(trained(("magnitude", "scans"), LOGISTIC)))
    assert forecast_of(parse_recipe(small_recipe()), model) is None
