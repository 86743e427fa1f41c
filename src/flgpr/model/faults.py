"""Files of entries (scene, sensor, body, recipe, mapping): read, and what is wrong with one in words that help."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from flgpr.door import parse_toml, read_named

_BRANCHES = (
    "float",
    "str",
    "Variable",
)  # what pydantic calls the kinds of an entry that may be of several
Entries = TypeVar("Entries", bound=BaseModel)


def preset_names(folder: Traversable) -> list[str]:
    """Names of the TOML files in a folder of the package."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    )


def load_preset(schema: type[Entries], kind: str, name: str | Path, folder: Traversable) -> Entries:
    """Load a preset of the package, or a TOML file; a fault is a ValueError that names the entry."""
    if str(name) in preset_names(folder):
        data = (folder / f"{name}.toml").read_bytes()
    elif Path(name).is_file():
        data = read_named(name)
    else:
        raise ValueError(no_preset(kind, name, preset_names(folder)))
    return parse_entries(schema, data, f"{kind} {name}", kind)


def parse_entries(schema: type[Entries], data: str | bytes, what: str, whole: str = "") -> Entries:
    """Read TOML that is ``what``; see :func:`describe_fault` for ``whole``."""
    try:
        tables = parse_toml(data)
    except ValueError as error:
        raise ValueError(f"{what}: not valid TOML: {error}") from None
    try:
        return schema.model_validate(tables)
    except ValidationError as error:
        raise ValueError(f"{what}: {first_fault(error, schema, whole)}") from None


def describe_fault(fault: Any, schema: type[BaseModel], whole: str) -> str:
    """Tell one fault in a line, ``targets.0.dept: no such entry; did you mean depth?``, or of the ``whole`` file."""
    place = tuple(part for part in fault["loc"] if part not in _BRANCHES)
    where = ".".join(map(str, place)) or whole
    return f"{where}: {_rule(fault, schema, place)}" if where else _rule(fault, schema, place)


def first_fault(error: ValidationError, schema: type[BaseModel], whole: str = "") -> str:
    """Tell the first fault of a validation, unknown entries before missing ones; see :func:`describe_fault`."""
    return describe_fault(
        min(error.errors(), key=lambda one: one["type"] != "extra_forbidden"), schema, whole
    )


def _rule(fault: Any, schema: type[BaseModel], path: tuple[str | int, ...]) -> str:
    said = str(fault["msg"]).removeprefix("Value error, ")
    if fault["type"] == "missing":
        return "is missing"
    if fault["type"] == "extra_forbidden":
        known = sorted(
            {name for model in _models_at(schema, path[:-1]) for name in model.model_fields}
        )
        near = get_close_matches(str(path[-1]), known, 1)
        if near:
            return f"no such entry; did you mean {near[0]}?"
        return "no such entry" + (f"; there are {', '.join(known)}" if known else "")
    if isinstance(fault["input"], str | int | float) and "got " not in said:
        return f"{said[0].lower()}{said[1:]}, got {fault['input']!r}"
    return said


def _models_at(schema: type[BaseModel], path: tuple[str | int, ...]) -> list[type[BaseModel]]:
    """Models that may stand at a place, found by walking down the types of the entries."""
    here = [schema]
    for part in path:
        if isinstance(part, str):
            fields = [
                model.model_fields[part].annotation for model in here if part in model.model_fields
            ]
            here = [model for field in fields for model in _models_in(field)]
    return here


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_in(inner)


def no_preset(kind: str, name: str | Path, presets: list[str]) -> str:
    """Say that a name is neither a preset nor a file that is there."""
    if Path(name).suffix or len(Path(name).parts) > 1:
        return f"{kind} file not found: {name}"
    near = get_close_matches(str(name), presets, 1)
    return (
        f"{kind} must be a TOML file or one of {', '.join(presets)}, got {str(name)!r}"
        + (f"; did you mean {near[0]}?" if near else "")
    )  # fmt: skip
