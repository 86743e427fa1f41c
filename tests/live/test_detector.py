"""Detection scan by scan: against batch, out of order, after gaps, and from a snapshot on."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial import cKDTree

from flgpr.detect import FisherDiscriminant, HistogramNormalizer
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.intake import Intake
from flgpr.live.state import (
    take_snapshot,
)
from flgpr.method.alarm_sums import AlarmSums
from flgpr.method.classifier import Classifier, make_training_set
from flgpr.method.estimators import train_estimator
from flgpr.method.method import detect
from flgpr.model import lane_to_scan
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.stages import ClutterStage, FeatureStage
from flgpr.store import Scan, describe_for_live
from live_lane import LANE, SCANS, STEP, TARGETS, make_lane_run, small_recipe

SETTLED = 8.0  # m: the first sixteen scans or so have taught the background


@pytest.fixture(scope="module")
def run():
    return make_lane_run()


@pytest.fixture(scope="module")
def recipe():
    return parse_recipe(small_recipe())


@pytest.fixture(scope="module")
def scans(run):
    time, pose, signal = (run[name].values for name in ("time", "pose", "signal"))
    return [Scan(k, float(time[k]), pose[k], signal[k]) for k in range(SCANS)]


def start(run, recipe, **options):
    return LiveDetector(describe_for_live(run), recipe, options.pop("lane", LANE), **options)


def play(detector, scans):
    updates = [detector.add(scan) for scan in scans]
    detector.finish()
    return updates


@pytest.fixture(scope="module")
def played(run, recipe, scans):
    detector = start(run, recipe)
    return detector, play(detector, scans)


@pytest.fixture(scope="module")
def whole(run, recipe):
    return detect(run, recipe, LANE)


@pytest.fixture(scope="module")
def batch(whole):
    return whole.alarms


def seen(table, scans):
    """Alarms on ground that at least three scans saw, after the estimates have settled."""
    last = scans[-3].pose[1] + 4.5
    return table[(table["y"] > SETTLED) & (table["y"] < last - 0.5)]


def near(table, other, radius=0.25):
    away, _ = cKDTree(other[["x", "y"]]).query(table[["x", "y"]])
    return away < radius


def test_live_agrees_with_batch_once_it_has_settled(played, batch, scans):
    live = seen(played[0].table(), scans)
    whole = seen(batch, scans)
    assert len(whole) > 15
    assert near(whole, live).mean() >= 0.8
    top = whole.head(8)
    assert near(top, live).all()
    # Confidences agree as well, not only places.
    _, at = cKDTree(live[["x", "y"]]).query(top[["x", "y"]])
    ratio = live["confidence"].to_numpy()[at] / top["confidence"].to_numpy()
    assert np.abs(np.log(ratio)).max() < np.log(1.35)


def test_with_the_whole_background_live_finds_what_batch_finds(run, recipe, scans, batch):
    """The estimates make the difference: learnt from the same lane before, the alarms are nearly the same."""
    detector = start(run, recipe)
    for scan in scans:
        detector.background.add(detector._image(scan))
    play(detector, scans)
    live = seen(detector.table(), scans)
    whole = seen(batch, scans)
    assert near(whole, live, 0.15).mean() >= 0.9


def test_mines_are_raised_ahead_of_the_vehicle_and_named_once(played):
    _, updates = played
    events = [(scan, alarm) for scan, update in enumerate(updates) for alarm in update.alarms]
    for x, y in TARGETS:
        own = [(scan, a) for scan, a in events if np.hypot(a.x - x, a.y - y) < 0.2]
        assert own[0][1].state == "new"
        assert own[0][1].first_left > 2.5
        assert len({a.alarm_id for _, a in own}) == 1
    states = {}
    for _, alarm in events:
        assert states.get(alarm.alarm_id) not in ("final", "withdrawn")
        assert (alarm.state == "new") == (alarm.alarm_id not in states) or alarm.state == "final"
        states[alarm.alarm_id] = alarm.state


def test_the_alarms_are_those_of_the_events(played):
    detector, updates = played
    told = {}
    for update in updates:
        for alarm in update.alarms:
            told[alarm.alarm_id] = alarm
    standing = {name: one for name, one in told.items() if one.state != "withdrawn"}
    table = detector.table().set_index("alarm_id")
    assert set(table.index) == set(standing)
    for name, one in standing.items():
        assert table.loc[name, "confidence"] == one.confidence
    assert table["confidence"].is_monotonic_decreasing


def test_the_view_is_the_run_view_of_the_scans_in_memory(played, whole):
    """Rows that came last for a place make up a run-view like batch's."""
    _, updates = played
    found = np.full((200, 25), np.nan)
    for update in updates:
        if update.view is not None:
            skip = max(-update.row, 0)
            found[update.row + skip : update.row + len(update.view)] = update.view[skip:]
    theirs = whole.view.sel(polarization="HH", subband="F1").values
    rows = slice(70, 150)
    both = np.isfinite(found[rows]) & np.isfinite(theirs[rows])
    assert both.mean() > 0.95
    ratio = 20 * np.log10(found[rows][both] / theirs[rows][both])
    assert np.median(np.abs(ratio)) < 1.0


