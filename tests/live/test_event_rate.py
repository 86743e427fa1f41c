"""A flood of faults: few events, in which every fault is counted."""

import json

from hypothesis import given
from hypothesis import strategies as st

from flgpr.live.events import BURST, EventFile, EventRate


def problem(words, number=0):
    return {"event": "problem", "name": f"{number}.scan", "words": words}


def told(events):
    """How many problems events tell of."""
    return sum(event.get("more", 1) for event in events if event["event"] == "problem")


class Clock:
    """A clock that tests set."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["bad sum of 3", "bad length 7", "lost", "counts", "scan", "look"]),
        st.floats(0.0, 0.6),
    ),
    max_size=200,
)


@given(STEPS)
def test_all_problems_are_counted_whatever_their_order(steps):
    clock = Clock()
    rate = EventRate(burst=3, clock=clock)
    given_events = []
    written = []
    for number, (what, pause) in enumerate(steps):
        clock.now += pause
        if what == "look":
            written += rate.due()
            continue
        event = (
            {"event": what, "n": number} if what in ("counts", "scan") else problem(what, number)
        )
        given_events.append(event)
        written += rate.admit([event])
    written += rate.admit([{"event": "end"}])
    assert told(written) == told(given_events)
    assert [one for one in written if one["event"] == "scan"] == [
        one for one in given_events if one["event"] == "scan"
    ]
    assert [one for one in written if one["event"] == "counts"][-1:] == [
        one for one in given_events if one["event"] == "counts"
    ][-1:]
    assert written[-1] == {"event": "end"}
    assert rate.rest() == []


def test_a_flood_is_told_once_a_second():
    clock = Clock()
    rate = EventRate(clock=clock)
    written = []
    for number in range(10_000):
        clock.now = number / 1000
        written += rate.admit(
            [problem(f"frame must have {number} bytes", number), {"event": "counts", "n": number}]
        )
    written += rate.rest()
    problems = [event for event in written if event["event"] == "problem"]
    assert BURST + 9 <= len(problems) <= BURST + 11
    assert told(problems) == 10_000
    assert problems[-1]["words"].endswith(" more problems like this: frame must have 9999 bytes")
    assert [event["n"] for event in written if event["event"] == "counts"][-1] == 9999
    assert (
        len(written) - len(problems) <= BURST + 41
    )  # the page misses a radar that it does not hear of for 0.75 s


def test_faults_now_and_then_are_told_one_by_one():
    clock = Clock()
    rate = EventRate(clock=clock)
    events = [problem("frame must end", number) for number in range(100)]
    written = []
    for event in events:
        clock.now += 1.1
        written += rate.admit([event])
    assert written == events


def test_a_flood_of_one_kind_hides_no_other():
    rate = EventRate(clock=Clock())
    for number in range(1000):
        rate.admit([problem("frame has a wrong checksum", number)])
    other = problem("pose is not plausible: 45 m in 0.2 s")
    assert rate.admit([other]) == [other]


def test_kinds_without_end_are_bounded_too():
    rate = EventRate(clock=Clock())
    written = rate.admit(
        [problem(f"{chr(97 + n % 26)}{chr(97 + n // 26)}") for n in range(26 * 26)]
    )
    assert len(written) < 60
    assert told(written + rate.rest()) == 26 * 26


def test_the_file_of_events_holds_the_rest_of_a_flood_when_it_is_closed(tmp_path):
    with EventFile(tmp_path / "live.jsonl", fresh=True) as events:
        events.append([problem("frame must end", number) for number in range(500)])
        events.beat()
    lines = [json.loads(line) for line in (tmp_path / "live.jsonl").read_text().splitlines()]
    assert len(lines) == BURST + 1
    assert told(lines) == 500
