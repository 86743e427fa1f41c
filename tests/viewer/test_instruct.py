"""What the driver is told, over all speeds, distances and numbers: the rule in the page's own function."""

import itertools
import math

import numpy as np
import pytest
from instructing import MISSING, Instructions, known, numbers, place

from flgpr.model.vehicle import Vehicle

pytestmark = pytest.mark.skipif(MISSING, reason="needs Node, and npm ci in viewer/")

SEVERITY = {"clear": 0, "slow": 1, "brake": 2, "stop": 3}
TABLES = [
    numbers(),
    numbers(reaction=0.5, deceleration=7.0, warning=0.0, clearance=0.0),
    numbers(reaction=2.5, deceleration=1.0, clearance=2.0, front=3.0, axle=8.0, width=3.5),
]
SPEEDS = [0.0, 0.5, 2.0, 5.0, 8.0, 10.0, 15.0, 22.0, 30.0, 60.0]  # km/h
UPDATES = [0.1, 0.5, 2.0]  # s


@pytest.fixture(scope="module")
def tell(tmp_path_factory):
    function = Instructions(tmp_path_factory.mktemp("instruct"))
    yield function
    function.close()


def stop_distance(table, speed, reaction):
    """Return what a driver needs who brakes so long after the word, m; speed in km/h."""
    v = speed / 3.6
    return v * reaction + v**2 / (2 * table["deceleration"])


@pytest.mark.parametrize("table", TABLES)
def test_whoever_brakes_at_the_first_red_word_stops_before_the_alarm(tell, table):
    """The last frame that is not red may be an update and a look old when the driver sees the red one."""
    lefts = np.arange(0.01, 120, 0.05)
    for speed, update in itertools.product([5.0, 10.0, 15.0, 22.0, 30.0], UPDATES):
        words = tell.words([(table, known(place(x), speed=speed, update=update)) for x in lefts])
        is_red = np.isin(words, ["brake", "stop"])
        assert is_red[0]
        assert not is_red[-1]
        assert (np.diff(is_red.astype(int)) <= 0).all()  # once red, red until it is passed
        first = lefts[is_red][-1]
        needed = stop_distance(table, speed, table["reaction"] + update) + table["clearance"]
        assert first == pytest.approx(needed, abs=0.06)
        stands = first - stop_distance(table, speed, table["reaction"] + update)
        assert stands >= table["clearance"] - 0.06


@pytest.mark.parametrize("table", TABLES)
def test_nothing_is_green_with_an_alarm_that_counts(tell, table):
    passed = -(table["front"] + table["axle"] + table["clearance"])
    sides = [0.0, 0.5 * table["width"], -(0.5 * table["width"] + table["clearance"])]
    lefts = np.concatenate([np.arange(passed + 0.01, 0, 0.5), np.arange(0.01, 300, 7.0)])
    cases = [
        (table, known(place(x, aside), speed=speed, update=update, sight=sight, before=before))
        for x, aside, speed, update, sight, before in itertools.product(
            lefts, sides, [*SPEEDS, None], UPDATES, [0.0, 15.0, 1e4], ["clear", "brake", "over"]
        )
    ]
    assert len(cases) > 20_000
    words = tell.words(cases)
    assert "clear" not in words
    assert set(words) == {"slow", "brake", "stop", "over"}


@pytest.mark.parametrize("table", TABLES)
def test_nearer_or_faster_is_never_told_less(tell, table):
    lefts = np.arange(60, 0.01, -0.2)
    for update in UPDATES:
        grid = [
            [
                SEVERITY[w]
                for w in tell.words(
                    [(table, known(place(x), speed=v, update=update)) for x in lefts]
                )
            ]
            for v in SPEEDS
        ]
        assert (np.diff(grid, axis=1) >= 0).all()
        assert (np.diff(grid, axis=0) >= 0).all()


def test_amber_comes_before_red_by_the_warning(tell):
    """A driver at the advised speed has the warning until BRAKE; one who keeps to it as it falls never sees BRAKE."""
    table = numbers()
    lefts = np.arange(2.0, 60, 0.25)
    advised = [one["fastest"] for one in tell([(table, known(place(x))) for x in lefts])]
    for left, most in zip(lefts, advised, strict=True):
        if most is None:
            continue
        after = left - most / 3.6 * table["warning"]
        assert tell.words([(table, known(place(left), speed=most))]) == ["slow"]
        needed = stop_distance(table, most, table["reaction"] + 0.5) + table["clearance"]
        assert after >= needed - 1e-6
        one_more = stop_distance(table, most + 1, table["reaction"] + table["warning"] + 0.5)
        assert left < one_more + table["clearance"]
    left, speed, seen = 40.0, 30.0, []
    while left > 0 and (not seen or seen[-1]["word"] != "stop"):
        seen += tell(
            [(table, known(place(left), speed=speed, before=seen[-1]["word"] if seen else "clear"))]
        )
        speed = min(speed, seen[-1]["fastest"] or 0.0)
        left -= max(speed, 0.5) / 3.6 * 0.2
        if len(seen) == 1:
            continue
        assert seen[-1]["word"] in ("slow", "stop")
    assert left > table["clearance"]


