"""What several scans changed is reported as one change of every alarm."""

from flgpr.live.updates import LiveAlarm, last_states


def alarm(number, state, confidence=1.0):
    return LiveAlarm(f"alarm-{number}", 0.0, float(number), confidence, 2.0, 3, state, 8.0)


def test_an_alarm_that_is_new_stays_new():
    changes = [alarm(1, "new"), alarm(2, "update"), alarm(1, "update", 5.0)]
    assert last_states(changes) == [alarm(1, "new", 5.0), alarm(2, "update")]


def test_an_alarm_that_came_and_went_is_not_reported():
    assert last_states([alarm(1, "new"), alarm(1, "update"), alarm(1, "withdrawn")]) == []


def test_known_alarms_are_withdrawn_and_new_ones_may_be_final():
    changes = [alarm(1, "update"), alarm(1, "withdrawn"), alarm(2, "new"), alarm(2, "final")]
    assert last_states(changes) == [alarm(1, "withdrawn"), alarm(2, "final")]


def test_no_change_is_none():
    assert last_states([]) == []
