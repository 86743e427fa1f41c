"""Every command is reachable, has a help, and the program states its version."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import COMMANDS, GROUPS, app


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_version():
    assert call("--version").stdout.startswith("flgpr ")


ALL = [(name,) for name in COMMANDS]
ALL += [(group, name) for (group, _), functions in GROUPS.items() for name in functions]


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_every_command_has_a_help(words):
    done = call(*words, "--help")
    assert done.exit_code == 0, done.output
    assert f"Usage: root {' '.join(words)}" in done.output


def test_without_a_command_the_help_is_shown():
    shown = call().output
    for name in [*COMMANDS, *(group for group, _ in GROUPS)]:
        assert name in shown


def test_a_command_that_is_not_there_is_refused():
    done = call("detekt")
    assert done.exit_code == 2
    assert "No such command 'detekt'" in done.output