def test_only_what_is_strong_and_in_the_way_counts(tell):
    table = numbers(width=2.0, clearance=0.5)
    beside, weak = place(3.0, 1.51), place(3.0, 0.0, confidence=-0.01)
    assert tell.words([(table, known(one, speed=5.0)) for one in (beside, weak)]) == ["clear"] * 2
    edges = [place(3.0, 1.5), place(3.0, -1.5), place(3.0, 0.0, confidence=0.0)]
    assert tell.words([(table, known(one, speed=5.0)) for one in edges]) == ["brake"] * 3


def test_an_alarm_stays_until_the_rear_axle_has_passed_it(tell):
    table = numbers(front=1.0, axle=4.0, clearance=0.5)
    lefts = [-0.01, -3.0, -5.49, -5.51, -9.0]
    answers = tell([(table, known(place(x), speed=5.0)) for x in lefts])
    assert [one["word"] for one in answers] == ["over"] * 3 + ["clear"] * 2
    assert [one["left"] for one in answers[:3]] == pytest.approx([5.49, 2.5, 0.01])
    two = [place(-3.0), place(-1.0, name="alarm-2")]
    assert tell([(table, known(*two, speed=5.0))])[0]["left"] == pytest.approx(4.5)  # of the last
    ahead = tell([(table, known(place(-3.0), place(2.0, name="alarm-2"), speed=5.0))])[0]
    assert (ahead["word"], ahead["alarm"]["id"]) == ("brake", "alarm-2")  # red for the next one


def test_without_radar_or_speed_it_is_stop(tell):
    table = numbers()
    blind = [
        known(speed=5.0, blind=True),
        known(place(50.0), blind=True),
        known(place(-1.0), blind=True),
    ]
    assert tell.words([(table, one) for one in blind]) == ["stop"] * 3
    assert tell.words([(table, known(place(14.0), speed=None))]) == ["stop"]
    assert tell.words([(table, known(speed=None))]) == ["slow"]  # any speed is too fast to be clear


def test_clear_reaches_as_far_as_ground_is_searched(tell):
    table = numbers()
    most = tell([(table, known(speed=0.0))])[0]["fastest"]
    needed = stop_distance(table, most, table["reaction"] + table["warning"] + 0.5)
    assert needed + table["clearance"] <= 15.0
    assert tell.words([(table, known(speed=v)) for v in (most, most + 1)]) == ["clear", "slow"]
    unseen = tell([(table, known(speed=1.0, sight=0.0))])[0]
    assert (unseen["word"], unseen["fastest"]) == ("slow", math.floor(3.6 * Vehicle().walk))


def test_brake_holds_until_the_speed_is_one_for_the_distance(tell):
    table = numbers()
    now = known(place(11.0), speed=10.0)
    assert tell.words([(table, now), (table, {**now, "before": "brake"})]) == ["slow", "brake"]
    most = tell([(table, now)])[0]["fastest"]
    slow = known(place(11.0), speed=most, before="brake")
    assert tell.words([(table, slow)]) == ["slow"]


def test_a_longer_update_or_latency_brakes_earlier(tell):
    """What is late lies nearer by what was driven meanwhile; what comes seldom needs its time as well."""
    table = numbers()
    lefts = np.arange(0.05, 30, 0.05)
    first = []
    for update in (0.1, 0.5, 1.0):
        words = tell.words([(table, known(place(x), speed=15.0, update=update)) for x in lefts])
        first.append(lefts[np.isin(words, ["brake", "stop"])][-1])
    assert np.diff(first) == pytest.approx([0.4 * 15 / 3.6, 0.5 * 15 / 3.6], abs=0.06)


def test_seconds_left_are_those_until_brakes_must_hold(tell):
    table = numbers()
    v = 10 / 3.6
    left = 6.0
    answer = tell([(table, known(place(left), speed=10.0))])[0]
    assert answer["word"] == "brake"
    assert answer["left"] == pytest.approx((left - 0.5 - v**2 / 6) / v)
    near = 0.5 + v**2 / 6
    words = tell.words([(table, known(place(near + e), speed=10.0)) for e in (0.01, -0.01)])
    assert words == ["brake", "stop"]
