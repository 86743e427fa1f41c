"""The one signature of a command, as Python and as the command line see it."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ForwardRef, Literal, Union, get_args, get_origin

from typer.models import ArgumentInfo, OptionInfo

from flgpr.commands.options import ShellDefault, ShellType

_Kind = inspect.Parameter
_SECTION = re.compile(r"^(Returns|Raises|Notes)\n-+$", re.MULTILINE)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command's function, with what its annotation says."""

    name: str
    type: Any
    default: Any
    shell: (
        ArgumentInfo | OptionInfo | None
    )  #: how the command line takes it; None where it does not
    help: str  #: one sentence
    shell_type: Any  #: what the command line parses
    shell_default: Any  #: ``inspect.Parameter.empty`` where the command line must be given it


def parameters_of(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a function, in the order of its signature."""
    code = function.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    defaults = dict(function.__kwdefaults__ or {})
    positional = names[: code.co_argcount]
    values = function.__defaults__ or ()
    defaults |= dict(zip(positional[len(positional) - len(values) :], values, strict=True))
    annotations = _annotations_of(function, names)
    return [_parameter(name, annotations[name], defaults) for name in names]


def _annotations_of(function: Callable[..., Any], names: Sequence[str]) -> dict[str, Any]:
    """Evaluate the annotations of parameters; that of what is returned may name what is not loaded."""
    alike = types.FunctionType(function.__code__, function.__globals__)
    alike.__annotations__ = {name: function.__annotations__[name] for name in names}
    return inspect.get_annotations(alike, eval_str=True)


def _parameter(name: str, annotation: Any, defaults: Mapping[str, Any]) -> Parameter:
    is_annotated = hasattr(annotation, "__metadata__")
    plain, *marks = get_args(annotation) if is_annotated else [annotation]
    default = defaults.get(name, inspect.Parameter.empty)
    shell = None
    text = ""
    parsed = shell_type(plain)
    # What a sequence holds by default, nothing, is what Typer calls None.
    shell_default = None if default == () else default
    for mark in marks:
        if isinstance(mark, ArgumentInfo | OptionInfo):
            shell = mark
            text = mark.help or ""
        elif isinstance(mark, ShellDefault):
            shell_default = inspect.Parameter.empty if mark.value is ... else mark.value
        elif isinstance(mark, ShellType):
            parsed = mark.type | None if type(None) in get_args(plain) else mark.type
        else:
            text = mark
    return Parameter(name, plain, default, shell, text, parsed, shell_default)


def shell_type(annotation: Any) -> Any:
    """Return the type that the command line parses for the type of a parameter.

    Of a union the list is taken, else the path, else the first member; None stays possible.
    """
    origin = get_origin(annotation)
    if origin in (Union, types.UnionType):
        members = [one for one in get_args(annotation) if one is not type(None)]
        chosen = _member_of_shell(members)
        return chosen | None if len(members) < len(get_args(annotation)) else chosen
    if origin in (Sequence, list):
        return list[shell_type(get_args(annotation)[0])]  # type: ignore[misc]
    return annotation


def _member_of_shell(members: Sequence[Any]) -> Any:
    for one in members:
        origin = get_origin(one)
        if isinstance(origin, type) and issubclass(origin, Sequence) and origin is not tuple:
            return list[shell_type(get_args(one)[0])]  # type: ignore[misc]
    return Path if Path in members else members[0]


def python_signature(
    function: Callable[..., Any], parameters: Sequence[Parameter]
) -> inspect.Signature:
    """Return the signature of a function with plain types."""
    code = function.__code__
    made = []
    for number, one in enumerate(parameters):
        positional = number < code.co_argcount
        kind = _Kind.POSITIONAL_OR_KEYWORD if positional else _Kind.KEYWORD_ONLY
        annotation = _Shown(type_in_words(one.type))
        made.append(inspect.Parameter(one.name, kind, default=one.default, annotation=annotation))
    returned = function.__annotations__.get("return", "None")
    return inspect.Signature(made, return_annotation=_Shown(str(returned)))


class _Shown:
    """An annotation that is shown as a text without quotes."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def type_in_words(annotation: Any) -> str:
    """Write a type as it stands in source text."""
    if annotation is type(None):
        return "None"
    if isinstance(annotation, ForwardRef):
        return annotation.__forward_arg__
    origin = get_origin(annotation)
    members = get_args(annotation)
    if origin in (Union, types.UnionType):
        return " | ".join(type_in_words(one) for one in members)
    if origin is Literal:
        return " | ".join(repr(one) for one in members)
    if origin is not None and members:
        inner = ", ".join("..." if one is ... else type_in_words(one) for one in members)
        return f"{origin.__name__}[{inner}]"
    return str(getattr(annotation, "__name__", annotation))


def python_documentation(text: str, parameters: Sequence[Parameter]) -> str:
    """Return a docstring with a section of the parameters before what is returned and raised."""
    text = inspect.cleandoc(text)
    head, rest = _split(text)
    lines = ["Parameters", "----------"]
    for one in parameters:
        optional = "" if one.default is inspect.Parameter.empty else ", optional"
        lines += [f"{one.name} : {type_in_words(one.type)}{optional}", f"    {one.help}"]
    return "\n\n".join([one for one in (head, "\n".join(lines), rest) if one])


def help_of(function: Callable[..., Any]) -> str:
    """Return the part of a command's docstring that the command line shows."""
    return re.split(r"^Parameters\n-+$", function.__doc__ or "", flags=re.MULTILINE)[0].strip()


def _split(text: str) -> tuple[str, str]:
    """Split a docstring before the section of what is returned or raised."""
    found = _SECTION.search(text)
    if found is None:
        return text.strip(), ""
    return text[: found.start()].strip(), text[found.start() :].strip()
