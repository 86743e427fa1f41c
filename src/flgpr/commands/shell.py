"""The layer between the command line and the functions of the commands.

A command is a function with a typed signature. :func:`command` states how the command line shows
what it returns; :func:`shell_function` makes of both what Typer runs: it parses, calls the
function, shows progress, prints text or JSON, and turns errors that the user can mend into one
line.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from typer.models import ArgumentInfo, OptionInfo

from flgpr.commands.messages import GOES_ON, STOPPED, is_unchanged, plain_errors, say
from flgpr.commands.signatures import (
    Parameter,
    documentation_of,
    flag,
    help_of,
    parameters_of,
    python_documentation,
    python_signature,
)

if TYPE_CHECKING:
    from flgpr.progress import Track

F = TypeVar("F", bound=Callable[..., Any])

QUIET_HELP = "Print nothing but errors."
JSON_HELP = "Print one JSON object instead of text."
Arguments = SimpleNamespace
"""The arguments that a command was called with, by name."""


class ErrorStreamText(str):
    """A line that is printed on the error stream."""

    __slots__ = ()


class RawText(str):
    """A text that is printed without a line break behind it."""

    __slots__ = ()


def written(returned: Any, call: Arguments) -> Iterator[Any]:
    """Yield the files that a command returned, or else the output that it was to write."""
    if isinstance(returned, Path):
        yield returned
    elif isinstance(returned, list):
        yield from returned
    elif vars(call).get("output") is not None:
        yield call.output


@dataclass
class Command:
    """A function, and how the command line shows what it returns.

    ``lines`` yields what is printed unless ``--quiet`` or ``--json`` is given: text, a path for
    "wrote PATH" where something was written, or an object that rich prints. By default it is what
    was written.
    """

    function: Callable[..., Any]
    lines: Callable[[Any, Arguments], Iterable[Any]] = written
    #: returns the object that --json prints; True prints what the function returns
    as_json: Callable[[Any, Arguments], Any] | bool = False
    #: lines that are printed before the work begins
    lines_before: Callable[[Arguments], Iterable[str]] | None = None
    #: checks options, and returns what the command line passes for parameters of Python alone
    python_values: Callable[[Arguments], Mapping[str, Any]] | None = None
    status: Callable[[Any], int] | None = None  #: exit status for what was returned
    #: context of call and output, such as a page that stays open
    context: Callable[[Arguments], AbstractContextManager[Any]] | None = None
    shell_flags: Mapping[str, str] = field(default_factory=dict)  #: of the command line alone: help
    #: names of parameters by the title of the box in which the help shows them, beside what the
    #: docstring says
    panels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    quiet: bool = True  #: whether there is --quiet
    always_printed: bool = False  #: whether its lines are the answer, printed even when quiet
    resumes: bool = False  #: whether the same command goes on where it was interrupted
    compiles_kernels: bool = False  #: whether kernels are compiled while the first data are read

    @cached_property
    def parameters(self) -> list[Parameter]:
        """Return the parameters of the function with their annotations."""
        return parameters_of(self.function)


@dataclass(frozen=True)
class Offer:
    """Commands that a package offers to the command line, by an entry point of its own."""

    commands: Mapping[str, Callable[..., Any]]  #: functions by their words, "benchmark run"
    #: by the title of a box of the help: first words that are new, each with its help where a
    #: second word follows
    panels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def command(**fields: Any) -> Callable[[F], F]:
    """Make a function a command; the keywords are the fields of :class:`Command`.

    Called from Python the function prints nothing and raises its errors. ``help()`` shows its
    signature with plain types and the parameters with the help of the command line.
    """

    def decorate(function: F) -> F:
        said = documentation_of(function)
        panels = {**said.panels, **fields.pop("panels", {})}
        described = Command(function, panels=panels, **fields)
        parameters = described.parameters
        function.__dict__["command"] = described
        function.__doc__ = python_documentation(said, parameters, panels)
        function.__dict__["__signature__"] = python_signature(function, parameters)
        return function

    return decorate


def options_given(
    function: Callable[..., Any], arguments: Mapping[str, Any], panel: str | None = None
) -> list[str]:
    """Return the options of a command that were given: their arguments are not the defaults.

    Parameters
    ----------
    function : callable
        The command.
    arguments : mapping
        Arguments by name, as ``locals()`` has them at the beginning of the function.
    panel : str, optional
        Title of a box of the help: its parameters alone are looked at.
    """
    described: Command = function.__dict__["command"]
    options = [one for one in described.parameters if one.shell is not None]
    if panel is not None:
        options = [one for one in options if one.name in described.panels[panel]]
    return [one.name for one in options if _differs(arguments[one.name], one.default)]


def _differs(value: Any, default: Any) -> bool:
    """Return whether an argument says anything; nothing may come as None or an empty list."""
    if isinstance(value, Path):  # the command line makes one of a default, too
        return str(value) != str(default)
    if isinstance(value, bool | int | float | str | tuple | list):
        return value != default and value not in ((), [])
    return value is not None and value is not default


def shell_function(function: Callable[..., Any]) -> Callable[..., None]:
    """Return the function that Typer runs for a command."""
    described: Command = function.__dict__["command"]

    def run(**values: Any) -> None:
        _run(described, values)

    run.__name__ = function.__name__
    run.__doc__ = help_of(function)
    run.__dict__["__signature__"] = inspect.Signature(_shell_parameters(described))
    return run


def _shell_parameters(described: Command) -> list[inspect.Parameter]:
    """Return arguments, options that must be given, then all other options in their order."""
    flags = {name: flag(name, text) for name, text in described.shell_flags.items()}
    if described.quiet:
        flags["quiet"] = flag("quiet", QUIET_HELP)
    if described.as_json:
        flags["as_json"] = flag("json", JSON_HELP)
    taken = [
        (one.name, one.shell_type, one.shell, one.shell_default)
        for one in described.parameters
        if one.shell is not None
    ]
    taken += [(name, bool, declared, False) for name, declared in flags.items()]

    titles = {name: title for title, names in described.panels.items() for name in names}
    ranked: list[tuple[int, inspect.Parameter]] = []
    for name, parsed, declared, default in taken:
        declared.rich_help_panel = titles.get(name, declared.rich_help_panel)
        keyword = inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[parsed, declared],
        )
        rank = 2 if default is not inspect.Parameter.empty else 1
        ranked.append((0 if isinstance(declared, ArgumentInfo) else rank, keyword))
    return [keyword for _, keyword in sorted(ranked, key=itemgetter(0))]


def _run(described: Command, values: dict[str, Any]) -> None:
    """Call a command's function with the options of the command line, and print what it returns."""
    quiet = values.pop("quiet", False)
    as_json = values.pop("as_json", False)
    silent = quiet or as_json
    call = SimpleNamespace(**values, quiet=quiet, as_json=as_json)
    stopped = GOES_ON if described.resumes else STOPPED
    if described.resumes and values.get("restart"):
        stopped += ", without --restart"
    with plain_errors(quiet, stopped, _typed_names(described)), ExitStack() as stack:
        if described.lines_before is not None and not silent:
            print_lines(described.lines_before(call))
        if described.context is not None:
            stack.enter_context(described.context(call))
        if described.python_values is not None:
            values = {**values, **described.python_values(call)}
        returned = _call(described, values, silent)
        if as_json:
            say(json.dumps(_json_object(described, returned, call)))
        elif described.always_printed or not quiet:
            print_lines(described.lines(returned, call))
    if described.status is not None and (status := described.status(returned)):
        raise typer.Exit(status)


