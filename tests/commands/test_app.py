"""Every command is reachable, has a help, and the program states its version."""

from importlib.metadata import EntryPoint

import pytest
from typer.testing import CliRunner

import flgpr.commands.app as application
from flgpr.commands.app import COMMANDS, HELP_PANELS, app
from flgpr.commands.shell import Offer, command


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


@command()
def _strange() -> None:
    """Stand in for a command of another package."""


OFFER = Offer({"detect": _strange, "strange": _strange}, {"Others": {"strange": ""}})


def test_a_package_cannot_replace_a_command(monkeypatch):
    offered = EntryPoint("strange", f"{__name__}:OFFER", "flgpr.commands")
    monkeypatch.setattr(application, "entry_points", lambda group: [offered])
    for table, kept in (("COMMANDS", dict(COMMANDS)), ("HELP_PANELS", dict(HELP_PANELS))):
        monkeypatch.setattr(application, table, kept)
    monkeypatch.setattr(application, "LEFT_OUT", [])
    monkeypatch.setattr(EntryPoint, "load", lambda self: OFFER)

    application._take_in_other_packages()

    assert application.COMMANDS["detect"] is COMMANDS["detect"]
    assert application.COMMANDS["strange"] is _strange
    assert "flgpr detect of " in application.LEFT_OUT[0]
    assert "note: flgpr detect of " in call("recipe", "list").stderr
