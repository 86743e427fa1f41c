"""Faults of a radar while driving: told once by name, and the scans used without what is at fault."""

import json

import numpy as np
import pytest

from flgpr.live.intake import Intake
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.store import Scan, describe_for_live, encode_scan, read_table
from flgpr.store.scan_file import stored_scan
from live_lane import SCANS, TARGETS, make_lane_run, small_recipe

MIDDLE = SCANS // 2
SLOW = pytest.mark.slow("whole live runs")


@pytest.fixture(scope="module")
def run():
    return make_lane_run()


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "recipe.toml"
    path.write_text(small_recipe())
    return path


def frames_of(run, change=None):
    """Encode the scans of a run; a function changes the number, signal and pose of each."""
    run_id = describe_for_live(run).run_id
    for place in range(run.sizes["scan"]):
        scan = stored_scan(run, place)
        parts = [scan.number, scan.signal.copy(), None if scan.pose is None else scan.pose.copy()]
        if change is not None:
            parts = change(place, *parts)
        number, signal, pose = parts
        yield encode_scan(number, signal, pose, scan.time, run_id)


def live(folder, recipe, run, change=None, **more):
    """Return events and alarms of a live run."""
    incoming = folder / "incoming"
    incoming.mkdir(parents=True)
    (incoming / "run.json").write_text(json.dumps(describe_for_live(run).as_json()))
    for place, frame in enumerate(frames_of(run, change)):
        (incoming / f"{place:04d}.scan").write_bytes(frame)
    (incoming / "end.json").write_text("{}")
    LiveRun(LiveOptions(recipe, folder / "out", incoming, **more)).run()
    events = [json.loads(line) for line in (folder / "out/live.jsonl").read_text().splitlines()]
    return events, read_table(folder / "out/alarms.csv", "alarms")


def told(events):
    return [event["finding"] for event in events if event.get("kind") == "health"]


def counts(events):
    return [event for event in events if event["event"] == "end"][-1]


def found(alarms):
    """Return how many targets have one of the ten strongest alarms within 0.5 m."""
    best = alarms.sort_values("confidence", ascending=False).head(10)[["x", "y"]].to_numpy()
    return int((np.linalg.norm(best[:, None] - TARGETS, axis=-1).min(axis=0) < 0.5).sum())


@pytest.fixture(scope="module")
def clean(tmp_path_factory, run, recipe):
    return live(tmp_path_factory.mktemp("clean"), recipe, run)


def pair_lost(place, number, signal, pose):
    if place >= MIDDLE:
        signal[:, 3] = np.nan
    return number, signal, pose


def pair_hot(place, number, signal, pose):
    signal[:, 3] *= 1e4
    return number, signal, pose


def tone_lost(place, number, signal, pose):
    signal[:, 3, 20] = np.nan
    return number, signal, pose


def restarted(place, number, signal, pose):
    return (number - MIDDLE if place >= MIDDLE else number), signal, pose


def test_a_clean_run_tells_nothing(clean):
    events, alarms = clean
    assert told(events) == []
    assert found(alarms) >= 4


@pytest.mark.parametrize(
    ("change", "finding", "lost"),
    [
        (pair_lost, "missing pairs", 2),
        pytest.param(pair_hot, "hot pairs", 0, marks=SLOW),
        pytest.param(tone_lost, "missing tones", 2, marks=SLOW),
        pytest.param(restarted, "restart", 1, marks=SLOW),
    ],
)
def test_what_is_at_fault_is_left_out_and_the_rest_is_used(
    tmp_path, run, recipe, clean, change, finding, lost
):
    events, alarms = live(tmp_path, recipe, run, change)
    assert told(events) == [finding]
    [event] = [event for event in events if event.get("kind") == "health"]
    assert event["done"]
    assert not event["stop"]
    # Three scans in a row until a pair counts as lost; the first of a new series tells it.
    assert counts(events)["taken"] == counts(clean[0])["taken"] - lost
    assert found(alarms) >= found(clean[1]) - 1


def test_scans_of_a_restarted_radar_are_counted_on(run):
    intake = Intake(describe_for_live(run))
    numbers = []
    for frame in frames_of(run, restarted):
        scan = intake.admit(frame)
        if scan is not None:
            intake.judged(scan.number, "taken", None)
            numbers.append(scan.number)
    assert numbers == list(range(SCANS - 1))
    assert intake.counts["duplicate"] == 1


def test_each_pair_that_is_lost_is_told_once(run):
    intake = Intake(describe_for_live(run))

    def change(place, number, signal, pose):
        if place >= 5:
            signal[:, 3] = np.nan
        if place >= 15:
            signal[:, 6] = np.nan
        return number, signal, pose

    told_of = []
    for frame in frames_of(run, change):
        intake.admit(frame)
        told_of += [finding.pairs for finding in intake.findings]
    assert told_of == [(3,), (3, 6)]


