"""Which way of taking a recording focuses best, and everything else that is asked of it."""

import numpy as np
import pytest
from faulty import FAULTS, WAYS, late, make_drive, on_pose, run_of, with_fault

from flgpr.health.checking import DOUBTFUL, RIGHT, UNSEEN, WRONG, Checked, check_run
from flgpr.health.hypotheses import HYPOTHESES, Ways
from flgpr.health.of_run import examined, taken_of_run
from flgpr.model import Lane


@pytest.fixture(scope="module")
def clean():
    return make_drive()


@pytest.fixture(scope="module")
def taken(clean):
    seen = examined(clean)
    return taken_of_run(clean, seen.sums.mean, seen.radar, seen.health.left_out)


def drifting(signal, pose):
    signal *= 10 ** (np.linspace(0, 6, len(signal)) / 20)[:, None, None, None]


def gap(signal, pose):
    pose[12:, 1] += 3


OTHERS = {
    "dead pairs": (FAULTS["dead pairs"], WRONG),
    "hot pairs": (FAULTS["hot pairs"], WRONG),
    "swapped pairs": (FAULTS["swapped pairs"], WRONG),
    "turned pairs": (FAULTS["turned pairs"], WRONG),
    "disturbed tones": (FAULTS["disturbed tones"], WRONG),
    "frozen positions": (FAULTS["frozen positions"], WRONG),
    "repeated scans": (FAULTS["repeated scans"], WRONG),
    "drift": (drifting, DOUBTFUL),
    "gaps": (gap, DOUBTFUL),
}


def rows(checked, verdict):
    return {one.what: one for one in checked.checks if one.verdict == verdict}


@pytest.mark.parametrize(
    "words", ["the data are conjugated", "180 degrees", "1 scan late", "positions are in feet"]
)
def test_the_looks_of_a_clean_drive_agree_less_however_else_they_are_taken(taken, words):
    other = next(one for one in HYPOTHESES if words in one.words)
    stated = taken.agreement(points_every=4)
    assert stated.mean() > 0.3
    assert other.change(taken).agreement(points_every=4).mean() < 0.7 * stated.mean()


def test_no_two_ways_have_the_same_name():
    assert len({one.name for one in HYPOTHESES}) == len(HYPOTHESES)


@pytest.mark.slow("every way is tried")
@pytest.mark.parametrize("seed", [1, 2])
def test_a_clean_drive_looks_right(seed):
    checked = check_run(make_drive(seed))
    assert checked.verdict == RIGHT
    assert checked.answer.startswith("Looks right: ")
    told = rows(checked, RIGHT)
    assert {"height", "units", "dead pairs", "drift", "gaps"} < set(told)
    assert "at most" in told["height"].words


@pytest.mark.slow("every way is tried")
@pytest.mark.parametrize("words", [*WAYS, "m too large"])
def test_what_focuses_better_is_told_with_its_gain_and_what_to_try(clean, words):
    low = on_pose(lambda pose: pose + [0, 0, 0.3, 0, 0, 0])
    checked = check_run(with_fault(clean, WAYS.get(words, low)))
    assert checked.verdict == WRONG
    assert words in checked.answer
    assert " dB so taken" in checked.answer
    assert checked.answer.count("\n") == 0
    [one] = rows(checked, WRONG).values()
    assert one.advice in one.sentence


@pytest.mark.slow("every way is tried")
def test_two_things_that_are_wrong_are_both_told(clean):
    both = with_fault(clean, lambda signal, pose: (signal.conj(), late(1)(signal, pose)[1]))
    answer = check_run(both).answer
    assert "conjugated" in answer
    assert "1 scan late" in answer


@pytest.fixture
def no_ways(monkeypatch):
    monkeypatch.setattr("flgpr.health.of_run.best_ways", lambda taken, quick: Ways())


@pytest.mark.parametrize("name", OTHERS)
def test_channels_tones_scans_and_positions_are_judged_too(clean, no_ways, name):
    fault, verdict = OTHERS[name]
    checked = check_run(with_fault(clean, fault))
    assert name in rows(checked, verdict)
    assert checked.verdict in (WRONG, verdict)


def test_a_pair_that_never_comes_is_missing_and_not_dead(clean, no_ways):
    def leave_out(signal, pose):
        signal[:, :, 3] = np.nan

    checked = check_run(with_fault(clean, leave_out))
    assert "missing pairs" in rows(checked, WRONG)
    level = float(rows(checked, RIGHT)["dead pairs"].words.split()[0])
    clean_level = float(rows(check_run(clean), RIGHT)["dead pairs"].words.split()[0])
    assert level == pytest.approx(clean_level, abs=1)


def test_a_weak_pair_is_doubtful(clean, no_ways):
    def weak(signal, pose):
        signal[:, :, 4] *= 0.15

    told = rows(check_run(with_fault(clean, weak)), DOUBTFUL)
    assert "pair 4" in told["dead pairs"].words


def test_too_few_scans_say_so_and_are_a_doubt(clean):
    checked = check_run(clean.isel(scan=slice(4)), doubts=["odd"])
    told = rows(checked, DOUBTFUL)
    assert "fewer than 6 consecutive scans" in told["focus"].words
    assert told["positions and antennas"].words == "odd"
    assert checked.verdict == DOUBTFUL
    assert checked.answer.startswith("Doubtful: ")


def test_a_vehicle_that_stands_shows_nothing(clean):
    pose = np.repeat(clean["pose"].values[:1], clean.sizes["scan"], axis=0)
    told = rows(check_run(run_of(clean["signal"].values, pose)), DOUBTFUL)
    assert "the vehicle stands" in told["focus"].words


def test_what_no_drive_shows_is_said(clean):
    few = clean.isel(scan=slice(4))
    assert "beside it where no lane" in rows(check_run(few), UNSEEN)["on any drive"].words
    with_lane = rows(check_run(few, Lane(-1, 1, 0, 9)), UNSEEN)
    assert "beside" not in with_lane["on any drive"].words
    assert "along the lane" in with_lane["on any drive"].words


def test_the_answer_names_three_things_and_counts_the_others():
    checks = check_run(make_drive(1, 4)).checks
    wrong = tuple(type(checks[0])(f"no. {k}", WRONG, f"fault {k}", "mend it") for k in range(5))
    answer = Checked((*wrong, *checks)).answer
    assert answer == "Wrong: fault 0; fault 1; fault 2, and 2 more."
