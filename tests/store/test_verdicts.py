"""Verdicts come back, and what no analyst wrote is refused by its rule."""

import pytest

from flgpr.store import check_verdicts, parse_verdicts, read_verdicts, verdict_bytes, verdict_key

NOTE = {
    "result_sha256": "",
    "result": "lane a",
    "detection": "main",
    "alarm_id": "alarm-1",
    "x": 1.5,
    "y": None,
    "verdict": "mine",
    "text": "é",
}


def content(*notes, version=1):
    return {"format": "flgpr-notes", "version": version, "notes": list(notes)}


def test_notes_come_back(tmp_path):
    path = tmp_path / "anna.json"
    path.write_bytes(verdict_bytes([NOTE]))
    assert read_verdicts(path) == [NOTE]


def test_a_result_is_known_by_its_identity_and_else_by_its_title():
    assert verdict_key(NOTE) == ("lane a", "main", "alarm-1")
    assert verdict_key({**NOTE, "result_sha256": "ab"}) == ("ab", "main", "alarm-1")


def test_unknown_entries_are_left_out_and_long_text_is_cut():
    (note,) = check_verdicts(content({**NOTE, "text": "a" * 600, "script": "x"}))
    assert note == {**NOTE, "text": "a" * 500}


@pytest.mark.parametrize(
    ("value", "rule"),
    [
        ([], "format must be flgpr-notes version 1"),
        (content(version=2), "format must be flgpr-notes version 1"),
        ({**content(), "notes": {}}, "notes: Input should be a valid list"),
        (content("a"), r"notes.0: input should be a valid dictionary"),
        (content({**NOTE, "text": 1}), r"notes.0.text: input should be a valid string, got 1"),
        (
            content({**NOTE, "alarm_id": ""}),
            r"notes.0.alarm_id: string should have at least 1 character",
        ),
        (content({**NOTE, "verdict": "bush"}), "notes.0.verdict: .*got 'bush'"),
        (content({**NOTE, "x": 1e10}), "notes.0.x.*: input should be less than 1000000000"),
        (content({**NOTE, "y": "1"}), "notes.0.y.*: input should be a valid"),
        (content(NOTE, NOTE), "notes must name every alarm once"),
    ],
)
def test_what_breaks_a_rule_is_refused(value, rule):
    with pytest.raises(ValueError, match=rule):
        check_verdicts(value)


def test_errors_name_the_file(tmp_path):
    with pytest.raises(ValueError, match=r"b.json: not verdicts of `flgpr.view`"):
        parse_verdicts(b"{", tmp_path / "b.json")
