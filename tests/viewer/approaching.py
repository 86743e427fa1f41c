"""Approaches to alarms as a driver's screen shows them: the alarms of the packaged drive at other speeds.

Each approach replays what `flgpr live` made of one mine of the packaged drive, look by look, at a speed, a rhythm and a
latency of its own. The driver ignores every other advice, and brakes a reaction time after the screen first says so.
"""

import gzip
import json
import os
from dataclasses import dataclass

import numpy as np
from test_drive_page import CLOCK

from flgpr.live.events import as_line
from flgpr.store import read_table, sample_drive

SPEEDS = (5.0, 10.0, 15.0)  # km/h
APPROACHES = int(os.environ.get("FLGPR_APPROACHES", "6"))  # at each speed; the page quotes 20
STEP = 0.1  # s between two frames, the rhythm in which the page looks at its clock
RATE = 4.2  # scans/s
LATENCY = (0.05, 0.4)  # s from a scan's arrival to its events
JITTER = 0.15  # of the time between two scans
LOST = 0.05  # share of the scans that are lost
BEGIN = 16.0  # m from the vehicle's front to the alarm
SEEN_BEFORE = 3.0  # m before the beginning, from where pictures are shown
NEAR = 1.0  # m, halo of the recipe
TOLD = 0.4  # s until an event is on the screen: it is asked for every 0.2 s, and two steps of this replay
MOST_FRAMES = 400  # of an approach
SHOWN = """() => ({
    ...document.getElementById('drive').dataset,
    state: document.getElementById('state-words').textContent,
})"""
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


class Radar:
    """A radar on the way to an alarm: scans with a rhythm, losses and latencies, and what detection made of them."""

    def __init__(self, begin, front, views, looks, rng):
        self.begin = begin  # s, on the page's clock
        self.front = front  # m, of the vehicle before the array
        self.views = views
        self.looks = looks
        self.rng = rng
        self.number = 0
        self.next_scan = 0.0
        self.waiting = []  # when they are written, and the events

    def drive(self, moment, until, place, speed):
        """Take the scans up to a moment, from the place of the vehicle's front at the moment before."""
        while self.next_scan <= until:
            array = place + speed * (self.next_scan - moment) - self.front
            if self.rng.uniform() >= LOST:
                latency = self.rng.uniform(*LATENCY)
                self.waiting.append((self.next_scan + latency, self.events(array, latency)))
            self.number += 1
            self.next_scan += (1 + self.rng.uniform(-JITTER, JITTER)) / RATE

    def events(self, array, latency):
        """Return the events of a scan, with what the packaged drive knew at this place of the array."""
        scan = {
            "event": "scan",
            "scan": self.number,
            "pose": [0.0, round(array, 4), 5.0, 0.0, 0.0, 0.0],
            "outcome": "taken",
            "arrived": self.begin + self.next_scan,
            "latency_ms": 1e3 * latency,
        }
        known = []
        for recorded_events in (self.views, self.looks):
            while recorded_events and recorded_events[0][0] <= array:
                known.append(recorded_events.pop(0)[1])
        return [scan, *known]

    def due(self, moment):
        """Return the events that are written by a moment."""
        events = [one for when, some in self.waiting if when <= moment for one in some]
        self.waiting = [one for one in self.waiting if one[0] > moment]
        return events


def approach(page, file, start, views, looks, speed, rng, brakes):
    """Play an approach and return its frames; ``brakes`` tells of what is shown whether it says to brake."""
    vehicle = start["vehicle"]
    alarm = looks[-1][1]["y"]
    front = (
        alarm - BEGIN - rng.uniform(0, 1)
    )  # so that no alarm is as far from the first scan as another
    file.write_text(as_line(start))
    page.evaluate("(how) => pass(how)", [600, True])
    begin = page.evaluate("performance.now()") / 1000
    near = [one for one in views if one[0] >= front - SEEN_BEFORE]
    radar = Radar(begin, vehicle["front"], near, list(looks), rng)
    moment = 0.0
    told = braking = None
    frames = []
    while len(frames) < MOST_FRAMES and speed > 0 and front <= alarm + 1:
        radar.drive(moment, moment + STEP, front, speed)
        after = speed
        if braking is not None and moment >= braking:
            after = max(speed - vehicle["deceleration"] * STEP, 0.0)
        front += (speed + after) / 2 * STEP
        speed = after
        moment += STEP
        events = radar.due(moment)
        with file.open("a") as out:
            out.write("".join(as_line(event) for event in events))
        for event in events:
            if event["event"] == "alarm":
                is_above = event["confidence"] >= start["threshold"]
                told = (moment if told is None else told) if is_above else None
        page.evaluate("(how) => pass(how)", [1e3 * STEP, True])
        shown = page.evaluate(SHOWN)
        counts = told is not None and moment >= told + TOLD
        frames.append(Frame(shown, alarm - front, speed, counts))
        if braking is None and told is not None and brakes(shown):
            braking = moment + vehicle["reaction"]
    return frames


def all_approaches(page, file, brakes):
    """Yield the speed, m/s, and the frames of every approach."""
    start, views, alarms = recorded()
    rng = np.random.default_rng(20261128)
    for turn, speed in enumerate(SPEEDS):
        for number in range(APPROACHES):
            looks = alarms[(turn * APPROACHES + number) % len(alarms)]
            yield (
                start,
                speed / 3.6,
                approach(page, file, start, views, looks, speed / 3.6, rng, brakes),
            )
