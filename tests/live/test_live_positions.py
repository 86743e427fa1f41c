"""Wrong positions in a live run: one blinds nobody, and where positions moved for good detection starts anew."""

import json
import tracemalloc

import numpy as np
import pytest

from flgpr.live import session
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.intake import Intake
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.state import restore_snapshot, take_snapshot
from flgpr.recipe.schema import parse_recipe
from flgpr.store import Scan, decode_frame, describe_for_live, encode_frame, encode_scan, save_run
from live_lane import LANE, make_lane_run, small_recipe

SCANS = 13
LONG = 34
RUN = make_lane_run(scans=LONG)
DESCRIBED = describe_for_live(RUN)
RECIPE = parse_recipe(small_recipe())


def scans_of(count=SCANS):
    time, pose, signal = (RUN[name].values for name in ("time", "pose", "signal"))
    return [Scan(k, float(time[k]), pose[k], signal[k]) for k in range(count)]


def shifted(scan, component, by, later=0.0):
    pose = scan.pose.copy()
    pose[component] += by
    return Scan(scan.number, scan.time + later, pose, scan.signal)


def played(scans, lane=LANE, settings=None):
    detector = LiveDetector(DESCRIBED, RECIPE, lane, settings=settings)
    updates = [detector.add(scan) for scan in scans]
    detector.finish()
    return detector, updates


def same_alarms(one, other):
    return one.table().equals(other.table())


@pytest.mark.slow("plays the lane once for every wrong pose")
@pytest.mark.parametrize("lane", [LANE, None], ids=["lane", "no lane"])
@pytest.mark.parametrize(
    ("component", "by"),
    [(1, 45.0), (1, 60.0), (1, 1e6), (1, -45.0), (1, 3.0), (1, 5.0), (0, 45.0), (0, -1e6), (2, 20.0), (3, 2.0),
     (4, 0.6), (5, -0.6)],
)  # fmt: skip
def test_one_wrong_pose_costs_its_scan_alone(component, by, lane):
    scans = scans_of()
    without, _ = played(scans[:6] + scans[7:], lane)
    assert len(without.table()) > 5
    scans[6] = shifted(scans[6], component, by)
    detector, updates = played(scans, lane)
    assert same_alarms(detector, without)
    assert [update.outcome for update in updates].count("held") == 1
    assert updates[6].step.scan == 6
    assert detector.left_out == 1


@pytest.mark.slow("plays the lane once for every wrong pose")
@pytest.mark.parametrize("wrong", [[0], [0, 1], [6, 7], [5, 7], [0, 6]])
@pytest.mark.parametrize("lane", [LANE, None], ids=["lane", "no lane"])
def test_the_first_pose_and_several_may_be_wrong(wrong, lane):
    scans = scans_of()
    without, _ = played([scan for scan in scans if scan.number not in wrong], lane)
    detector, _ = played(
        [shifted(one, 1, 45.0) if one.number in wrong else one for one in scans], lane
    )
    assert same_alarms(detector, without)
    assert detector.left_out == len(wrong)


def test_poses_without_times_are_judged_as_well():
    scans = [Scan(one.number, np.nan, one.pose, one.signal) for one in scans_of()]
    without, _ = played(scans[:6] + scans[7:])
    detector, _ = played([*scans[:6], shifted(scans[6], 1, 45.0), *scans[7:]])
    assert same_alarms(detector, without)


@pytest.mark.slow("plays the lane once for every wrong pose")
@pytest.mark.parametrize("by", [1.5, 8.0, 14.0])
def test_a_pose_that_is_wrong_by_less_than_the_limits_closes_no_ground(by):
    """Without times the pose is believed; it stands in one look, and all later scans are used and raise alarms."""
    scans = [Scan(one.number, np.nan, one.pose, one.signal) for one in scans_of(LONG)]
    undisturbed, _ = played(scans)
    detector, updates = played([shifted(one, 1, by) if one.number == 12 else one for one in scans])
    assert not any(update.step for update in updates)
    assert {update.outcome for update in updates[5:]} == {"taken"}
    mine, theirs = (one.table()[["x", "y"]].to_numpy() for one in (detector, undisturbed))
    near = np.hypot(*(theirs[:, None] - mine).transpose(2, 0, 1)).min(axis=1) < 0.25
    assert near.mean() > 0.8


