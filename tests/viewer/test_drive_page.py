"""The driver's screen of a live run: instruction, road, losses, sound, voice, answers, colours, size."""

import json
import os
import re
import threading
import time
from importlib.resources import files

import numpy as np
import pytest
from test_live_page import START, Feeder, alarm, scan

from flgpr.live.events import view_event
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model.vehicle import Vehicle
from flgpr.store import save_run
from live_lane import STEP, make_lane_run, small_recipe

pytestmark = pytest.mark.slow("a browser draws every page")

VEHICLE = Vehicle(speed=15 / 3.6, reaction=0.5, deceleration=7.0)
HIDDEN = """() => [...document.querySelectorAll('#drive p, #drive h2, #drive button')]
    .filter((e) => e.checkVisibility() && e.textContent)
    .filter((e) => {
        const own = e.getBoundingClientRect(), home = e.closest('#drive > div').getBoundingClientRect();
        return own.bottom > Math.min(home.bottom, innerHeight) + 1 || own.right > Math.min(home.right, innerWidth) + 1;
    }).map((e) => e.id)"""
"""Names of what reaches beyond its part of the screen."""
BEGIN = START | {"vehicle": VEHICLE.model_dump() | {"stopping_distance": VEHICLE.stopping_distance}}
SEEN = """() => Object.fromEntries(['state-words', 'state-detail', 'drive-word', 'drive-how', 'drive-where',
    'drive-aside', 'drive-chances', 'drive-prior', 'drive-answered']
    .map((id) => [id, document.getElementById(id).textContent.replaceAll('\\u00a0', ' ')])
    .concat([['word', document.getElementById('drive').dataset.word]]))"""
AUDIO = """() => {
    window.tones = [];
    window.AudioContext = class {
        get currentTime() { return performance.now() / 1000; }
        resume() { return Promise.resolve(); }
        createGain() { return { gain: { setValueAtTime() {}, linearRampToValueAtTime() {} }, connect() {} }; }
        createOscillator() {
            const frequency = { value: 0 };
            const start = () => window.tones.push(frequency.value);
            return { frequency, start, stop() {}, connect: (next) => next };
        }
    };
}"""
VOICE = """() => {
    window.spoken = [];
    window.SpeechSynthesisUtterance = class { constructor(words) { this.words = words; } };
    const speak = (one) => window.spoken.push(one.words);
    Object.defineProperty(window, 'speechSynthesis', { value: { cancel() {}, speak } });
}"""
AMBER = (0xFF, 0xB0, 0x00)
CLOCK = """(() => {
    const later = window.setTimeout.bind(window), ask = window.fetch.bind(window), timers = new Map();
    let now = performance.now(), last = 0, waiting = 0;
    performance.now = () => now;
    window.setTimeout = (act, wait = 0) => timers.set(++last, { act, at: now + wait }) && last;
    window.clearTimeout = (timer) => timers.delete(timer);
    window.fetch = async (...what) => {
        waiting++;
        try {
            const answer = await ask(...what), text = await answer.text();
            answer.json = async () => JSON.parse(text);
            return answer;
        } finally { waiting--; }
    };
    window.pass = async ([milliseconds, answered]) => {
        const end = now + milliseconds;
        for (;;) {
            do await new Promise((done) => later(done)); while (answered && waiting);
            const [next] = [...timers].filter(([, one]) => one.at <= end).sort(([, a], [, b]) => a.at - b.at);
            if (!next) break;
            timers.delete(next[0]);
            now = next[1].at;
            next[1].act();
        }
        now = end;
    };
})()"""
"""A page's clock that goes only when it is told to; Playwright's would be that of every page of the browser."""


