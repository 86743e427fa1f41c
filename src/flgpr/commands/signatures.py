"""The one signature of a command, as Python and as the command line see it."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ForwardRef, Literal, Union, get_args, get_origin

from typer import Argument, Option
from typer.models import ArgumentInfo, OptionInfo

from flgpr.commands.options import SharedOption, ShellDefault, ShellType

_EMPTY = inspect.Parameter.empty
_SEQUENCES = (Sequence, list)
_LINE = 94  # characters
_SECTIONS = ("Returns", "Raises", "Notes")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command's function, with what its annotation says."""

    name: str
    type: Any
    default: Any
    kind: Any  #: as of ``inspect.Parameter``
    #: how the command line takes it; None where it does not
    shell: ArgumentInfo | OptionInfo | None
    help: str  #: one sentence
    shell_type: Any  #: what the command line parses
    shell_default: Any  #: ``inspect.Parameter.empty`` where the command line must be given it


@dataclass(frozen=True)
class Documentation:
    """What the docstring of a command says."""

    summary: str  #: what stands before the first section
    rest: str  #: sections on what is returned and raised
    sentences: dict[str, str]  #: on each parameter, by its name
    #: names of parameters by the title of the box in which the help shows them
    panels: dict[str, list[str]]


def documentation_of(function: Callable[..., Any]) -> Documentation:
    """Take the docstring of a command apart.

    Besides "Parameters" it may have a section for every box of the help, with the parameters that
    the box holds.
    """
    summary, *sections = re.split(
        r"^(\S.*)\n-+(?:\n|\Z)", inspect.cleandoc(function.__doc__ or ""), flags=re.MULTILINE
    )
    rest = ""
    sentences = {}
    panels = {}
    for title, content in zip(sections[::2], sections[1::2], strict=True):
        if title in _SECTIONS:
            rest += f"{title}\n{'-' * len(title)}\n{content}"
            continue
        names = []
        for entry in re.split(r"\n(?=\S)", content.strip()):
            name, _, sentence = entry.partition("\n")
            names.append(name)
            if sentence:
                sentences[name] = " ".join(sentence.split())
        if title != "Parameters":
            panels[title] = names
    return Documentation(summary.strip(), rest.strip(), sentences, panels)


