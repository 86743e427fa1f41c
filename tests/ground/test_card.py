"""Cards of submissions: what they must say, and what a hostile one cannot do."""

import pytest

from flgpr_ground.card import parse_card
from submitted import CARD


def faults_of(text):
    card, faults = parse_card(text.encode() if isinstance(text, str) else text)
    assert (card is None) == bool(faults)
    return faults


def test_a_card_is_read_as_it_stands():
    card, faults = parse_card(CARD.encode())
    assert faults == []
    assert card.name == "hand-made"
    assert card.authors == ("A. Author", "B. Author")
    assert card.date.isoformat() == "2026-11-20"
    assert card.parameters == {"threshold": 0.5, "window": "hann"}
    assert card.cost.training_seconds == 30
    assert card.why_not_ranked == ""


@pytest.mark.parametrize(
    ("what", "reason"),
    [("test_lanes_seen", "test lanes were seen"), ("test_truth_seen", "test truth was seen")],
)
def test_a_card_that_says_that_something_was_seen_is_not_ranked(what, reason):
    card, _ = parse_card(CARD.replace(f"{what} = false", f"{what} = true").encode())
    assert card.why_not_ranked == f"its card says that {reason}"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('name = "hand-made"', 'name = "../../out"', "name: "),
        ('name = "hand-made"', 'name = "Hand Made"', "name: "),
        ('name = "hand-made"', f'name = "{"a" * 41}"', "name: "),
        ('name = "hand-made"', "name = 3", "name: "),
        ('name = "hand-made"', f"name = 0x{'f' * 5000}", "name: "),
        ('format = "flgpr-submission-1"', 'format = "zip"', "format: "),
        ('["A. Author", "B. Author"]', "[]", "authors: "),
        ('"B. Author"', '"B.\\u202e Author"', "authors.1: "),
        ('"B. Author"', '"B.\\u001b[31m Author"', "authors.1: "),
        ('"B. Author"', '"   "', "authors.1: "),
        ("date = 2026-11-20", 'date = "yesterday"', "date: "),
        ("seconds_per_km = 120", "seconds_per_km = -1", "cost.seconds_per_km: "),
        ("seconds_per_km = 120", "seconds_per_km = nan", "cost.seconds_per_km: "),
        ("seconds_per_km = 120", "", "cost.seconds_per_km: is missing"),
        ("test_lanes_seen = false", "", "test_lanes_seen: is missing"),
        ("test_lanes_seen = false", 'test_lanes_sen = "no"', "did you mean test_lanes_seen?"),
        ("threshold = 0.5", "threshold = [[1]]", "parameters.threshold"),
        ('window = "hann"', f'window = "{"w" * 301}"', "parameters: must have at most 300"),
        ('method = "Alarms', f'method = "{"m" * 400}', "method: "),
    ],
)
def test_an_entry_that_breaks_a_rule_is_named(old, new, fault):
    assert old in CARD
    faults = faults_of(CARD.replace(old, new))
    assert any(fault in line for line in faults), faults
    assert all(line.isprintable() and len(line) < 320 for line in faults)


@pytest.mark.parametrize(
    ("old", "fits", "too_large"),
    [
        ("seconds_per_km = 120", "seconds_per_km = 1e9", "seconds_per_km = 1.1e9"),
        ("training_seconds = 30", "training_seconds = 1e9", "training_seconds = 1.1e9"),
        ("training_seconds = 30", "peak_mib = 1e9", "peak_mib = 1.1e9"),
        ("threshold = 0.5", "weights = 70_000_000_000", "weights = 1.1e20"),
        ("threshold = 0.5", "seed = 9223372036854775807", "seed = -1.1e20"),
    ],
)
def test_numbers_of_real_entries_fit_and_larger_ones_are_refused(old, fits, too_large):
    assert faults_of(CARD.replace(old, fits)) == []
    faults = faults_of(CARD.replace(old, too_large))
    assert len(faults) == 1
    assert "must lie between -1e+" in faults[0]


def test_all_faults_are_found_at_once():
    text = CARD.replace('name = "hand-made"', 'name = "?"').replace("2026-11-20", '"never"')
    text = text.replace("seconds_per_km = 120", "seconds_per_km = -1")
    starts = [line.split(":")[0] for line in faults_of(text)]
    assert sorted(starts) == ["cost.seconds_per_km", "date", "name"]


def test_a_thousand_unknown_entries_are_counted():
    lines = "\n".join(f"entry{number} = {number}" for number in range(1000))
    faults = faults_of(f"{lines}\n{CARD}")
    assert len(faults) == 51
    assert faults[-1] == "and 950 more entries that break a rule"


@pytest.mark.parametrize(
    "data", [b"\xff\xfe", b"[[[[", b"a" * 100, ("a." * 300 + "b = 1").encode()]
)
def test_what_is_no_toml_is_one_line(data):
    assert len(faults_of(data)) == 1


def test_a_key_that_would_move_the_cursor_is_escaped():
    [fault] = faults_of(CARD.replace("format =", '"\\u001b[2J" = 1\nformat =', 1))
    assert "\x1b" not in fault
    assert "\\x1b" in fault
