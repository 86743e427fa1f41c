"""Reading of TOML files (scene, sensor, body, recipe, mapping), and messages on their faults."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from flgpr.door import read_named
from flgpr.model.bounds import shown_number
from flgpr.model.printable import shortened
from flgpr.toml_text import parse_toml

# Names that pydantic inserts into a location where an entry may be of several types.
_TYPE_NAME = re.compile(r"float|str|Variable|constrained-\w+|tuple\[.*\]")
MOST_FAULTS = 20
"""Faults of a file that are told, at most."""
_LONGEST_MESSAGE = 4000  # characters of a message, which may hold the faults of a table within
SchemaT = TypeVar("SchemaT", bound=BaseModel)


def preset_names(folder: Traversable) -> list[str]:
    """Return the names of the TOML files in a folder of the package."""
    names = [entry.name for entry in folder.iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def load_preset(schema: type[SchemaT], kind: str, name: str | Path, folder: Traversable) -> SchemaT:
    """Load a preset or a TOML file; a fault is a ValueError that names the entry."""
    if str(name) in preset_names(folder):
        data = (folder / f"{name}.toml").read_bytes()
    elif Path(name).is_file():
        data = read_named(name)
    else:
        raise ValueError(no_preset(kind, name, preset_names(folder)))
    return parse_entries(schema, data, f"{kind} {name}", kind)


def parse_entries(
    schema: type[SchemaT], data: str | bytes, what: str, file_name: str = ""
) -> SchemaT:
    """Read TOML, which errors call ``what``; see :func:`describe_fault` for ``file_name``."""
    try:
        tables = parse_toml(data)
    except ValueError as error:
        raise ValueError(f"{what}: not valid TOML: {error}") from None
    try:
        return schema.model_validate(tables)
    except ValidationError as error:
        raise ValueError(f"{what}: {first_fault(error, schema, file_name)}") from None


@contextmanager
def first_fault_of(schema: type[BaseModel], file_name: str = "") -> Iterator[None]:
    """Turn the faults of a validation into a ValueError of the first, see :func:`first_fault`."""
    try:
        yield
    except ValidationError as error:
        raise ValueError(first_fault(error, schema, file_name)) from None


@contextmanager
def faults_of(path: str | Path) -> Iterator[None]:
    """Turn an error about the content of a file into a ValueError that names the file."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
    except RecursionError:
        raise ValueError(f"{path}: its entries are nested too deeply to be read") from None


def listed_faults(error: ValidationError, describe: Callable[[Any], str]) -> list[str]:
    """Return the faults of a validation in words: the first ones, and how many more there are.

    A file may hold any number of faults, and to describe one takes a look at the whole file.

    Parameters
    ----------
    error : ValidationError
        The validation.
    describe : callable
        Returns a fault in words, see :func:`describe_fault`.

    Returns
    -------
    list of str
        At most :data:`MOST_FAULTS` faults, and a last text that counts the others.
    """
    faults = error.errors()
    lines = [describe(fault) for fault in faults[:MOST_FAULTS]]
    more = len(faults) - len(lines)
    return [*lines, f"and {more} more faults"] if more else lines


def describe_fault(fault: Any, schema: type[BaseModel], file_name: str) -> str:
    """Return a fault in a line, ``targets.0.dept: no such entry; did you mean depth?``.

    A fault of no entry is one of the whole file, called ``file_name``.
    """
    path = tuple(step for step in fault["loc"] if not _TYPE_NAME.fullmatch(str(step)))
    where = ".".join(shortened(str(step)) for step in path) or file_name
    rule = _rule(fault, schema, path)
    return f"{where}: {rule}" if where else rule


def first_fault(error: ValidationError, schema: type[BaseModel], file_name: str = "") -> str:
    """Return the first fault of a validation, unknown entries first; see :func:`describe_fault`."""
    faults = error.errors()
    unknown = [fault for fault in faults if fault["type"] == "extra_forbidden"]
    return describe_fault((unknown or faults)[0], schema, file_name)


def _rule(fault: Any, schema: type[BaseModel], path: tuple[str | int, ...]) -> str:
    """Return the rule that an entry breaks, with what might have been meant."""
    message = str(fault["msg"]).removeprefix("Value error, ")
    if fault["type"] == "missing":
        return "is missing"
    if fault["type"] == "extra_forbidden":
        names: set[str] = set()
        for model in _models_at(schema, path[:-1]):
            names |= set(model.model_fields)
        known = sorted(names)
        close = get_close_matches(str(path[-1]), known, 1)
        if close:
            return f"no such entry; did you mean {close[0]}?"
        return "no such entry" + (f"; there are {', '.join(known)}" if known else "")
    if isinstance(fault["input"], str | int | float) and "got " not in message:
        value = fault["input"]
        shown = repr(shortened(value)) if isinstance(value, str) else shown_number(value)
        return f"{message[0].lower()}{message[1:]}, got {shown}"
    return shortened(message, _LONGEST_MESSAGE)


def _models_at(schema: type[BaseModel], path: tuple[str | int, ...]) -> list[type[BaseModel]]:
    """Return the models that an entry may be of, from the types of the entries on the way to it."""
    models = [schema]
    for name in path:
        if isinstance(name, str):
            inner: list[type[BaseModel]] = []
            for model in models:
                if name in model.model_fields:
                    inner += _models_in(model.model_fields[name].annotation)
            models = inner
    return models


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Iterate over the models in a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_in(inner)


def no_preset(kind: str, name: str | Path, presets: list[str]) -> str:
    """Return the message that a name is neither a preset nor an existing file."""
    if Path(name).suffix or len(Path(name).parts) > 1:
        return f"{kind} file not found: {name}"
    message = f"{kind} must be a TOML file or one of {', '.join(presets)}, got {str(name)!r}"
    close = get_close_matches(str(name), presets, 1)
    if close:
        message += f"; did you mean {close[0]}?"
    return message
