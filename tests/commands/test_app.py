"""Every command is reachable, has a help, and the program states its version."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import COMMANDS, HELP_PANELS, app


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_version():
    assert call("--version").stdout.startswith("flgpr ")


@pytest.mark.parametrize("words", COMMANDS)
def test_every_command_has_a_help(words):
    done = call(*words.split(), "--help")
    assert done.exit_code == 0, done.output
    assert f"Usage: root {words}" in done.output


def test_without_a_command_the_help_is_shown():
    shown = call().output
    for words in HELP_PANELS.values():
        assert all(word in shown for word in words)


def test_a_command_that_is_not_there_is_refused():
    done = call("detekt")
    assert done.exit_code == 2
    assert "No such command 'detekt'" in done.output