@pytest.mark.parametrize("jump", [1e6, -100.0, 3600.0])
def test_a_clock_that_jumps_costs_nothing(jump):
    scans = scans_of()
    undisturbed, _ = played(scans)
    detector, updates = played(
        [shifted(one, 1, 0.0, jump if one.number >= 6 else 0.0) for one in scans]
    )
    assert same_alarms(detector, undisturbed)
    told = [update.clock for update in updates if update.clock is not None]
    assert [step.scan for step in told] == ([] if jump == 3600 else [6])  # an hour may be a pause
    assert not any(update.step for update in updates)


def test_a_jump_takes_no_memory():
    scans = scans_of()
    tracemalloc.start()
    detector, _ = played([shifted(one, 1, 1e6) if one.number == 6 else one for one in scans], None)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e8
    assert len(detector.view["looks"]) < 200


def test_positions_that_moved_for_good_are_followed_and_nothing_is_lost():
    """A datum that moves by 500 m: alarms of before stay, and the drive beyond finds what a drive from there finds."""
    scans = scans_of(LONG)
    at = 17
    moved = [shifted(one, 1, 500.0) if one.number >= at else one for one in scans]
    detector, updates = played(moved, None)
    assert detector.left_out == 0
    assert [update.outcome for update in updates[at : at + 3]] == ["held", "held", "taken"]
    anew = updates[at + 2]
    assert anew.anew
    assert [(scan.number, update.outcome) for scan, update in anew.released] == [
        (at, "taken"),
        (at + 1, "taken"),
    ]
    before, _ = played(scans[:at], None)
    table = detector.table()
    kept = table[table["y"] < 250]
    assert set(kept["alarm_id"]) == set(before.table()["alarm_id"])
    # The background knows the scans before; a fresh drive that is taught them finds the same.
    fresh = LiveDetector(DESCRIBED, RECIPE, None)
    for scan in scans[:at]:
        fresh.background.add(fresh._image(scan))
    for scan in moved[at:]:
        fresh.add(scan)
    fresh.finish()
    place = ["x", "y"]
    mine = table[table["y"] > 250].sort_values(place)[place].to_numpy()
    theirs = fresh.table().sort_values(place)[place].to_numpy()
    assert len(mine) > 10
    near = np.hypot(*(mine[:, None] - theirs).transpose(2, 0, 1)).min(axis=1) < 0.1
    assert near.mean() > 0.9  # the density rule counts on other ground


def test_a_wrong_pose_after_a_pause_does_not_blind_for_good():
    """A pause widens what is allowed, so that the jump is believed; the next scans tell against it."""
    scans = scans_of(LONG)
    late = [
        shifted(one, 1, 45.0 if one.number == 10 else 0.0, 10.0 if one.number >= 10 else 0.0)
        for one in scans
    ]
    detector, updates = played(late)
    assert updates[10].step is None
    assert [update.anew for update in updates].index(True) == 13
    assert (detector.table()["y"] > 10).sum() > 10


def test_a_vehicle_that_turns_around_is_not_accused():
    scans = scans_of(LONG)
    turn = 0.5
    pose = scans[20].pose.copy()
    back = []
    for k, scan in enumerate(scans[20:]):
        pose = pose.copy()
        pose[3] = np.angle(np.exp(1j * min(turn * k, np.pi)))
        pose[:2] += 0.4 * np.array([np.sin(pose[3]), np.cos(pose[3])])
        back.append(Scan(scan.number, scan.time, pose, scan.signal))
    detector, updates = played([*scans[:20], *back])
    assert not any(update.step for update in updates)
    assert detector.left_out == 0