def parameters_of(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a function, in the order of its signature.

    What one is for is said in the docstring, or by a text in its annotation.
    """
    parameters = inspect.signature(function).parameters
    # Without that of the returned value, which may name a class that is not loaded.
    bare = types.FunctionType(function.__code__, function.__globals__)
    bare.__annotations__ = {name: function.__annotations__[name] for name in parameters}
    annotations = inspect.get_annotations(bare, eval_str=True)
    sentences = documentation_of(function).sentences
    return [
        _parameter(one, annotations[name], sentences.get(name, ""))
        for name, one in parameters.items()
    ]


def _parameter(declared: inspect.Parameter, annotation: Any, sentence: str) -> Parameter:
    """Return a parameter with what the marks of its annotation state.

    Without a mark it is an argument of the command line, if it has no default, and else an option;
    parameters by keyword alone are those of Python.
    """
    is_annotated = hasattr(annotation, "__metadata__")
    python_type, *marks = get_args(annotation) if is_annotated else [annotation]
    shell = None
    parsed_type = shell_type(python_type)
    # An empty sequence is what Typer calls None.
    shell_default = None if declared.default == () else declared.default
    for mark in marks:
        if isinstance(mark, SharedOption):
            shell = mark.option(sentence)
        elif isinstance(mark, ArgumentInfo | OptionInfo):
            shell = copy(mark)  # several commands may have the same option
            shell.help = mark.help or sentence
        elif isinstance(mark, ShellDefault):
            shell_default = _EMPTY if mark.value is ... else mark.value
        elif isinstance(mark, ShellType):
            is_optional = type(None) in get_args(python_type)
            parsed_type = mark.type | None if is_optional else mark.type
        else:
            sentence = mark
    if shell is not None:
        sentence = shell.help or ""
    elif declared.kind is not declared.KEYWORD_ONLY:
        if declared.default is _EMPTY:
            shell = Argument(help=sentence)
        else:
            is_flag = python_type is bool and shell_default is False
            shell = flag(declared.name, sentence) if is_flag else Option(help=sentence)
    return Parameter(
        declared.name,
        python_type,
        declared.default,
        declared.kind,
        shell,
        sentence,
        parsed_type,
        shell_default,
    )


def flag(name: str, text: str) -> Any:
    """Return an option without a value, and without one that takes it back."""
    return Option("--" + name.replace("_", "-"), help=text)


def shell_type(annotation: Any) -> Any:
    """Return the type that the command line parses for the type of a parameter.

    Of a union the list is taken, else the path, else the first member; None stays possible.
    """
    origin = get_origin(annotation)
    members = get_args(annotation)
    if origin in _SEQUENCES:
        return list[shell_type(members[0])]  # type: ignore[misc]
    if origin not in (Union, types.UnionType):
        return annotation
    sequences = [member for member in members if get_origin(member) in _SEQUENCES]
    if sequences:
        chosen = shell_type(sequences[0])
    else:
        chosen = Path if Path in members else members[0]
    return chosen | None if type(None) in members else chosen


def python_signature(
    function: Callable[..., Any], parameters: Sequence[Parameter]
) -> inspect.Signature:
    """Return the signature of a function with plain types."""
    plain_parameters = []
    for parameter in parameters:
        plain_parameters.append(
            inspect.Parameter(
                parameter.name,
                parameter.kind,
                default=parameter.default,
                annotation=_TypeText(type_in_words(parameter.type)),
            )
        )
    returned = function.__annotations__.get("return", "None")
    return _ShortSignature(plain_parameters, return_annotation=_TypeText(str(returned)))


class _ShortSignature(inspect.Signature):
    """A signature that is shown without its types: with them it would fill a screen."""

    def __str__(self) -> str:
        shown = [one.replace(annotation=_EMPTY) for one in self.parameters.values()]
        return str(inspect.Signature(shown))

    def format(self, **_: Any) -> str:
        """Return the text as ``help`` of Python 3.13 asks for it, which has a line a parameter."""
        return str(self)


class _TypeText:
    """An annotation that is shown as a text without quotes."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def type_in_words(annotation: Any) -> str:
    """Return a type as it is written in source text."""
    if annotation is type(None):
        return "None"
    if annotation is ...:
        return "..."
    if isinstance(annotation, ForwardRef):
        return annotation.__forward_arg__
    origin = get_origin(annotation)
    members = get_args(annotation)
    if origin in (Union, types.UnionType):
        return " | ".join(type_in_words(member) for member in members)
    if origin is Literal:
        return " | ".join(repr(value) for value in members)
    if origin is not None and members:
        inner = ", ".join(type_in_words(member) for member in members)
        return f"{origin.__name__}[{inner}]"
    return str(getattr(annotation, "__name__", annotation))


def python_documentation(
    said: Documentation, parameters: Sequence[Parameter], panels: Mapping[str, Sequence[str]]
) -> str:
    """Return a docstring with a section of the parameters before what is returned and raised.

    It fits a screen: a parameter has a line, of a long help the first words; the boxes of the help
    of the command line but the first have a line each, by their titles.
    """
    known = [parameter.name for parameter in parameters]
    together = {}
    for title, names in list(panels.items())[1:]:
        together[title] = [name for name in names if name in known]
    apart = [name for names in together.values() for name in names]
    lines = ["Parameters", "----------"]
    for parameter in parameters:
        line = f"{parameter.name} : {parameter.help}"
        if len(line) > _LINE:
            line = re.split(r"(?<=\.) |; |: |, ", line.replace(" : ", "\0", 1))[0].replace(
                "\0", " : "
            )
        if parameter.name not in apart:
            lines.append(f"{line.rstrip('.')}.")
    for title, names in together.items():
        lines.append(f"{', '.join(names)} : {title}, see the command's --help.")
    return "\n\n".join([said.summary, "\n".join(lines), said.rest]).strip()


def help_of(function: Callable[..., Any]) -> str:
    """Return the part of a command's docstring that the command line shows.

    A paragraph is a single line: the terminal wraps it.
    """
    paragraphs = documentation_of(function).summary.split("\n\n")
    return "\n\n".join(paragraph.replace("\n", " ") for paragraph in paragraphs)
