"""The command line as a table: commands, what they take, what they print as JSON, and how they end."""

import json
import os
import typing
from enum import Enum
from pathlib import Path

import typer.main
from typer.testing import CliRunner

from flgpr.commands.app import app
from freeze.frozen import DATA

TABLE = DATA / "commands.json"
VALUES = ("format", "version")


def walk(command=None, words=()):
    """Yield the words and the command of every command, groups included."""
    command = command or typer.main.get_command(app)
    yield list(words), command
    for name, inner in sorted(getattr(command, "commands", {}).items()):
        yield from walk(inner, (*words, name))


def parameters(command) -> dict[str, dict]:
    """Describe arguments, by their place, and options, by their names."""
    described = {}
    place = 0
    for one in command.params:
        entry = {
            "type": _kind(one),
            "default": _plain(one.default),
            "required": one.required,
            "values": one.nargs,
            "repeats": bool(getattr(one, "multiple", False)),
        }
        if one.param_type_name == "argument":
            place += 1
            described[f"argument {place}: {one.name}"] = entry
        else:
            entry["flag"] = one.is_flag
            described[" / ".join([*one.opts, *one.secondary_opts])] = entry
    return described


def _kind(parameter) -> str:
    """Name the type of a parameter's values, its choices or its limits."""
    kind = parameter.type_descriptor.annotation
    if typing.get_origin(kind) is list:
        kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) is tuple:
        return f"({', '.join(one.__name__ for one in typing.get_args(kind))})"
    if issubclass(kind, Enum):
        return f"one of {', '.join(str(one.value) for one in kind)}"
    if (parameter.min, parameter.max) == (None, None):
        return kind.__name__
    return f"{kind.__name__} from {parameter.min} to {parameter.max}"


def _plain(value):
    if callable(value):
        return "computed"
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


def run(words, folder: Path, typed: str = ""):
    """Run a command in a folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        return CliRunner().invoke(app, [str(word) for word in words], input=typed)
    finally:
        os.chdir(before)


def with_missing_files(command) -> list[str]:
    """Return a value for all that a command must be given: files that do not exist."""
    words = []
    for one in command.params:
        if not one.required:
            continue
        values = (
            ["1"] * one.nargs if _kind(one).startswith("float") or one.nargs > 1 else ["missing"]
        )
        words += values if one.param_type_name == "argument" else [one.opts[0], *values]
    return words


def exit_codes(words, command, folder: Path) -> dict[str, int]:
    """Return how a command ends that is asked for help or given too little, a strange option or missing files."""
    codes = {"--help": run([*words, "--help"], folder).exit_code}
    codes["--nothing"] = run([*words, "--nothing"], folder).exit_code
    if any(one.required for one in command.params):
        codes["no argument"] = run(words, folder).exit_code
        codes["missing files"] = run([*words, *with_missing_files(command)], folder).exit_code
    return codes


def json_shape(value, folder: Path):
    """Return the structure of a JSON value: keys and types of values, those of a list's entries as one.

    What stands under ``format`` and ``version`` is kept as it is.
    """
    if isinstance(value, dict):
        shape = {}
        for key, one in value.items():
            plain = one if key in VALUES else json_shape(one, folder)
            shape[key.replace(str(folder), "FOLDER")] = plain
        return shape
    if isinstance(value, list):
        shapes = [json_shape(one, folder) for one in value]
        return [_merged(shapes)] if shapes else []
    names = {bool: "boolean", int: "number", float: "number", str: "text", type(None): "null"}
    return names[type(value)]


def _merged(shapes):
    """Merge structures into one that says what each of them may be."""
    if all(isinstance(one, dict) for one in shapes):
        keys = sorted({key for one in shapes for key in one})
        merged = {}
        for key in keys:
            held = [one[key] for one in shapes if key in one]
            name = key if len(held) == len(shapes) else f"{key} (not always)"
            merged[name] = _merged(held)
        return merged
    if all(isinstance(one, list) for one in shapes):
        inner = [entry for one in shapes for entry in one]
        return [_merged(inner)] if inner else []
    distinct = sorted({json.dumps(one, sort_keys=True) for one in shapes})
    if len(distinct) == 1:
        return shapes[0]
    return " or ".join(text.strip('"') for text in distinct)
