"""``flgpr benchmark`` for what is made elsewhere: lines, JSON, exit status, and arguments as they arrive."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr_ground.commands.submissions import validate_submissions
from submitted import CARD, write_ground, write_submission


@pytest.fixture
def home(tmp_path):
    _, ground = write_ground(tmp_path)
    write_submission(tmp_path / "good", ground)
    write_submission(tmp_path / "bad", ground, card=CARD.replace("hand-made", "bad"))
    (tmp_path / "bad" / "fingerprints.csv").unlink()
    alarms = tmp_path / "bad" / "standard" / "smooth-sand-test-1" / "alarms.csv"
    alarms.write_text("x,y,confidence\n0,1,nan\n")
    return tmp_path


def call(*words):
    return CliRunner().invoke(app, ["benchmark", *map(str, words)])


def test_a_valid_submission_is_said_to_be_one(home):
    done = call("validate", home / "good", "--ground", home / "ground.toml")
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[-1] == (
        f"{home / 'good'}: hand-made is valid: 12 alarms in 4 lists of lanes; splits standard"
    )


def test_every_fault_is_a_line_and_the_status_is_that_of_bad_input(home):
    done = call("validate", home / "good", home / "bad", "--ground", home / "ground.toml")
    assert done.exit_code == 2
    lines = [line for line in done.stdout.splitlines() if not line.startswith("note: ")]
    faulty = f"{home / 'bad'}"
    assert lines[1].startswith(
        f"{faulty}/standard/smooth-sand-test-1/alarms.csv: confidence must be a finite number"
    )
    assert lines[2].startswith(f"{faulty}/fingerprints.csv: ")
    assert lines[3] == f"{faulty}: 2 faults"
    assert done.stderr == ""


def test_faults_for_a_program(home):
    done = call("validate", home / "bad", home / "good", "--ground", home / "ground.toml", "--json")
    assert done.exit_code == 2
    bad, good = json.loads(done.stdout)["submissions"]
    assert (bad["valid"], bad["name"], len(bad["faults"])) == (False, "bad", 2)
    assert (good["valid"], good["faults"], good["alarms"]) == (True, [], {"standard": 12})


def test_a_folder_that_is_not_there_is_refused_in_a_line(tmp_path):
    done = call("validate", tmp_path / "none")
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    with pytest.raises(NotADirectoryError):
        validate_submissions([tmp_path / "none"])


def test_faults_of_what_enters_are_one_line(home):
    done = call("enter", home / "bad", "--ground", home / "ground.toml", "-o", home / "out")
    assert done.exit_code == 2
    assert done.stderr.count("error: ") == 1
    assert "got 2: standard/smooth-sand-test-1/alarms.csv: confidence must" in done.stderr
    assert not (home / "out").exists()


def test_entering_states_the_table_and_the_page(monkeypatch, tmp_path):
    asked = []

    def enter_submissions(*given):
        asked.append(given)
        return "table"

    monkeypatch.setattr("flgpr.proving_ground.enter_submissions", enter_submissions)
    done = call("enter", "a", "b", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert asked == [([Path("a"), Path("b")], tmp_path / "out", None)]
    assert done.stdout.splitlines() == [
        "table", "entered: a, b", f"page: {(tmp_path / 'out' / 'leaderboard.html').resolve()}",
    ]  # fmt: skip


def test_the_leaderboard_is_written_to_the_first_folder(monkeypatch):
    written = []

    def write_leaderboard(folders, output):
        written.append((folders, str(output)))
        return Path(output)

    monkeypatch.setattr("flgpr.proving_ground.write_leaderboard", write_leaderboard)
    assert call("leaderboard", "a", "b").exit_code == 0
    assert call("leaderboard", "a", "-o", "c.html").stdout == "wrote c.html\n"
    assert written == [
        ([Path("a"), Path("b")], str(Path("a/leaderboard.html"))),
        ([Path("a")], "c.html"),
    ]
