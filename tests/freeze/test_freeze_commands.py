"""Commands, options and defaults, the keys of ``--json`` and exit codes are what they were."""

import json

import pytest

from flgpr.results.result import read_result, write_result
from freeze.commands import (
    KEYS,
    PRINTED,
    TABLE,
    command_table,
    make_inputs,
    parameters,
    printed,
    run,
    walk,
)
from freeze.frozen import read_json

SLOW = {
    name: pytest.param(name, marks=pytest.mark.slow("a detection that other tests run as well"))
    for name in ("demo", "detect a survey", "detect in sections")
}
COMMANDS = {" ".join(["flgpr", *words]): (words, command) for words, command in walk()}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nothing-here")
    table = command_table(folder)
    assert list(folder.iterdir()) == [], "a command that is refused writes nothing"
    return table


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


def test_these_are_the_commands(table):
    assert sorted(table) == sorted(read_json(TABLE))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_takes_what_it_took_and_ends_as_it_ended(name, table):
    assert table[name] == read_json(TABLE)[name]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_all_that_a_command_takes(name, tmp_path):
    words, command = COMMANDS[name]
    told = run([*words, "--help"], tmp_path).stdout
    options = [key for key in parameters(command) if key.startswith("-")]
    for option in {one for key in options for one in key.split(" / ")}:
        assert option in told, option


def test_whatever_prints_json_is_tried():
    offering = {
        " ".join(words) for words, command in COMMANDS.values() if "--json" in parameters(command)
    }
    tried = {one for one in offering for name in PRINTED if f"{name} ".startswith(f"{one} ")}
    assert tried == offering


@pytest.mark.slow("runs every command that prints JSON")
@pytest.mark.parametrize("name", [SLOW.get(name, name) for name in PRINTED])
def test_json_has_the_keys_that_it_had(name, inputs, tmp_path):
    output = tmp_path / "out"
    output.mkdir()
    assert printed(name, inputs, output) == read_json(KEYS)[name]


def test_exit_codes_of_what_is_done_is_there_already_or_refused(inputs, tmp_path):
    words = ["recipe", "for", inputs / "run.zarr", "-o", tmp_path / "a.toml"]
    assert run(words, tmp_path).exit_code == 0
    assert run(words, tmp_path).exit_code == 0
    (tmp_path / "a.toml").write_text("another\n")
    assert run(words, tmp_path).exit_code == 2


def test_exit_code_of_a_result_that_is_not_found_again(inputs, tmp_path):
    """Alarms of one recipe are written as those of another, so that the replay finds others."""
    result = read_result(inputs / "result")
    other = (inputs / "other.toml").read_text()
    run_of_it = result.manifest["run"]
    write_result(tmp_path / "result", result.detections, other, result.lane, run_of_it)
    done = run(["replay", tmp_path / "result", "--json"], tmp_path)
    assert not json.loads(done.stdout)["agrees"]
    assert done.exit_code == 1