def test_a_scan_that_comes_again_is_no_restart(run):
    intake = Intake(describe_for_live(run))
    frames = list(frames_of(run))
    for frame in [*frames[:12], *frames[:8], *frames[12:]]:
        scan = intake.admit(frame)
        if scan is not None:
            intake.judged(scan.number, "taken", None)
        assert intake.findings == []
    assert intake.counts["duplicate"] == 8


def frozen(place, number, signal, pose):
    if place >= MIDDLE:
        pose[:] = stored_scan(make_lane_run(), MIDDLE).pose
    return number, signal, pose


def swaying(place, number, signal, pose):
    number, signal, pose = frozen(place, number, signal, pose)
    if place >= MIDDLE:
        pose[:2] += 0.01 * np.sin([place, 3 * place])
    return number, signal, pose


def without_pose(place, number, signal, pose):
    return number, signal, None if place >= MIDDLE else pose


@pytest.mark.parametrize(
    ("change", "finding", "first"),
    [
        (frozen, "frozen positions", MIDDLE + 2),
        pytest.param(swaying, "frozen positions", MIDDLE + 2, marks=SLOW),
        pytest.param(without_pose, "no positions", MIDDLE + 1, marks=SLOW),
    ],
)
def test_positions_that_stay_are_a_problem_within_two_scans(
    tmp_path, run, recipe, change, finding, first
):
    events, _ = live(tmp_path, recipe, run, change)
    [event] = [event for event in events if event.get("kind") == "health"]
    assert (event["finding"], event["scan"], event["stop"]) == (finding, first, True)


@SLOW
def test_a_vehicle_that_stands_has_no_frozen_positions(tmp_path, run, recipe):
    rng = np.random.default_rng(3)
    at = MIDDLE

    def standing(place, number, signal, pose):
        if place >= at:
            scan = stored_scan(run, at)
            noise = rng.normal(size=(2, *signal.shape))
            signal = scan.signal + 0.02 * (noise[0] + 1j * noise[1])
            pose = scan.pose
        return number, signal, pose

    events, _ = live(tmp_path, recipe, run, standing)
    assert told(events) == []
    assert counts(events)["still"] == SCANS - at - 1


@SLOW
def test_a_frozen_signal_is_told_and_left_out(tmp_path, run, recipe):
    frozen_signal = stored_scan(run, MIDDLE).signal

    def change(place, number, signal, pose):
        return number, frozen_signal if place >= MIDDLE else signal, pose

    events, _ = live(tmp_path, recipe, run, change)
    assert told(events) == ["repeated scans"]
    [event] = [event for event in events if event.get("kind") == "health"]
    assert (event["scan"], event["stop"]) == (MIDDLE + 1, True)
    assert counts(events)["refused"] == SCANS - MIDDLE - 1


@SLOW
def test_a_run_that_goes_on_after_a_stop_tells_nothing_twice(tmp_path, run, recipe):
    frames = list(frames_of(run, pair_lost))
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    (incoming / "run.json").write_text(json.dumps(describe_for_live(run).as_json()))
    for first, last in ((0, MIDDLE + 6), (MIDDLE + 6, SCANS)):
        for place in range(first, last):
            (incoming / f"{place:04d}.scan").write_bytes(frames[place])
        if last == SCANS:
            (incoming / "end.json").write_text("{}")
        LiveRun(LiveOptions(recipe, tmp_path / "out", incoming, idle=0.5)).run()
    events = [json.loads(line) for line in (tmp_path / "out/live.jsonl").read_text().splitlines()]
    assert told(events) == ["missing pairs"]
    whole, alarms = live(tmp_path / "whole", recipe, run, pair_lost)
    assert counts(events)["taken"] == counts(whole)["taken"]
    again = read_table(tmp_path / "out/alarms.csv", "alarms")
    np.testing.assert_array_equal(again.to_numpy(), alarms.to_numpy())


def test_a_restart_is_remembered_over_a_stop(run):
    description = describe_for_live(run)
    intake = Intake(description)
    frames = list(frames_of(run, restarted))
    for frame in frames[: MIDDLE + 4]:
        scan = intake.admit(frame)
        if scan is not None:
            intake.judged(scan.number, "taken", None)
    later = Intake(description)
    later.restore(json.loads(json.dumps(intake.state())))
    scan = later.admit(frames[MIDDLE + 4])
    assert isinstance(scan, Scan)
    assert scan.number == MIDDLE + 3