class Screen:
    """A driver's screen on a page whose clock goes only when it is told to, and a detection that seems alive."""

    def __init__(self, page, folder):
        self.watched = page
        self.page = page.page
        self.file = folder / "live.jsonl"

    def alive(self, ago=-100.0):
        """Let detection give a sign of life so long ago; by the test's own clock it stays fresh."""
        os.utime(self.file, (time.time() - ago,) * 2)

    def pass_time(self, milliseconds, answered=True):
        """Let the page's clock go on, and whatever it asks for be answered at once."""
        self.page.evaluate("(how) => pass(how)", [milliseconds, answered])

    def says(self):
        return self.page.evaluate(SEEN)


@pytest.fixture
def driving(tmp_path, serving, watch):
    """A driver's screen, the folder's feeder, and the clock in hand."""
    feeder = Feeder(tmp_path)
    feeder.give(BEGIN, scan(0, 0.0))
    with serving([], live=tmp_path) as viewer:
        page = watch(viewer, script=CLOCK)
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(600)
        yield screen, feeder
        page.close()


def test_the_word_is_stop_before_the_page_has_heard_anything():
    page = (files("flgpr.viewer") / "static" / "index.html").read_text(encoding="utf-8")
    assert re.search(r'id="drive"[^>]* data-word="stop"', page)
    assert re.search(r'id="drive-word"[^>]*>Stop</h2><p id="drive-how">waiting</p>', page)


def test_a_radar_that_falls_silent_is_seen_within_a_second(driving):
    screen, feeder = driving
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), alarm("alarm-1", 0.5, 12.0, 4.5, number))
        screen.alive()
        screen.pass_time(250)
    assert screen.says()["state-words"] == ""
    assert re.fullmatch(r"[67]\.\d m ahead", screen.says()["drive-where"])
    assert screen.says()["word"] in ("slow", "brake")
    for _ in range(20):
        screen.pass_time(50)
        if (said := screen.says())["state-words"]:
            break
    assert (said["state-words"], said["word"], said["drive-how"]) == (
        "No radar",
        "stop",
        "no radar",
    )
    assert said["drive-where"] == "alarms are not known"
    assert re.fullmatch(r"for 0\.[789] s", said["state-detail"])
    assert screen.page.locator("#state-words").bounding_box()["height"] > 60
    feeder.give(scan(5, 5.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    for k in range(5):  # frames come, none of use
        feeder.give({"event": "counts", "masked": k})
        screen.alive()
        screen.pass_time(400)
    assert screen.says()["state-words"] == "Scans unusable"


def problem(number, kind="pose"):
    words = f"scan {number} after scan {number - 1}: 46 m away in 0.238 s, 193.2 m/s, at most 30 m/s (speed)"
    return {"event": "problem", "name": "a.scan", "words": words, "kind": kind, "scan": number}


def health(finding, stop):
    words = f"{finding}: 2, at most 1"
    return {
        "event": "problem", "name": "a.scan", "words": words, "kind": "health",
        "finding": finding, "stop": stop,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("finding", "told"),
    [
        ("frozen positions", ("Positions frozen", "check the GPS")),
        ("no positions", ("No positions", "check the GPS")),
        ("repeated scans", ("Radar frozen", "start it again")),
    ],
)
def test_what_blinds_the_radar_says_stop_until_a_scan_is_of_use_again(driving, finding, told):
    screen, feeder = driving
    for number in range(1, 5):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(250)
    feeder.give(health("disturbed tones", stop=False))  # a line, and no more
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert said["state-words"] == ""
    assert screen.page.text_content("#live-health") == "Radar: disturbed tones"  # for the desk
    feeder.give(health(finding, stop=True))
    for number in range(5, 8):
        feeder.give(scan(number, 4.0) | {"outcome": "still"})
        screen.alive()
        screen.pass_time(250)
        said = screen.says()
        assert (said["state-words"], said["state-detail"]) == told
        assert said["word"] == "stop"
    feeder.give(scan(8, 5.0))
    screen.alive()
    screen.pass_time(250)
    assert screen.says()["state-words"] == ""


def test_positions_that_are_wrong_are_seen_within_a_second_and_until_they_are_good_again(driving):
    screen, feeder = driving
    near = alarm("alarm-1", 0.5, 12.0, 4.5, 4.0)
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), near)
        screen.alive()
        screen.pass_time(250)
    assert screen.says()["state-words"] == ""
    feeder.give(problem(5))  # a single one costs its scan, no more
    screen.alive()
    screen.pass_time(250)
    feeder.give(scan(6, 6.0))
    screen.alive()
    screen.pass_time(250)
    assert (screen.says()["state-words"], screen.says()["word"]) == ("", "brake")
    feeder.give(problem(7))
    screen.alive()
    screen.pass_time(250)
    feeder.give(problem(8))
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["state-detail"]) == ("Positions wrong", "check the GPS")
    assert (said["word"], said["drive-how"]) == ("stop", "positions wrong")
    for width in (1024, 390):
        screen.page.set_viewport_size({"width": width, "height": 768})
        box = screen.page.locator("#state-detail").bounding_box()
        assert box["x"] + box["width"] <= width  # what to do is read in full
    screen.page.set_viewport_size({"width": 1280, "height": 800})
    for number in range(9, 14):  # as long as they last, whatever else is missed by now
        feeder.give(problem(number), {"event": "counts", "implausible": number - 6})
        screen.alive()
        screen.pass_time(250)
        assert screen.says()["state-words"] == "Positions wrong"
    feeder.give(scan(14, 7.0))
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["word"]) == ("", "brake")
    assert screen.page.text_content("#live-faults") == "Scans: 7 with a wrong position"


