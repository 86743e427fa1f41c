"""Every command that writes, given twice: its own output is told and left alone, another one there is refused."""

import os
import shutil

import pytest

from every_command import COMMANDS, make_cheap, make_inputs, names_of_commands
from flgpr.results.result import are_settled
from flgpr.store.files import replaced_by, write_whole
from flgpr.store.journal import JOURNAL
from flgpr.store.outputs import locked_folder
from robust import digests


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    return make_inputs(tmp_path_factory.mktemp("inputs"))


def stamps(folder):
    """When each file was last written; a lock or a look leaves that alone."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def leave_as_a_kill_after_naming(output, given):
    """Put into and beside the stores that a command made what a kill leaves when a store has just got its name."""
    for manifest in set(output.rglob("commit.json")) - given:
        store = manifest.parent
        (store / JOURNAL).write_bytes(b"half a li")
        for left in (store.with_name(f".discarded-{store.name}-abc"), replaced_by(store)):
            left.mkdir()
            (left / "zarr.json").write_text("{")


GROWS = ("live", "feed", "score --sealed", "benchmark oracle", "benchmark compare")
"""What tells of every start, plays again, or is looked at again."""


SLOW = ("demo", "design", "simulate gprmax", "detect a survey")
"""What ``make robustness`` tries alone."""
GIVEN = [one.name for one in COMMANDS if one.name not in SLOW or "FLGPR_KILLS" in os.environ]


@pytest.mark.slow("runs every command three times")
@pytest.mark.parametrize("name", GIVEN)
def test_given_again_it_says_so_and_on_another_input_it_is_refused(
    name, commands, tmp_path, monkeypatch
):
    command = commands[name]
    make_cheap(command, monkeypatch.setattr)
    output = tmp_path / "out"
    command.start(output)
    given = set(output.rglob("commit.json"))
    command(output)
    want = command.content(output)
    times = stamps(output)
    if not name.startswith("reproduce"):  # studies make a lane anew that was killed there
        leave_as_a_kill_after_naming(output, given)
    again = command.run(output)
    assert again.exit_code == 0, again.output
    assert "Traceback" not in again.output
    assert command.content(output) == want
    if name not in GROWS:
        assert "exists already" in again.stderr
        assert stamps(output) == times
    if command.other:
        before = digests(output)
        other = command.run(output, command.other)
        assert other.exit_code == 2, other.output
        assert other.stderr.count("error: ") == 1
        assert digests(output) == before
    left = [path.name for path in output.rglob("*")]
    assert not [
        one for one in left if ".partial" in one or ".replaced" in one or one.endswith(".work")
    ]


MADE_BY_WHOLE_FILES = [
    one.name
    for one in COMMANDS
    if one.name.startswith(("export", "recipe", "info", "simulate preview", "image"))
]


@pytest.mark.slow("runs every command three times")
@pytest.mark.parametrize("name", MADE_BY_WHOLE_FILES)
def test_a_file_of_the_same_name_with_other_bytes_is_never_written_over(name, commands, tmp_path):
    command = commands[name]
    output = tmp_path / "out"
    command.start(output)
    command(output)
    for path in [one for one in output.iterdir() if one.is_file()]:
        whole = path.read_bytes()
        path.write_bytes(whole + b"\n")
        before = digests(output)
        told = command.run(output)
        assert told.exit_code == 2, told.output
        assert f"output must not exist yet, got {path}, which holds something else" in told.stderr
        assert digests(output) == before
        path.write_bytes(whole)
    assert command.run(output).exit_code == 0


def test_every_command_of_the_command_line_is_tried():
    tried = {" ".join(one.words.split()[:2]) for one in COMMANDS} | {
        one.words.split()[0] for one in COMMANDS
    }
    writes_nothing = {
        "view", "replay", "recipe list", "recipe show", "recipe check", "recipe suggest", "check",
        "benchmark list", "benchmark validate", "plan mines", "plan check", "calibrate permittivity", "agree",
    }  # fmt: skip
    assert set(names_of_commands()) - writes_nothing - tried == set()


@pytest.mark.slow("runs every command three times")
def test_a_live_run_takes_away_what_a_killed_one_left_and_refuses_a_second_one(commands, tmp_path):
    command = commands["live"]
    output = tmp_path / "out"
    command.start(output)
    command(output)
    want = command.content(output)
    for name in ("snapshot.bundle.123-abcd.partial", "alarms.csv.partial", "live.json.partial"):
        (output / "live" / name).write_bytes(b"half")
    with locked_folder(output / "live"):
        told = command.run(output)
        assert told.exit_code == 2
        assert "another process is writing here" in told.stderr
    command(output)
    assert command.content(output) == want


@pytest.mark.slow("runs every command three times")
def test_a_score_that_was_stopped_before_its_last_step_is_finished(commands, tmp_path, monkeypatch):
    """The manifest of the result still allows the files of before, too."""
    command = commands["score in a result"]
    output = tmp_path / "out"
    command.start(output)
    command(output)
    want = command.content(output)
    shutil.rmtree(output)
    command.start(output)
    written = []

    def stop(path, data):
        written.append(path.name)
        if written.count("manifest.json") == 2:
            raise KeyboardInterrupt
        write_whole(path, data)

    with monkeypatch.context() as patch:
        patch.setattr("flgpr.results.result.write_whole", stop)
        assert command.run(output).exit_code != 0
    assert not are_settled(output / "result")
    command(output)
    assert command.content(output) == want


@pytest.mark.slow("trains")
def test_a_training_at_the_same_output_is_refused(commands, tmp_path):
    command = commands["train"]
    output = tmp_path / "out"
    command.start(output)
    with locked_folder(output / ".partial-model"):
        told = command.run(output)
    assert told.exit_code == 2
    assert "another process is writing here" in told.stderr
