"""One signature, as Python and as the command line see it."""

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer import Argument, Option
from typer.testing import CliRunner

from flgpr.commands.app import COMMANDS
from flgpr.commands.options import REQUIRED, ShellDefault, ShellType
from flgpr.commands.shell import ErrorStreamText, RawText, command, shell_function
from flgpr.commands.signatures import help_of, shell_type, type_in_words


@command(
    lines=lambda made, call: [f"made {made}", ErrorStreamText("aside"), RawText("end")],
    as_json=lambda made, call: {"made": made},
    status=lambda made: 3 if made == "b" else 0,
)
def example(
    name: Annotated[str, Argument(help="What to make.")],
    size: Annotated[float, Option(help="How large, m.")] = 1.0,
    output: Annotated[str | Path | None, Option("-o", help="What to write."), REQUIRED] = None,
    keep: Annotated[bool, Option("--keep", help="Keep it."), ShellDefault(False)] = True,
    parts: Annotated[Sequence[str], Option("--part", help="A part."), ShellType(list[str])] = (),
    *,
    more: Annotated[int, "Of Python alone."] = 0,
) -> "Nothing":  # noqa: F821 - it need not be loaded
    """Make an example.

    Returns
    -------
    str
        The name.
    """
    if size <= 0:
        raise ValueError(f"size must be positive, got {size:g}")
    example.seen = (size, output, keep, list(parts), more)
    return name


def run(*words):
    app = typer.Typer()
    app.command()(shell_function(example))
    return CliRunner().invoke(app, list(words))


def test_python_sees_plain_types_and_all_parameters():
    signature = inspect.signature(example)
    assert str(signature) == "(name, size=1.0, output=None, keep=True, parts=(), *, more=0)"
    assert repr(signature.parameters["size"].annotation) == "float"
    before, _, after = example.__doc__.partition("Parameters\n----------\n")
    assert before.strip() == "Make an example."
    assert "more : Of Python alone.\n" in after
    assert after.index("Of Python alone") < after.index("Returns\n")
    assert example("a") == "a"
    assert example.seen == (1.0, None, True, [], 0)
    with pytest.raises(ValueError, match="size must be positive, got 0"):
        example("a", 0)


def test_the_command_line_sees_options_their_help_and_their_own_defaults():
    shown = run("--help").output
    assert "Make an example." in shown
    assert "Returns" not in shown
    assert "--more" not in shown
    assert shown.index("-o") < shown.index("--size")  # what must be given comes first
    assert run("a").exit_code == 2
    done = run("a", "-o", "x", "--part", "1", "--part", "2")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "made a\nend", "aside\n")
    assert example.seen == (1.0, Path("x"), False, ["1", "2"], 0)


def test_a_paragraph_of_help_is_wrapped_by_the_terminal_alone():
    def two_lines():
        """Do it.

        A sentence that the source breaks
        in the middle.

        Parameters
        ----------
        """

    two_lines.__doc__ = inspect.cleandoc(two_lines.__doc__)
    expected = "Do it.\n\nA sentence that the source breaks in the middle."
    assert help_of(two_lines) == expected


def test_errors_are_a_line_and_json_an_object():
    wrong = run("a", "-o", "x", "--size", "-1")
    assert (wrong.exit_code, wrong.stderr) == (2, "error: size must be positive, got -1\n")
    assert run("a", "-o", "x", "--json").stdout == '{"made": "a"}\n'
    assert run("a", "-o", "x", "--quiet").output == ""
    assert run("b", "-o", "x").exit_code == 3


@pytest.mark.parametrize(
    ("annotation", "parsed", "words"),
    [
        (str | Path, Path, "str | Path"),
        (str | Path | None, Path | None, "str | Path | None"),
        (Sequence[str | Path], list[Path], "Sequence[str | Path]"),
        (str | Path | Sequence[str | Path], list[Path], "str | Path | Sequence[str | Path]"),
        (tuple[float, float] | None, tuple[float, float] | None, "tuple[float, float] | None"),
        (str | int, str, "str | int"),
    ],
)
def test_types_of_python_and_what_the_command_line_parses(annotation, parsed, words):
    assert shell_type(annotation) == parsed
    assert type_in_words(annotation) == words


@pytest.mark.parametrize("name", COMMANDS)
def test_every_parameter_of_every_command_is_described(name):
    function = COMMANDS[name]
    for one in function.command.parameters:
        assert one.help, f"{name}: {one.name} says nothing of itself"
    sections = function.__doc__
    assert sections.index("Parameters\n") if function.command.parameters else True
    returned = inspect.signature(function).return_annotation
    assert "Returns\n" in sections or str(returned) == "None" or repr(returned) == "None"