def test_one_wrong_position_of_a_slow_radar_is_seen_within_a_second(driving):
    screen, feeder = driving
    for number in range(1, 10):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(2000)
    feeder.give(problem(10))
    screen.alive()
    screen.pass_time(1000)
    assert screen.says()["state-words"] == "Positions wrong"


def test_where_detection_starts_anew_the_alarms_of_before_lie_ahead_no_more(driving):
    screen, feeder = driving
    feeder.give(scan(1, 1.0), alarm("alarm-1", 0.5, 12.0, 4.5, 1.0))
    screen.alive()
    screen.pass_time(250)
    feeder.give(problem(2), problem(3))
    screen.alive()
    screen.pass_time(250)
    assert screen.says()["state-words"] == "Positions wrong"
    anew = {
        "event": "anew",
        "scan": 4,
        "held": [2, 3],
        "pose": [0, -494.0, 5, 0, 0, 0],
        "forgotten": False,
    }
    feeder.give(
        anew,
        *(scan(number, -498.0 + number) for number in (2, 3, 4)),
        {"event": "counts", "restarts": 1},
    )
    feeder.give(
        alarm("alarm-1", 0.5, 12.0, 4.5, -494.0, "final"),
        alarm("alarm-2", 0.5, -480.0, 4.5, -494.0),
    )
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["word"]) == ("", "slow")
    assert float(said["drive-where"].split()[0]) == pytest.approx(13, abs=2.1)
    assert screen.page.text_content("#live-faults") == "Scans: 1 new beginnings elsewhere"


def test_a_clock_that_jumps_is_no_matter_of_positions(driving):
    screen, feeder = driving
    for number in range(1, 6):
        feeder.give(problem(number, "clock"), scan(number, float(number)))
        screen.alive()
        screen.pass_time(250)
        assert screen.says()["state-words"] == ""


