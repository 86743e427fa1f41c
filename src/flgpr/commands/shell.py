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
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args

import typer
from typer import Option
from typer.models import ArgumentInfo, OptionInfo

from flgpr.commands.messages import GOES_ON, STOPPED, is_unchanged, plain_errors, say
from flgpr.commands.signatures import (
    Parameter,
    help_of,
    parameters_of,
    python_documentation,
    python_signature,
)

if TYPE_CHECKING:
    from flgpr.progress import Track

F = TypeVar("F", bound=Callable[..., Any])

QUIET = Annotated[bool, Option("--quiet", help="Print nothing but errors.")]
JSON = Annotated[bool, Option("--json", help="Print one JSON object instead of text.")]
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
    as_json: Callable[[Any, Arguments], Any] | None = None  #: object that --json prints
    #: lines that are printed before the work begins
    lines_before: Callable[[Arguments], Iterable[str]] | None = None
    #: checks options, and returns what the command line passes for parameters of Python alone
    python_values: Callable[[Arguments], Mapping[str, Any]] | None = None
    status: Callable[[Any], int] | None = None  #: exit status for what was returned
    #: context of call and output, such as a page that stays open
    context: Callable[[Arguments], AbstractContextManager[Any]] | None = None
    #: options of the command line alone, by name: annotation and default
    shell_options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    #: names of parameters by the title of the box in which the help shows them
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
        described = Command(function, **fields)
        parameters = described.parameters
        function.__dict__["command"] = described
        function.__doc__ = python_documentation(
            function.__doc__ or "", parameters, described.panels
        )
        function.__dict__["__signature__"] = python_signature(function, parameters)
        return function

    return decorate


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
    of_shell = dict(described.shell_options)
    if described.quiet:
        of_shell["quiet"] = (QUIET, False)
    if described.as_json is not None:
        of_shell["as_json"] = (JSON, False)
    taken = []
    for parameter in described.parameters:
        if parameter.shell is not None:
            parsed = parameter.shell_type
            taken.append((parameter.name, parsed, parameter.shell, parameter.shell_default))
    for name, (annotation, default) in of_shell.items():
        taken.append((name, *get_args(annotation), default))

    titles = {name: title for title, names in described.panels.items() for name in names}
    arguments = []
    required = []
    options = []
    for name, parsed, declared, default in taken:
        shell = copy(declared)  # several commands may have the same option
        shell.rich_help_panel = titles.get(name, shell.rich_help_panel)
        kind = inspect.Parameter.KEYWORD_ONLY
        keyword = inspect.Parameter(
            name, kind, default=default, annotation=Annotated[parsed, shell]
        )
        if isinstance(shell, ArgumentInfo):
            arguments.append(keyword)
        elif default is inspect.Parameter.empty:
            required.append(keyword)
        else:
            options.append(keyword)
    return [*arguments, *required, *options]


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
        if as_json and described.as_json is not None:
            say(json.dumps(described.as_json(returned, call)))
        elif described.always_printed or not quiet:
            print_lines(described.lines(returned, call))
    if described.status is not None and (status := described.status(returned)):
        raise typer.Exit(status)


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
        if value is not None and value != [] and name not in described.shell_options:
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
            from flgpr.commands.console import PlainConsole

            PlainConsole().print(line)