def _json_object(described: Command, returned: Any, call: Arguments) -> Any:
    """Return what --json prints."""
    if callable(described.as_json):
        return described.as_json(returned, call)
    return returned.as_json() if hasattr(returned, "as_json") else returned


def _typed_names(described: Command) -> dict[str, str]:
    """Return options by their names in Python."""
    typed_names = {}
    for parameter in described.parameters:
        option = parameter.shell
        if not isinstance(option, OptionInfo):
            continue
        long_names = [name for name in option.param_decls or () if name.startswith("--")]
        usual = "--" + parameter.name.replace("_", "-")
        typed_names[parameter.name] = long_names[0] if long_names else usual
    return typed_names


def _call(described: Command, values: Mapping[str, Any], silent: bool) -> Any:
    """Call the function; options that were not given keep the function's own defaults."""
    arguments = {}
    for name, value in values.items():
        if value is not None and value != [] and name not in described.shell_flags:
            arguments[name] = value
    with ExitStack() as stack:
        if described.compiles_kernels:
            # By another process, while this one reads the data: a first run waits for the compiler.
            from flgpr.kernels.ahead import compiled_beside

            stack.enter_context(compiled_beside())
        # An option of that name is the file of a vehicle's track.
        if any(one.name == "track" and one.shell is None for one in described.parameters):
            arguments["track"] = stack.enter_context(progress_bars(silent))
        return described.function(**arguments)


@contextmanager
def progress_bars(silent: bool) -> Iterator[Track]:
    """Show bars on the error stream, or nothing."""
    if silent:
        from flgpr.progress import silent as no_bars

        yield no_bars
        return
    from flgpr.commands.bars import Bars

    with Bars() as bars:
        yield bars


def print_lines(lines: Iterable[Any]) -> None:
    """Print text, "wrote PATH" for paths that were written, and what rich draws."""
    for line in lines:
        if isinstance(line, Path):
            if not is_unchanged(line):
                say(f"wrote {line}")
        elif isinstance(line, str):
            say(line, err=isinstance(line, ErrorStreamText), nl=not isinstance(line, RawText))
        else:
            from flgpr.commands.bars import PlainConsole

            PlainConsole().print(line)