def test_a_loss_is_seen_at_the_desk_and_nothing_moves_for_it(driving):
    screen, feeder = driving
    screen.page.click("#to-desk")
    feeder.give(scan(1, 1.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.page.locator("#state").is_hidden()
    before = [
        screen.page.locator(name).bounding_box() for name in ("#lane", "#live", "#export-menu")
    ]
    screen.pass_time(1000)
    assert screen.page.inner_text("#state-words").upper() == "NO RADAR"
    assert screen.page.locator("#state").is_visible()
    assert [
        screen.page.locator(name).bounding_box() for name in ("#lane", "#live", "#export-menu")
    ] == before


def test_a_probability_says_under_what_it_holds(driving):
    screen, feeder = driving
    one = alarm("alarm-1", 0.5, 16.0, 0.5, 1) | {"p": 0.622, "next_p": [0.396, 0.704], "wait": True}
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), one)
        screen.alive()
        screen.pass_time(250)
    said = screen.says()
    assert said["drive-chances"] == "p 62 %, next 40\u201370 %"
    assert said["drive-prior"] == "if mines lie as thick as in training"
    screen.page.set_viewport_size({"width": 1024, "height": 768})  # the least that the docs ask for
    assert screen.page.evaluate(HIDDEN) == []
    line = screen.page.locator("#live li").first
    assert line.text_content().endswith("62 \u2192 40\u201370 % wait")
    assert line.get_attribute("aria-label").endswith(
        "p 62 %, next 40\u201370 %, worth another look"
    )
    plain = {name: value for name, value in one.items() if name not in ("p", "next_p", "wait")}
    feeder.give(scan(6, 6.0), plain | {"state": "update", "y": 20.0})
    screen.alive()
    screen.pass_time(400)
    assert screen.page.locator("#drive-chances").is_hidden()
    assert screen.page.locator("#drive-prior").is_hidden()


def test_ground_unlike_the_training_takes_the_place_of_the_probability(driving):
    screen, feeder = driving
    one = alarm("alarm-1", 0.5, 16.0, 0.5, 1) | {"p": 0.622, "next_p": [0.396, 0.704]}
    words = "this ground is unlike the training: the confidences do not hold"
    unlike = {"event": "ground", "scan": 2, "unlike": True, "words": [words, "0.9 (limit 0.4)"]}
    like = {"event": "ground", "scan": 3, "unlike": False, "words": ["like the training again"]}

    def shown_after(number, *events):
        feeder.give(scan(number, float(number)), *events)
        screen.alive()
        screen.pass_time(400)
        return screen.page.inner_text("#drive-chances")

    assert shown_after(1, one).startswith("p 62 %")
    assert shown_after(2, unlike) == "Ground unlike the training: p does not hold"
    assert screen.page.locator("#drive-prior").is_hidden()
    assert "the confidences do not hold" in screen.page.locator("#live-unlike").text_content()
    assert shown_after(3, like).startswith("p 62 %")
    assert screen.page.locator("#live-unlike").count() == 0


def test_a_slow_radar_has_its_own_rhythm(driving):
    screen, feeder = driving
    for number in range(1, 12):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(1200)
    assert screen.says()["state-words"] == ""
    screen.pass_time(4000)
    assert screen.says()["state-words"] == "No radar"


