"""What a command prints beside its result."""

import logging
import warnings
from pathlib import Path

import pytest
import typer

from flgpr.commands.messages import in_shell_words, is_unchanged, plain_errors
from flgpr.store.notes import log_note
from flgpr.store.outputs import log_finished


def test_an_error_of_the_user_is_one_line_and_status_2(capsys):
    with pytest.raises(typer.Exit) as ended, plain_errors():
        raise ValueError("halo must be positive, got -1")
    assert ended.value.exit_code == 2
    shown = capsys.readouterr()
    assert shown.err == "error: halo must be positive, got -1\n"
    assert shown.out == ""


@pytest.mark.parametrize("fault", [KeyError("halo"), BrokenPipeError()])
def test_a_fault_of_the_program_and_a_closed_pipe_pass(fault, capsys):
    with pytest.raises(type(fault)), plain_errors():
        raise fault
    assert capsys.readouterr().err == ""


def test_a_warning_has_no_position_in_the_source(capsys):
    before = warnings.showwarning
    with plain_errors():
        warnings.simplefilter("always")
        warnings.warn("truth holds no targets", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "warning: truth holds no targets\n"
    assert warnings.showwarning is before


def test_a_note_is_printed_once_and_not_when_quiet(capsys):
    with plain_errors():
        log_note("2 rows are empty")
        log_note("2 rows are empty")
        log_note("depths are in cm")
    assert capsys.readouterr().err == "note: 2 rows are empty\nnote: depths are in cm\n"
    with plain_errors(quiet=True):
        log_note("2 rows are empty")
    assert capsys.readouterr().err == ""


def test_an_output_that_was_left_is_remembered_until_the_next_command(capsys):
    with plain_errors():
        log_finished(Path("lane.zarr"))
        assert is_unchanged(Path("lane.zarr"))
        assert not is_unchanged(Path("other.zarr"))
    assert "lane.zarr exists already, made from the same inputs" in capsys.readouterr().err
    with plain_errors(quiet=True):
        assert not is_unchanged(Path("lane.zarr"))
        log_finished(Path("lane.zarr"))
        assert is_unchanged(Path("lane.zarr"))
    assert capsys.readouterr().err == ""


def test_loggers_are_left_as_they_were(caplog):
    loggers = [logging.getLogger(name) for name in ("flgpr.outputs", "flgpr.notes")]
    for logger in loggers:
        caplog.set_level(logging.ERROR, logger.name)
    before = [(logger.level, list(logger.handlers)) for logger in loggers]
    with pytest.raises(typer.Exit), plain_errors():
        raise OSError("no disk")
    assert [(logger.level, list(logger.handlers)) for logger in loggers] == before


def test_parameters_and_verbs_of_python_are_options_and_commands_in_the_shell():
    names = {"lane": "--lane", "others": "--with", "max_memory": "--max-memory"}
    text = (
        "max_memory of a lane: give `lane`, `others` NAME=RUN or `model`; train with `flgpr.train`"
    )
    told = (
        "--max-memory of a lane: give --lane, --with NAME=RUN or `model`; train with `flgpr train`"
    )
    assert in_shell_words(text, names) == told
    assert in_shell_words(text, None).startswith("max_memory of a lane: give `lane`")