def test_neighbours_that_change_places_change_little(run, recipe, scans, played):
    order = list(scans)
    for at in range(10, 38, 6):
        order[at], order[at + 1] = order[at + 1], order[at]
    detector = start(run, recipe)
    updates = play(detector, order)
    assert {update.outcome for update in updates} == {"taken", "warm-up"}
    mine = seen(detector.table(), scans)
    usual = seen(played[0].table(), scans)
    assert near(usual.head(10), mine, 0.2).all()


def test_late_and_standing_scans_are_told_and_change_nothing(run, recipe, scans):
    detector = start(run, recipe)
    for scan in scans[:30]:
        detector.add(scan)
    before = take_snapshot(detector, Intake(detector.description), set(), "")[0] | {"gate": None}
    assert detector.add(scans[2]).outcome == "late"
    again = Scan(30, 9.0, scans[29].pose + [0.0, 0.1, 0, 0, 0, 0], scans[29].signal)
    assert detector.add(again).outcome == "still"
    after = take_snapshot(detector, Intake(detector.description), set(), "")[0] | {
        "gate": None
    }  # it knows the poses
    assert after == before


def test_after_a_long_gap_the_passed_alarms_are_final(run, recipe, scans):
    detector = start(run, recipe, lane=None)
    for scan in scans[:20]:
        detector.add(scan)
    still_open = set(detector.alarms.open)
    assert still_open
    far = [
        Scan(100 + k, 0.0, one.pose + [0, 200.0, 0, 0, 0, 0], one.signal)
        for k, one in enumerate(scans[20:26])
    ]
    updates = [detector.add(one) for one in far]
    assert {a.alarm_id for a in updates[0].alarms if a.state == "final"} == still_open
    assert max(update.view.shape[0] for update in updates) < 700
    assert all(one.pose[1] > 150 for one in detector.history)


def test_a_classifier_gives_the_confidence_that_batch_gives(run, recipe, scans):
    rng = np.random.default_rng(3)
    names = ("C_HH_F1", "M_VV_F1", "P_alpha_F1")
    values = rng.normal(size=(80, 3)) + 2 * (np.arange(80) < 30)[:, None] + [3, 3, 1]
    label = (np.arange(80) < 30).astype(int)
    normalizer = HistogramNormalizer().fit(values)
    model = Classifier(
        names, normalizer, FisherDiscriminant().fit(normalizer.transform(values), label)
    )
    detector = start(run, recipe, model=model)
    assert detector.steps.subbands == ["F1"]
    play(detector, scans)
    live = seen(detector.table(), scans)
    whole = seen(detect(run, recipe, LANE, model=model).alarms, scans)
    top = whole.head(6)
    assert near(top, live).all()
    _, at = cKDTree(live[["x", "y"]]).query(top[["x", "y"]])
    spread = whole["confidence"].std()
    assert np.abs(live["confidence"].to_numpy()[at] - top["confidence"].to_numpy()).max() < spread


