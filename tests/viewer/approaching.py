"""Approaches to alarms as a driver's screen shows them: the alarms of the packaged drive at other speeds.

Each approach replays what `flgpr live` made of one mine of the packaged drive, look by look, at a speed, a rhythm and a
latency of its own. The driver ignores every other advice, and brakes a reaction time after the screen first says so.
"""

import gzip
import json
from dataclasses import dataclass

import numpy as np
from test_drive_page import CLOCK

from flgpr.live.events import as_line
from flgpr.store import read_table, sample_drive

SPEEDS = (5.0, 10.0, 15.0)  # km/h
APPROACHES = 20  # at each speed
STEP = 0.1  # s between two frames, the rhythm in which the page looks at its clock
RATE = 4.2  # scans/s
LATENCY = (0.05, 0.4)  # s from a scan's arrival to its events
JITTER = 0.15  # of the time between two scans
LOST = 0.05  # share of the scans that are lost
BEGIN = 16.0  # m from the vehicle's front to the alarm
SEEN_BEFORE = 3.0  # m before the beginning, from where pictures are shown
NEAR = 1.0  # m, halo of the recipe
TOLD = 0.4  # s until an event is on the screen: it is asked for every 0.2 s, and two steps of this replay
CLOCK_OF_SERVER = CLOCK.replace(
    "answer.json = async () => JSON.parse(text);",
    "answer.json = async () => ({ ...JSON.parse(text), now: performance.now() / 1000, age: 0 });",
)
"""The page's clock goes only when it is told to, and the server's with it."""


@dataclass(frozen=True)
class Frame:
    """What the screen shows, and where the vehicle is."""

    shown: dict[str, str]
    left: float  # m from the vehicle's front to the alarm
    speed: float  # m/s
    counts: bool  # whether the page has been told of the alarm


def recorded():
    """Return what begins the packaged drive, and by the array's place its pictures and each mine's states."""
    with gzip.open(sample_drive() / "drive.jsonl.gz", "rt") as lines:
        events = [json.loads(line) for line in lines]
    start = events[0]
    place = {e["scan"]: e["pose"][1] for e in events if e["event"] == "scan"}
    states = {}
    views = []
    last = None
    for event in events:
        if event["event"] == "scan":
            last = event["pose"][1]
        if event["event"] == "view":
            views.append((last, event))
        if event["event"] == "alarm":
            states.setdefault(event["alarm_id"], []).append((place[event["scan"]], event))
    alarms = []
    for mine in read_table(sample_drive() / "truth.csv", "truth").itertuples():
        for looks in states.values():
            last = looks[-1][1]
            if last["confidence"] < start["threshold"] or last["state"] == "withdrawn":
                continue
            if np.hypot(last["x"] - mine.x, last["y"] - mine.y) <= NEAR:
                alarms.append(looks)
    return start, views, alarms


def approach(page, file, start, views, looks, speed, rng, brakes):
    """Play an approach and return its frames; ``brakes`` tells of what is shown whether it says to brake."""
    vehicle = start["vehicle"]
    # So that an alarm is not as far from the first scan as any other one's.
    offset = rng.uniform(0, 1)
    x, y = looks[-1][1]["x"], looks[-1][1]["y"]
    front = y - BEGIN - offset
    file.write_text(as_line(start))
    page.evaluate("(how) => pass(how)", [600, True])
    begin = page.evaluate("performance.now()") / 1000
    moment, v, number = 0.0, speed, 0
    next_scan = 0.0
    waiting = []  # (when they are written, events)
    told = None
    braking = None
    frames = []
    done = 0  # looks that were told
    seen = sum(place < front - SEEN_BEFORE for place, _ in views)
    while len(frames) < 400:
        until = moment + STEP
        while next_scan <= until:
            array = front + v * (next_scan - moment) - vehicle["front"]
            if rng.uniform() >= LOST:
                latency = rng.uniform(*LATENCY)
                events = [
                    {
                        "event": "scan",
                        "scan": number,
                        "pose": [0.0, round(array, 4), 5.0, 0.0, 0.0, 0.0],
                        "outcome": "taken",
                        "arrived": begin + next_scan,
                        "latency_ms": 1e3 * latency,
                    }
                ]
                while seen < len(views) and views[seen][0] <= array:
                    events.append(views[seen][1])
                    seen += 1
                while done < len(looks) and looks[done][0] <= array:
                    events.append(looks[done][1])
                    done += 1
                waiting.append((next_scan + latency, events))
            number += 1
            next_scan += (1 + rng.uniform(-JITTER, JITTER)) / RATE
        if braking is not None and moment >= braking:
            slower = max(v - vehicle["deceleration"] * STEP, 0.0)
            front += (v + slower) / 2 * STEP
            v = slower
        else:
            front += v * STEP
        moment = until
        due = [events for when, events in waiting if when <= moment]
        waiting = [one for one in waiting if one[0] > moment]
        with file.open("a") as out:
            for events in due:
                out.write("".join(as_line(event) for event in events))
                for event in events:
                    if event["event"] == "alarm":
                        is_above = event["confidence"] >= start["threshold"]
                        told = (told if told is not None else moment) if is_above else None
        page.evaluate("(how) => pass(how)", [1e3 * STEP, True])
        shown = page.evaluate(
            "() => ({ ...document.getElementById('drive').dataset, state: document.getElementById('state-words').textContent })"
        )
        counts = told is not None and moment >= told + TOLD
        frames.append(Frame(shown, y - front, v, counts))
        if braking is None and told is not None and brakes(shown):
            braking = moment + vehicle["reaction"]
        if v == 0 or front > y + 1:
            break
    return frames


def all_approaches(page, file, brakes):
    """Yield the speed, m/s, and the frames of every approach."""
    start, views, alarms = recorded()
    rng = np.random.default_rng(20261128)
    for speed in SPEEDS:
        for number in range(APPROACHES):
            looks = alarms[number % len(alarms)]
            yield (
                start,
                speed / 3.6,
                approach(page, file, start, views, looks, speed / 3.6, rng, brakes),
            )
