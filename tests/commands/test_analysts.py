"""Agreement of analysts by their files of verdicts, from Python and by command."""

import json

import pytest
from sklearn.metrics import cohen_kappa_score
from typer.testing import CliRunner

from flgpr.commands.agree import agree
from flgpr.commands.app import app


def judged(path, verdicts, result="ab12", text=""):
    notes = [
        {
            "result": "lane",
            "result_sha256": result,
            "detection": "main",
            "alarm_id": name,
            "verdict": one,
            "text": text,
        }
        for name, one in verdicts.items()
    ]
    path.write_text(json.dumps({"format": "flgpr-notes", "version": 1, "notes": notes}))
    return path


@pytest.fixture
def analysts(tmp_path):
    anna = {"a": "mine", "b": "mine", "c": "clutter", "d": "clutter", "e": "unsure", "f": ""}
    ben = {"a": "mine", "b": "clutter", "c": "clutter", "d": "clutter", "f": "mine", "g": "mine"}
    return [judged(tmp_path / "anna.json", anna, text="x"), judged(tmp_path / "ben.json", ben)]


def test_analysts_are_compared_on_the_alarms_that_both_judged(analysts):
    told, only_anna, only_ben = agree(analysts)["anna", "ben"]
    assert (told.n, told.agreed, only_anna, only_ben) == (4, 3, 1, 2)
    assert told.kappa == pytest.approx(
        cohen_kappa_score(["m", "m", "c", "c"], ["m", "c", "c", "c"])
    )


def test_the_command_says_it_in_words_and_for_machines(analysts):
    ran = CliRunner().invoke(app, ["score", "--agreement", *map(str, analysts)])
    assert ran.exit_code == 0
    assert (
        "anna and ben: 3 of 4 alarms judged alike, 0.75 (0.19 to 0.99); by chance 0.50"
        in ran.output
    )
    assert "judged by anna alone 1, by ben alone 2" in ran.output
    rows = [line.split() for line in ran.output.splitlines()]
    assert ["mine", "1", "0", "1"] in rows
    assert ["clutter", "0", "0", "2"] in rows
    ran = CliRunner().invoke(app, ["score", "--agreement", "--json", *map(str, analysts)])
    [pair] = json.loads(ran.output)
    assert (pair["first"], pair["n"], pair["table"]["mine"]["clutter"]) == ("anna", 4, 1)


def test_what_are_no_verdicts_is_refused_in_a_line(analysts, tmp_path):
    other = judged(tmp_path / "other.json", {"a": "mine"}, result="cd34")
    twice = tmp_path / "twice.json"
    note = {"result": "lane", "alarm_id": "a", "verdict": "mine"}
    twice.write_text(json.dumps({"format": "flgpr-notes", "version": 1, "notes": [note, note]}))
    wrong = judged(tmp_path / "wrong.json", {"a": "bush"})
    nan = tmp_path / "nan.json"
    nan.write_text(
        '{"format": "flgpr-notes", "version": 1, "notes": [{"alarm_id": "a", "x": NaN}]}'
    )
    (tmp_path / "cut.json").write_text(analysts[0].read_text()[:90])
    cases = {
        "verdicts must have alarms in common": [analysts[0], other],
        "notes must name every alarm once": [analysts[0], twice],
        "verdict: input should be 'mine', 'unsure', 'clutter' or '', got 'bush'": [
            analysts[0],
            wrong,
        ],
        "notes.0.x: input should be a finite number": [analysts[0], nan],
        "not verdicts of `flgpr view`": [analysts[0], tmp_path / "cut.json"],
        "verdicts not found": [analysts[0], tmp_path / "none.json"],
        "two analysts or more, got 1": [analysts[0]],
        "got --truth": [*analysts, "--truth", "t.csv"],
    }
    for words, arguments in cases.items():
        ran = CliRunner().invoke(app, ["score", "--agreement", *map(str, arguments)])
        assert (ran.exit_code, ran.output.count("\n")) == (2, 1), ran.output
        assert words in ran.output


def test_the_verb_and_the_earlier_spelling_print_the_same(analysts):
    now = CliRunner().invoke(app, ["agree", *map(str, analysts)])
    before = CliRunner().invoke(app, ["score", "--agreement", *map(str, analysts)])
    assert (now.exit_code, now.stdout) == (0, before.stdout)
    assert before.stderr == "`flgpr score --agreement` is `flgpr agree` now\n"