def test_what_is_held_back_is_in_the_snapshot():
    scans = scans_of(LONG)
    moved = [shifted(one, 1, 500.0) if one.number >= 10 else one for one in scans]
    undisturbed, _ = played(moved)
    detector = LiveDetector(DESCRIBED, RECIPE, LANE)
    intake = Intake(DESCRIBED)
    for scan in moved[:12]:
        detector.add(scan)
    assert list(detector.held) == [10, 11]
    words, arrays = take_snapshot(detector, intake, set(), "")
    words = json.loads(json.dumps(words, allow_nan=False))
    again = LiveDetector(DESCRIBED, RECIPE, LANE)
    restore_snapshot((words, arrays), again, Intake(DESCRIBED), "")
    for scan in moved[12:]:
        again.add(scan)
    again.finish()
    assert same_alarms(again, undisturbed)


def test_a_held_scan_that_cannot_be_imaged_is_refused_with_its_words():
    scans = scans_of()
    dark = [
        Scan(one.number, one.time, one.pose, 0 * one.signal) if one.number == 7 else one
        for one in scans
    ]
    detector, updates = played([shifted(one, 1, 500.0) if one.number >= 6 else one for one in dark])
    released = {scan.number: update for scan, update in updates[8].released}
    assert released[6].outcome == "taken"
    assert (released[7].outcome, bool(released[7].words)) == ("refused", True)
    assert detector.left_out == 0


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setattr(session, "rehearse", lambda *_: None)
    save_run(RUN, tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    return tmp_path


def live(home, name, frames, recipe=""):
    """Run live over frames in files and give the report, the events and the alarms' bytes."""
    incoming = home / f"{name}-in"
    incoming.mkdir()
    (incoming / "run.json").write_text(json.dumps(DESCRIBED.as_json()))
    for place, frame in enumerate(frames):
        (incoming / f"{place:04d}.scan").write_bytes(frame)
    (incoming / "end.json").write_text("{}")
    (home / "own.toml").write_text(small_recipe() + recipe)
    options = LiveOptions(home / "own.toml", home / name, incoming, settings=LiveSettings())
    report = LiveRun(options).run()
    lines = [json.loads(line) for line in (home / name / "live.jsonl").read_text().splitlines()]
    return report, lines, (home / name / "alarms.csv").read_bytes()


def frame_of(scan):
    return encode_scan(scan.number, scan.signal, scan.pose, scan.time)


def test_an_implausible_pose_is_an_event_with_its_numbers(home):
    scans = scans_of()
    frames = [frame_of(shifted(one, 1, 45.0) if one.number == 6 else one) for one in scans]
    report, lines, alarms = live(home, "wrong", frames)
    _, _, without = live(home, "without", frames[:6] + frames[7:])
    assert alarms == without
    (problem,) = [line for line in lines if line["event"] == "problem"]
    assert {name: problem[name] for name in ("kind", "scan", "since", "limit", "unit")} == {
        "kind": "pose", "scan": 6, "since": 5, "limit": "speed", "unit": "m",
    }  # fmt: skip
    assert problem["value"] == pytest.approx(45.4, abs=0.1)
    assert problem["most"] == pytest.approx(30 / 4.2, rel=1e-3)
    assert problem["seconds"] == pytest.approx(1 / 4.2, rel=1e-3)
    assert "190.7 m/s, at most 30 m/s" in problem["words"]
    assert 6 not in [line["scan"] for line in lines if line["event"] == "scan"]
    counts = {
        name: report.counts[name]
        for name in ("implausible", "held", "restarts", "late", "missing", "clock")
    }
    assert counts == {
        "implausible": 1,
        "held": 0,
        "restarts": 0,
        "late": 0,
        "missing": 0,
        "clock": 0,
    }


def test_a_new_beginning_is_an_event_and_a_new_lattice_without_a_lane(home):
    scans = scans_of()
    frames = [frame_of(shifted(one, 1, -500.0) if one.number >= 7 else one) for one in scans]
    report, lines, _ = live(home, "moved", frames)
    kinds = [line["event"] for line in lines]
    (anew,) = [line for line in lines if line["event"] == "anew"]
    assert (anew["scan"], anew["held"], anew["forgotten"]) == (9, [7, 8], False)
    assert anew["pose"][1] < -490
    starts = [line for line in lines if line["event"] == "start"]
    assert starts[1]["grid"]["y"] == pytest.approx(starts[0]["grid"]["y"] - 500 + 7 * 0.4, abs=0.1)
    assert kinds.index("anew") < len(kinds) - 1 - kinds[::-1].index("start")
    taken = [line["scan"] for line in lines if line["event"] == "scan"]
    assert taken == list(range(SCANS))
    rows = [line["row"] for line in lines[kinds.index("anew") :] if line["event"] == "view"]
    assert rows
    assert max(rows) < 200
    assert (report.counts["restarts"], report.counts["implausible"], report.counts["held"]) == (
        1,
        0,
        0,
    )


def test_a_wrong_first_pose_is_forgotten(home):
    scans = scans_of()
    frames = [frame_of(shifted(one, 1, 1e6) if one.number == 0 else one) for one in scans]
    report, lines, alarms = live(home, "first", frames)
    honest, _, without = live(home, "without", frames[1:])
    assert alarms == without
    assert report.counts == honest.counts | {"received": SCANS, "implausible": 1}
    assert [line["forgotten"] for line in lines if line["event"] == "anew"] == [True]


def test_without_times_what_agrees_with_those_held_back_is_no_problem(home):
    """The third pose could have been reached from the wrong first one; it is not said to be beyond a limit."""
    scans = [Scan(one.number, np.nan, one.pose, one.signal) for one in scans_of()]
    frames = [frame_of(shifted(one, 1, 45.0) if one.number == 0 else one) for one in scans]
    _, lines, _ = live(home, "first", frames)
    problems = [line for line in lines if line["event"] == "problem"]
    assert [line["scan"] for line in problems] == [1, 2]
    assert all(line["value"] > line["most"] for line in problems)
    assert [line["scan"] for line in lines if line["event"] == "anew"] == [3]


def test_a_clock_is_told_beside_the_pose_that_is_used(home):
    scans = scans_of()
    frames = [frame_of(shifted(one, 1, 0.0, -50.0 if one.number >= 6 else 0.0)) for one in scans]
    report, lines, alarms = live(home, "clock", frames)
    _, _, honest = live(home, "honest", list(map(frame_of, scans)))
    assert alarms == honest
    (problem,) = [line for line in lines if line["event"] == "problem"]
    assert (problem["kind"], problem["scan"]) == ("clock", 6)
    assert problem["words"] == "clock at scan 6 after scan 5 goes back by 49.7619 s"
    assert report.counts["clock"] == 1


def test_a_clock_that_stands_still_is_told_within_ten_scans(home):
    frames = [frame_of(Scan(one.number, 7.0, one.pose, one.signal)) for one in scans_of()]
    report, lines, _ = live(home, "standing-clock", frames)
    (problem,) = [line for line in lines if line["event"] == "problem"]
    assert (problem["kind"], problem["scan"]) == ("clock", 8)
    assert "stands still" in problem["words"]
    assert report.counts["clock"] == 1


def test_limits_stand_in_the_recipe(home):
    slow = "\n[motion]\nspeed = 0.5\n"  # steps of up to a metre are never too large
    frames = [frame_of(shifted(one, 1, 0.8 if one.number == 6 else 0.0)) for one in scans_of()]
    report, lines, _ = live(home, "slow", frames, slow)
    assert report.counts["implausible"] + report.counts["held"] == 1
    assert [line["limit"] for line in lines if line["event"] == "problem"] == ["speed"]
    assert live(home, "usual", frames)[0].counts["implausible"] == 0


def spoilt(scan, fault):
    """A frame of a scan's number that is of no use, with a checksum that is right."""
    frame = decode_frame(frame_of(scan))
    header = {name: value for name, value in frame.header.items() if name != "kind"}
    if fault == "nan":
        values = np.frombuffer(frame.payload, "<c8").copy()
        values[7] = np.nan
        return encode_frame("scan", header, values.tobytes())
    changes = {"pose": {"pose": [0.0, 4e5, 2.0, 0, 0, 0]}, "run": {"run": "0123456789abcdef"}}
    return encode_frame("scan", header | changes[fault], frame.payload)


@pytest.mark.slow("plays the lane once for every wrong pose")
@pytest.mark.parametrize(
    "faults", [("nan", "nan"), ("pose", "pose"), ("nan", "pose"), ("run", "nan")]
)
def test_a_bad_frames_number_does_not_count(home, faults):
    """Two bad frames numbered 8 and 9 come before the true ones, which are taken."""
    scans = scans_of()
    good = list(map(frame_of, scans))
    bad = [spoilt(scans[8], faults[0]), spoilt(scans[9], faults[1])]
    report, _, alarms = live(home, "bad", [*good[:8], *bad, *good[8:], good[3]])
    honest, _, undisturbed = live(home, "good", good)
    assert alarms == undisturbed
    counts = report.counts
    assert (counts["duplicate"], counts["missing"]) == (1, 0)  # the third scan came twice
    assert counts["masked"] + counts["implausible"] + counts["corrupt"] == 2
    assert counts["taken"] == honest.counts["taken"]


def test_a_scan_that_was_refused_may_come_again(home):
    scans = scans_of()
    good = list(map(frame_of, scans))
    signal = scans[8].signal.copy()
    signal[0] = 0  # a polarization
    dark = encode_scan(8, signal, scans[8].pose, scans[8].time)
    report, _, alarms = live(home, "dark", [*good[:8], dark, *good[8:]])
    _, _, undisturbed = live(home, "good", good)
    assert alarms == undisturbed
    assert (report.counts["refused"], report.counts["duplicate"], report.counts["still"]) == (
        1,
        0,
        0,
    )


def test_a_number_far_ahead_takes_no_other_away(home):
    scans = scans_of()
    good = list(map(frame_of, scans))
    forged = encode_scan(2**40, scans[6].signal, scans[6].pose, scans[6].time)
    report, _, alarms = live(home, "forged", [*good[:7], forged, *good[7:]])
    _, _, undisturbed = live(home, "good", good)
    assert alarms == undisturbed
    assert (report.counts["missing"], report.counts["implausible"]) == (0, 1)


def test_a_number_of_no_use_that_comes_first_is_not_missed_from(home):
    scans = scans_of()
    good = list(map(frame_of, scans))
    forged = spoilt(Scan(2**40, scans[0].time, scans[0].pose, scans[0].signal), "nan")
    report, _, alarms = live(home, "forged", [forged, *good])
    _, _, undisturbed = live(home, "good", good)
    assert alarms == undisturbed
    assert (report.counts["missing"], report.counts["masked"]) == (0, 1)


def test_a_pose_is_not_filled_in_from_a_wrong_one():
    intake = Intake(DESCRIBED)
    scans = scans_of()
    for scan in scans[:6]:
        intake.admit(frame_of(scan))
        intake.judged(scan.number, "taken", None)
    intake.admit(frame_of(shifted(scans[6], 1, 5.0)))  # plausible without times
    intake.settled(1, 0)
    intake.judged(6, "held", 5)
    lost = encode_scan(7, scans[7].signal, None, scans[7].time)
    assert intake.admit(lost) is None  # where it is is in doubt
    intake.settled(0, 1)
    filled = intake.admit(lost)
    np.testing.assert_allclose(filled.pose[1], 2 * scans[5].pose[1] - scans[3].pose[1], atol=0.1)


def test_a_feed_rehearses_positions_that_jump(home):
    feed(home / "run.zarr", home / "in", float("inf"), faults=["jump:8:2"])
    report = LiveRun(LiveOptions(home / "recipe.toml", home / "out", home / "in")).run()
    counts = {name: report.counts[name] for name in ("received", "implausible", "late", "missing")}
    assert counts == {"received": LONG, "implausible": 2, "late": 0, "missing": 0}