def test_features_taken_in_scan_by_scan_are_those_of_all_scans_at_once(run, recipe, scans):
    """A detector that forgets what it has gathered goes through all scans in memory again, late ones among them."""
    order = [*scans[:30], scans[32], scans[30], scans[31], *scans[33:]]
    detector = start(run, recipe)
    plain = start(run, recipe)
    for scan in order:
        plain._sums = None
        assert detector.add(scan).alarms == plain.add(scan).alarms
    pd.testing.assert_frame_equal(detector.table(), plain.table(), check_exact=True)


def test_a_scan_at_which_the_features_fail_does_not_spoil_those_after_it(
    run, recipe, scans, monkeypatch
):
    broken = start(run, recipe)
    plain = start(run, recipe)
    for number, scan in enumerate(scans[:40]):
        plain._sums = None
        expected = plain.add(scan).alarms
        if number != 20:
            found = broken.add(scan).alarms
            assert number < 20 or {one.scans for one in found} == {one.scans for one in expected}
            continue
        with monkeypatch.context() as patch:
            patch.setattr(
                "flgpr.method.alarm_sums.AlarmSums.add",
                lambda *_: (_ for _ in ()).throw(ValueError("no")),
            )
            with pytest.raises(ValueError, match="no"):
                broken.add(scan)
    assert [one.scans for one in broken.alarms.open.values()] == [
        one.scans for one in plain.alarms.open.values()
    ]


PLUGIN = Path(__file__).parents[1] / "plugin"
STAGE = '\n[[columns]]\nstage = "sharpness"\nradius = 0.3\n'
DETECTOR = '\n[detector]\nestimator = "logistic"\nfeatures = ["sharp_HH", "C_HH_F1"]\n'


@pytest.fixture(scope="module")
def sharp(run, tmp_path_factory):
    """A recipe with the sample plug-in's stage and an estimator of scikit-learn, and what batch finds with it."""
    about = tmp_path_factory.mktemp("site") / "flgpr_sharpness-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: flgpr-sharpness\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[flgpr.stages]\nsharpness = flgpr_sharpness:Sharpness\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        for folder in (PLUGIN, about.parent):
            patch.syspath_prepend(str(folder))
        recipe = parse_recipe(small_recipe() + STAGE + DETECTOR)
    found = detect(run, recipe, LANE)
    truth = pd.DataFrame(TARGETS, columns=["x", "y"]).assign(
        kind="metal", depth=0.05, target_id=list("abcde")
    )
    truth = truth.assign(radius=0.15, height=0.1, lane="one")
    examples = make_training_set([("one", found.alarms, found.features, truth, LANE)], 0.5)
    return recipe, train_estimator(examples, recipe.detector, recipe.detector.features)


@pytest.fixture(scope="module")
def sharp_played(run, scans, sharp):
    detector = start(run, sharp[0], model=sharp[1])
    return detector, play(detector, scans)


@pytest.mark.slow("trains an estimator on the lane")
def test_named_features_and_an_estimator_run_live(run, scans, sharp, sharp_played):
    recipe, model = sharp
    detector, _ = sharp_played
    assert detector.steps.subbands == list(recipe.image.subbands)  # a stage sees the whole image
    live, whole = (
        seen(t, scans) for t in (detector.table(), detect(run, recipe, LANE, model=model).alarms)
    )
    top = whole.head(5)
    assert near(top, live).all()
    _, at = cKDTree(live[["x", "y"]]).query(top[["x", "y"]])
    spread = whole["confidence"].std()
    assert np.abs(live["confidence"].to_numpy()[at] - top["confidence"].to_numpy()).max() < spread