def test_a_detection_that_stands_still_and_a_dead_connection_are_seen(driving):
    screen, feeder = driving
    feeder.give(scan(1, 1.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    screen.alive(ago=5.0)
    screen.pass_time(400)
    assert screen.says()["state-words"] == "Detection stopped"
    feeder.give(scan(2, 2.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    screen.page.route("**/data/live*", lambda _: None)  # asked, never answered
    screen.pass_time(1000, answered=False)
    assert screen.says()["state-words"] == "No connection"
    screen.page.unroute_all()
    screen.pass_time(2400, answered=False)  # what hangs is given up
    feeder.give(scan(3, 3.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    feeder.give(scan(4, 4.0) | {"latency_ms": 2300.0}, alarm("alarm-1", 0.5, 30.0, 4.5, 4.0))
    screen.alive()
    screen.pass_time(400)
    said = screen.says()
    assert (said["state-words"], said["state-detail"]) == ("Too slow", "2.3 s late")
    assert float(said["drive-where"].split()[0]) < 26 - 2.3 * 15 / 3.6  # it has driven on since
    feeder.give({"event": "end"})
    screen.alive(ago=50.0)
    screen.pass_time(400)
    assert (screen.says()["state-words"], screen.says()["word"]) == ("Run ended", "stop")
    assert screen.says()["drive-where"] == "no alarm comes any more"


def test_a_page_whose_scripts_stand_still_says_so(driving):
    """No timer fires while the clock stands; the words come from an animation that a living page always sets back."""
    screen, _ = driving
    opacity = "() => getComputedStyle(document.getElementById('frozen')).opacity"
    screen.pass_time(150)
    assert screen.page.evaluate(opacity) == "0"
    for _ in range(1200):
        if screen.page.evaluate(opacity) == "1":
            break
        screen.page.wait_for_timeout(50)
    assert screen.page.evaluate(opacity) == "1"
    assert screen.page.locator("#frozen").bounding_box()["width"] == 1280
    screen.pass_time(150)
    assert screen.page.evaluate(opacity) == "0"


def test_the_instruction_goes_from_clear_to_over_and_back(driving):
    """At 15 km/h, stated, the table of this vehicle says BRAKE within 3.3 m, an update and what is kept."""
    screen, feeder = driving
    feeder.give(view_event(0, np.ones((600, 60), np.float32)))
    words = {}

    def drive_to(number, y, *events):
        feeder.give(scan(number, y), *events)
        screen.alive()
        screen.pass_time(250)
        words[y] = screen.says()
        return words[y]

    for number in range(1, 4):
        said = drive_to(number, 0.5 * number)
    assert (said["word"], said["drive-word"]) == ("clear", "Clear")
    assert re.fullmatch(r"to \d\d km/h", said["drive-how"])
    assert re.fullmatch(r"no alarm in 5\d m", said["drive-where"])
    said = drive_to(
        4, 2.0, alarm("alarm-1", -0.6, 14.0, 4.5, 0.0), alarm("alarm-2", 2.4, 9.0, 4.5, 0.0)
    )
    assert (said["word"], said["drive-aside"]) == ("slow", "0.6 m left, at 15 km/h as stated")
    assert re.fullmatch(r"at most 1\d km/h", said["drive-how"])
    said = drive_to(5, 9.0)
    assert said["word"] == "brake"
    assert re.fullmatch(r"0\.\d s left", said["drive-how"])
    assert drive_to(6, 12.5)["word"] == "stop"
    said = drive_to(7, 14.0)
    assert (said["word"], said["drive-word"]) == ("over", "Over an alarm")
    assert said["drive-where"] == "under the vehicle"
    left = float(said["drive-how"].split()[2])
    assert 4.6 + 0.5 - 15 / 3.6 * 0.4 < left < 4.6 + 0.5  # it has driven on since the scan
    assert drive_to(8, 17.0)["word"] == "over"  # the rear axle has yet to pass it
    assert drive_to(9, 19.5)["word"] in ("clear", "slow")
    assert "alarm" not in words[19.5]["drive-aside"]


def test_picture_and_words_are_of_one_clock_and_to_scale(driving):
    """What is driven since the scan is driven in the picture, too: the alarm's distance on it is that of the words."""
    screen, feeder = driving
    feeder.give(scan(1, 1.0), alarm("alarm-1", 1.0, 12.0, 4.5, 0.0))
    for wait in (200, 200, 200):
        screen.alive()
        screen.pass_time(wait)
        said = float(screen.says()["drive-where"].split()[0])
        picture = screen.watched.pixels()
        rows, columns = np.nonzero(np.abs(picture - AMBER).max(axis=2) < 6)
        assert rows.size > 50
        row, column = (rows.min() + rows.max()) / 2, (columns.min() + columns.max()) / 2
        height, width, _ = picture.shape
        behind = VEHICLE.front + VEHICLE.axle + 0.6 + 1.0  # to the lower edge, m
        scale = height / (15.0 + behind)
        assert (height - row) / scale - behind == pytest.approx(said, abs=0.12)
        assert (column - width / 2) / scale == pytest.approx(1.0, abs=0.12)
    assert said < 10.9 - 0.4 * 15 / 3.6  # it was driven on


def test_a_driver_answers_into_the_log_of_the_run(tmp_path, serving, watch):
    feeder = Feeder(tmp_path)
    feeder.give(BEGIN, scan(0, 0.0))
    with serving([], live=tmp_path, answers=True) as viewer:
        page = watch(viewer, script=CLOCK)
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(600)
        assert page.page.is_disabled("#drive-saw")  # there is nothing to answer to
        feeder.give(scan(1, 1.0), alarm("alarm-7", 1.0, 12.0, 4.5, 0.0))
        screen.alive()
        screen.pass_time(400)
        page.page.click("#drive-nothing")
        page.until("document.getElementById('drive-answered').textContent.includes('noted')")
        assert screen.says()["drive-answered"] == "alarm-7: nothing there, noted"
        assert screen.says()["word"] == "slow"  # what is buried is not seen: it counts all the same
        feeder.give(scan(2, 30.0))
        screen.alive()
        screen.pass_time(400)
        page.page.click("#drive-saw")  # of the last one, once it is passed
        page.until("document.getElementById('drive-answered').textContent.includes('saw it')")
        page.close()
    lines = [json.loads(line) for line in (tmp_path / "answers.jsonl").read_text().splitlines()]
    assert [one["answer"] for one in lines] == ["nothing there", "saw it"]
    assert [(one["alarm_id"], one["x"], one["y"], one["scan"]) for one in lines] == [
        ("alarm-7", 1.0, 12.0, 1),
        ("alarm-7", 1.0, 12.0, 2),
    ]


def test_without_leave_to_write_there_is_nothing_to_answer_with(driving):
    screen, _ = driving
    assert screen.page.locator("#drive-answers").is_hidden()


def test_the_voice_says_what_is_new_and_is_off_until_it_is_switched_on(driving):
    screen, feeder = driving
    screen.page.evaluate(VOICE)

    def drive_to(number, y):
        feeder.give(scan(number, y), alarm("alarm-1", 0.0, 40.0, 4.5, 0.0))
        screen.alive()
        screen.pass_time(300)
        return screen.page.evaluate("spoken")

    assert drive_to(1, 1.0) == []
    screen.page.click("#drive-voice")
    assert screen.page.get_attribute("#drive-voice", "aria-pressed") == "true"
    assert re.fullmatch(r"Slow\. At most 3\d", drive_to(2, 1.2)[0])
    assert len(drive_to(3, 1.4)) == 1  # said once
    assert re.fullmatch(r"Slow\. At most [12]\d", drive_to(4, 20.0)[-1])  # it has fallen
    assert drive_to(5, 36.0)[-1] == "Brake"
    screen.pass_time(1500)
    assert screen.page.evaluate("spoken")[-1] == "Stop"
    screen.page.click("#drive-voice")
    before = len(screen.page.evaluate("spoken"))
    assert len(drive_to(6, 41.0)) == before


def test_sound_is_off_until_it_is_switched_on(driving):
    screen, feeder = driving
    screen.page.evaluate(AUDIO)
    feeder.give(scan(1, 0.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["drive-where"] == "no ground seen yet"
    assert screen.says()["drive-how"] == "at most 5 km/h"
    near = alarm("alarm-1", -0.6, 3.0, 4.5, 0.0)
    feeder.give(scan(2, 0.0), near, view_event(0, np.ones((200, 60), np.float32)))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["word"] == "brake"
    assert screen.page.evaluate("tones") == []
    screen.page.click("#drive-sound")
    assert screen.page.get_attribute("#drive-sound", "aria-pressed") == "true"
    feeder.give(scan(3, 0.1))
    screen.alive()
    screen.pass_time(500)
    assert screen.page.evaluate("tones").count(1200) >= 1
    screen.pass_time(1500)
    assert screen.page.evaluate("tones[tones.length - 1]") == 220  # nothing comes any more
    screen.page.click("#drive-sound")
    feeder.give(scan(4, 8.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["word"] != "brake"
    before = len(screen.page.evaluate("tones"))
    screen.pass_time(1000)
    assert len(screen.page.evaluate("tones")) == before


LOOK = """() => {
    const colours = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    const light = (colour) => {
        colours.clearRect(0, 0, 1, 1);
        colours.fillStyle = colour;
        colours.fillRect(0, 0, 1, 1);
        const [r, g, b] = [...colours.getImageData(0, 0, 1, 1).data].slice(0, 3).map((v) => v / 255)
            .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const ground = (e) => {
        const own = getComputedStyle(e).backgroundColor;
        return own === 'rgba(0, 0, 0, 0)' && e.parentElement ? ground(e.parentElement) : own;
    };
    const all = [...document.querySelectorAll('#drive *, #state *')]
        .filter((e) => e.checkVisibility());
    return {
        type: all.filter((e) => e.textContent && !e.children.length).map((e) => {
            const style = getComputedStyle(e), [a, b] = [light(style.color), light(ground(e))];
            const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
            return { name: e.id || e.textContent, size: parseFloat(style.fontSize), contrast };
        }),
        buttons: all.filter((e) => e.tagName === 'BUTTON').map((e) => [e.textContent,
            ...['left', 'top', 'right', 'bottom', 'width', 'height'].map((n) => e.getBoundingClientRect()[n])]),
        cut: all.filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline')
            .map((e) => e.id),
    };
}"""


@pytest.mark.parametrize("size", [(1024, 768), (1280, 800), (1920, 1080)])
def test_it_is_read_from_afar_in_any_light_and_touched_with_gloves(tmp_path, serving, watch, size):
    feeder = Feeder(tmp_path)
    feeder.give(
        BEGIN,
        scan(0, 0.0) | {"arrived": 5.0},
        scan(1, 1.0) | {"arrived": 6.0},
        alarm("alarm-1", -1.6, 2.4, 4.5, 0.0),
    )
    feeder.give(*(alarm(f"alarm-{k}", 0.0, 10.0 + k, 4.5, 0.0) for k in range(2, 5)))
    feeder.give({"event": "counts", "missing": 88, "masked": 88, "duplicate": 88})
    names = set()
    smallest = {}
    with serving([], live=tmp_path) as viewer:
        page = watch(viewer, size=size, script=CLOCK)
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(1500)
        assert screen.says()["state-words"] == "No radar"
        for words in ("No radar", ""):
            if not words:
                feeder.give(scan(2, 2.0) | {"arrived": 7.0})
                screen.alive()
                screen.pass_time(300)
                assert (screen.says()["state-words"], screen.says()["word"]) == ("", "stop")
            for theme in ("light", "night", "sun"):
                page.page.evaluate(
                    "(theme) => { document.documentElement.dataset.theme = theme; }", theme
                )
                looks = page.page.evaluate(LOOK)
                for one in looks["type"]:
                    assert one["size"] >= 38, one
                    assert one["contrast"] >= (7 if theme == "sun" else 4.5), (theme, one)
                    smallest[one["name"]] = min(one["size"], smallest.get(one["name"], 999))
                names |= {one["name"] for one in looks["type"]}
                assert looks["cut"] == []
                for name, left, top, right, bottom, width, height in looks["buttons"]:
                    assert min(width, height) >= 72, name
                    assert left >= 0
                    assert top >= 0
                    assert right <= size[0]
                    assert bottom <= size[1], name
        page.close()
    assert names >= {
        "drive-word",
        "drive-how",
        "drive-where",
        "drive-aside",
        "state-words",
    }
    assert min(smallest[name] for name in ("drive-word", "drive-how", "state-words")) >= 48


def test_a_hand_on_the_picture_does_not_take_it_from_the_vehicle(driving):
    screen, _ = driving
    assert screen.page.get_attribute("#follow", "aria-pressed") == "true"
    box = screen.page.locator("#lane").bounding_box()
    screen.page.mouse.move(box["x"] + 200, box["y"] + 200)
    screen.page.mouse.down()
    screen.page.mouse.move(box["x"] + 300, box["y"] + 500, steps=4)
    screen.page.mouse.up()
    screen.page.mouse.wheel(0, 300)
    assert screen.page.get_attribute("#follow", "aria-pressed") == "true"
    assert screen.page.locator("#alarm").is_hidden()


def test_the_button_goes_through_day_night_and_sun(driving):
    screen, _ = driving
    assert screen.page.inner_text("#drive-theme") == "Day"
    for name, theme in (("Night", "night"), ("Sun", "sun"), ("Day", "light")):
        screen.page.click("#drive-theme")
        assert screen.page.inner_text("#drive-theme") == name
        assert screen.page.evaluate("document.documentElement.dataset.theme") == theme
    screen.page.click("#drive-theme")
    screen.page.click("#to-desk")
    assert screen.page.locator("#export-menu").is_visible()
    assert screen.page.evaluate("document.documentElement.dataset.theme") == "dark"
    screen.page.click("#to-drive")
    assert screen.page.inner_text("#drive-theme") == "Night"
    assert screen.page.locator("#export-menu").is_hidden()


def test_a_drive_at_the_speed_of_a_vehicle_with_faults(tmp_path, serving, watch):
    """15 km/h from the radar's files to the screen, scans lost, late, twice and holed on the way."""
    save_run(make_lane_run(), tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    options = LiveOptions(
        tmp_path / "recipe.toml",
        tmp_path / "out",
        tmp_path / "in",
        vehicle=VEHICLE.changed(threshold=1.0),
    )
    faults = ["lost:16:8", "late:27:2", "twice:30:3", "nan:33:2"]
    live = LiveRun(options)
    detection = threading.Thread(target=live.run)
    radar = threading.Thread(
        target=feed,
        args=(tmp_path / "run.zarr", tmp_path / "in", 15 / 3.6 / STEP),
        kwargs={"faults": faults},
    )
    seen = []
    when = []
    with serving([], live=tmp_path / "out") as viewer:
        page = watch(viewer)
        assert page.page.evaluate(SEEN)["state-words"] in ("", "Waiting")
        detection.start()
        page.until("document.getElementById('state-detail').textContent === 'for the first scan'")
        radar.start()
        try:
            for _ in range(1200):
                seen.append(page.page.evaluate(SEEN))
                when.append(time.monotonic())
                if seen[-1]["state-words"] == "Run ended":
                    break
                page.page.wait_for_timeout(40)
        finally:
            live.stop()
            for thread in (radar, detection):
                thread.join(30)
        latency = json.loads((tmp_path / "out" / "live.json").read_text())["latency_ms"]["largest"]
        faults = page.page.text_content("#live-faults")
        page.close()
    end = seen[-1]
    assert (end["state-words"], end["drive-word"], end["word"]) == ("Run ended", "Stop", "stop")
    assert (
        faults == "Scans: 1 out of order, 3 duplicate, 2 with missing sweeps, 8 missing"
    )  # the late one came in time
    driven = [one for one in seen if not one["state-words"]]
    # A lane full of alarms. Where updates come late, as on a busy machine, a word is over before it is seen.
    assert "stop" in {one["word"] for one in driven}
    late = max(np.diff(when).max(), latency / 1000) > 0.25  # s; a metre of road
    assert late or {"slow", "brake"} & {one["word"] for one in driven}
    for one in driven:
        if one["word"] == "clear":
            assert one["drive-where"].startswith("no alarm")
        if one["word"] in ("slow", "brake") and "ahead" in one["drive-where"]:
            assert float(one["drive-where"].split()[0]) > 0
    for one in seen:
        if one["state-words"] in (
            "No radar",
            "No connection",
            "Detection stopped",
            "Scans unusable",
        ):
            assert (one["drive-where"], one["word"]) == ("alarms are not known", "stop")
