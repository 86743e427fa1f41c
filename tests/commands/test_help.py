"""The help: commands and options in boxes, and the options of several commands alike."""

import pytest
import typer
from typer.testing import CliRunner

from alone import needs
from flgpr.commands.app import COMMANDS, HELP_PANELS, app
from flgpr.commands.options import ANCHOR, LANE, OUTPUT, OVERWRITE_HELP

IMPORT_GPR = pytest.param("import gpr", marks=needs("flgpr_exchange"))
LONG = ("detect", "train", "score", "image", "simulate", "live", IMPORT_GPR, "import mapped")
"""Commands of many options, which the help shows in several boxes."""


def parsed_options():
    """Yield the words of every command with each of its options, as they are parsed."""
    root = typer.main.get_command(app)
    for words in COMMANDS:
        command = root
        for word in words.split():
            command = command.commands[word]
        for parameter in command.params:
            if parameter.param_type_name == "option":
                yield words, parameter


def shown_help(*words):
    return CliRunner().invoke(app, [*words, "--help"]).stdout


def test_every_command_is_in_one_box_of_the_help():
    in_boxes = [name for names in HELP_PANELS.values() for name in names]
    first_words = {words.split()[0] for words in COMMANDS}
    assert sorted(in_boxes) == sorted(first_words)
    shown = shown_help()
    places = [shown.index(f"─ {title} ─") for title in HELP_PANELS]
    assert places == sorted(places)


@pytest.mark.parametrize("words", LONG)
def test_a_long_command_has_its_options_in_boxes(words):
    shown = shown_help(*words.split())
    titles = COMMANDS[words].command.panels
    assert titles
    for title in titles:
        assert f"─ {title} ─" in shown


def test_boxes_name_options_that_there_are_and_each_once():
    for words, function in COMMANDS.items():
        described = function.command
        known = {parameter.name for parameter in described.parameters if parameter.shell}
        known |= set(described.shell_flags)
        boxed = [name for names in described.panels.values() for name in names]
        assert set(boxed) <= known, words
        assert len(boxed) == len(set(boxed)), words


@pytest.mark.parametrize(
    ("name", "names", "help_text"),
    [
        ("--output", ["-o", "--output"], OUTPUT.help),
        ("--lane", ["--lane"], LANE.help),
        ("--anchor", ["--anchor"], ANCHOR.help),
        ("--json", ["--json"], "Print one JSON object instead of text."),
        ("--quiet", ["--quiet"], "Print nothing but errors."),
    ],
)
def test_an_option_is_alike_in_all_commands(name, names, help_text):
    commands = []
    for words, option in parsed_options():
        if name in option.opts:
            commands.append(words)
            assert sorted(option.opts) == sorted(names), words
            assert option.help.startswith(help_text), words
    assert len(commands) > 3


def test_overwrite_is_alike_and_live_keeps_its_older_word():
    commands = set()
    for words, option in parsed_options():
        if "--overwrite" in option.opts:
            commands.add(words)
            assert option.help == OVERWRITE_HELP, words
            assert ("--fresh" in option.opts) == (words == "live")
    assert commands == {"compare", "demo", "detect", "live", "score", "train", "trial verdict"}


def test_completion_is_in_the_help_and_offers_commands_and_options():
    assert "--install-completion" in shown_help()
    variables = {
        "_FLGPR_COMPLETE": "complete_bash",
        "COMP_WORDS": "flgpr det",
        "COMP_CWORD": "1",
    }
    commands = CliRunner().invoke(app, [], env=variables, prog_name="flgpr")
    assert commands.stdout.split() == ["detect"]
    variables |= {"COMP_WORDS": "flgpr detect --la", "COMP_CWORD": "2"}
    options = CliRunner().invoke(app, [], env=variables, prog_name="flgpr")
    assert options.stdout.split() == ["--lane", "--lanes-at-once"]