def test_a_named_feature_is_the_mean_over_the_scans_so_far(run, scans, sharp):
    detector = start(run, sharp[0], model=sharp[1])
    for scan in scans[:30]:
        detector.add(scan)
    (stage,) = detector.steps.stages.values()
    alarms = pd.DataFrame([vars(one) for one in detector.alarms.open.values()])
    sums = AlarmSums(detector.steps, alarms)
    each = []
    for one in detector.history:
        sums.add(one)
        local = [lane_to_scan([x, y, 0.0], one.pose)[:2] for x, y in alarms[["x", "y"]].to_numpy()]
        each.append(stage.of_image(detector.steps.labelled(one), np.array(local))["sharp_VV"])
    some = np.isfinite(each).any(axis=0)
    assert some.sum() > 3
    np.testing.assert_allclose(
        sums.table()["sharp_VV"][some],
        np.nanmean(np.array(each, float)[:, some], axis=0),
        rtol=1e-12,
    )


def test_only_what_decides_is_gathered(run, sharp):
    """Without a model no stage is asked, and one whose columns the model does not read is not either."""
    recipe = sharp[0]
    assert not start(run, recipe).steps.stages
    assert start(run, recipe).steps.subbands == ["F1"]
    other = Classifier(("C_HH_F1",), HistogramNormalizer(), FisherDiscriminant())
    assert not start(run, recipe, model=other).steps.stages


class OfTheView(FeatureStage):
    def of_view(self, view, places):
        return {"height": places[:, 0]}


class Quiet(ClutterStage):
    pass


@pytest.mark.parametrize(
    ("kind", "stage", "table", "reason"),
    [
        (
            "features",
            OfTheView,
            "columns",
            r"features\.own: columns of the run-view .* only when a place is passed",
        ),
        (
            "clutter",
            Quiet,
            "clutter",
            r"clutter\.own: a stage of the kind clutter is not run on scans as they come",
        ),
    ],
)
def test_a_stage_that_cannot_be_causal_is_refused_with_its_reason(
    run, monkeypatch, kind, stage, table, reason
):
    monkeypatch.setattr("flgpr.stages.named.find_stage", lambda *_: stage)
    recipe = parse_recipe(small_recipe() + f'\n[[{table}]]\nstage = "own"\n')
    with pytest.raises(ValueError, match=f"cannot run live: {reason}"):
        start(run, recipe)


def test_the_magnitude_can_be_the_confidence(run, scans):
    detector = start(run, parse_recipe('confidence = "magnitude"\n' + small_recipe()))
    play(detector, scans[:25])
    table = detector.table()
    assert len(table) > 5
    np.testing.assert_array_equal(table["confidence"], table["magnitude"])


def test_only_the_sub_bands_that_decide_are_imaged(run, recipe):
    assert start(run, recipe).steps.subbands == ["F1"]
    names = ("C_HH_F1", "P_H_F2")
    model = Classifier(names, HistogramNormalizer(), FisherDiscriminant())
    assert start(run, recipe, model=model).steps.subbands == ["F1", "F2"]
    with pytest.raises(ValueError, match=r"paper\.P_H_F1"):
        start(
            run,
            recipe,
            model=Classifier(("paper.P_H_F1",), HistogramNormalizer(), FisherDiscriminant()),
        )


def test_recipes_that_cannot_run_live_are_refused(run, recipe, scans):
    with pytest.raises(ValueError, match="self_signature"):
        start(run, load_recipe("demo"))
    alone = run.isel(polarization=[1])
    with pytest.raises(ValueError, match=r"prescreen\.polarization.*VV.*'HH'"):
        start(alone, recipe)
    with pytest.raises(ValueError, match="pose"):
        start(run, recipe).add(Scan(0, 0.0, None, scans[0].signal))
    for settings in ({"looks": 0}, {"least_step": 0.0}, {"warm_up": 2}, {"span": 1}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            LiveSettings(**settings)


def test_the_density_rule_counts_on_the_ground_seen(run, recipe, scans):
    detector = start(run, recipe)
    for scan in scans:
        detector.add(scan)
    area = detector.density.final_area
    width = 2.4 + 0.1
    assert area == pytest.approx(width * (detector.closed - LANE.y_min), rel=0.15)
    most = 0.75 * (area + width * (4.5 + STEP)) / (np.pi * 0.4**2)
    assert len(detector.table()) <= most * 1.2
