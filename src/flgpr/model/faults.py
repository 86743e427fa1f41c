"""What is wrong with a file of entries (scene, sensor, recipe, mapping), in words that help to mend it."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError


def describe_fault(fault: Any, schema: type[BaseModel], whole: str) -> str:
    """Tell one fault of pydantic in a line, such as ``targets.0.dept: no such entry; did you mean depth?``.

    ``whole`` is what to call the file where no single entry is at fault; it may be empty.
    """
    place = tuple(fault["loc"])
    where = ".".join(map(str, place)) or whole
    return f"{where}: {_rule(fault, schema, place)}" if where else _rule(fault, schema, place)


def first_fault(error: ValidationError, schema: type[BaseModel], whole: str = "") -> str:
    """Tell the first fault of a validation, unknown entries before missing ones; see :func:`describe_fault`."""
    return describe_fault(min(error.errors(), key=lambda one: one["type"] != "extra_forbidden"), schema, whole)


def _rule(fault: Any, schema: type[BaseModel], place: tuple[str | int, ...]) -> str:
    said = str(fault["msg"]).removeprefix("Value error, ")
    if fault["type"] == "missing":
        return "is missing"
    if fault["type"] == "extra_forbidden":
        known = sorted({name for model in _models_at(schema, place[:-1]) for name in model.model_fields})
        near = get_close_matches(str(place[-1]), known, 1)
        if near:
            return f"no such entry; did you mean {near[0]}?"
        return "no such entry" + (f"; there are {', '.join(known)}" if known else "")
    if isinstance(fault["input"], str | int | float) and "got " not in said:
        return f"{said[0].lower()}{said[1:]}, got {fault['input']!r}"
    return said


def _models_at(schema: type[BaseModel], place: tuple[str | int, ...]) -> list[type[BaseModel]]:
    """Models that may stand at a place, found by walking down the types of the entries."""
    here = [schema]
    for part in place:
        if isinstance(part, str):
            fields = [model.model_fields[part].annotation for model in here if part in model.model_fields]
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
