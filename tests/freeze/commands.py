"""The command line as a table: what commands take, what they print as JSON, and how they end."""

import json
import os
import re
import typing
from enum import Enum
from pathlib import Path

import typer.main
from typer.testing import CliRunner

import every_command
import io_gpr
from flgpr.commands.app import app
from flgpr.store import verdict_bytes
from freeze.frozen import DATA, json_shape

TABLE = DATA / "commands.json"
KEYS = DATA / "printed.json"


def walk(command=None, words=()):
    """Yield the words and the command of every command, groups included."""
    command = command or typer.main.get_command(app)
    yield list(words), command
    for name, inner in sorted(getattr(command, "commands", {}).items()):
        yield from walk(inner, (*words, name))


def parameters(command) -> dict[str, str]:
    """Describe arguments, by their place, and options, by their names."""
    described = {}
    place = 0
    for one in command.params:
        if one.param_type_name == "argument":
            place += 1
            name = f"argument {place}: {one.name}"
        else:
            name = " / ".join([*one.opts, *one.secondary_opts])
        described[name] = _parameter(one)
    return described


def _parameter(one) -> str:
    """Describe a parameter: type, default, and what is unusual about it."""
    words = [_kind(one), "required" if one.required else f"default {_plain(one.default)}"]
    if getattr(one, "is_flag", False):
        words[0] = "flag"
    if one.nargs == -1 or getattr(one, "multiple", False):
        words.append("any number")
    elif one.nargs > 1:
        words.append(f"{one.nargs} values")
    return ", ".join(words)


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


def _plain(value) -> str:
    if callable(value):
        return "computed"
    if isinstance(value, tuple | list):
        return ", ".join(_plain(one) for one in value)
    return str(value)


def run(words, folder: Path, typed: str = ""):
    """Run a command in a folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        return CliRunner().invoke(app, [str(word) for word in words], input=typed)
    finally:
        os.chdir(before)


MAKES = (["trial", "new"],)
"""Commands that read no file, and make what they are given."""


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
    """Return how a command ends that is asked for help, or given too little, or missing files."""
    codes = {"--help": run([*words, "--help"], folder).exit_code}
    codes["--nothing"] = run([*words, "--nothing"], folder).exit_code
    if any(one.required for one in command.params):
        codes["no argument"] = run(words, folder).exit_code
        if words not in MAKES:
            codes["missing files"] = run([*words, *with_missing_files(command)], folder).exit_code
    return codes


def command_table(folder: Path) -> dict[str, dict]:
    """Describe every command: what it takes, and how it ends where it is given too little."""
    table = {}
    for words, command in walk():
        table[" ".join(["flgpr", *words])] = {
            "parameters": parameters(command),
            "exit codes": exit_codes(words, command, folder),
        }
    return table


SHORT = {
    "AREA": "--area -1.5 1.8 5.5 8.5 --spacing 0.15",
    "BODY": "--body pmn --depth 0.05 --site prepared-sand --rms 0.003 --band 0.75e9 1.35e9",
    "BOOK": "--book OUT/book.jsonl",
    "CLOCK": "--offsets 3.2 3.6 --step 0.1",
    "LANE": "--lane IN/lane.toml",
    "RECIPE": "--recipe IN/small.toml",
    "REFLECTORS": "--reflectors IN/reflectors.csv",
    "TRUTH": "--truth IN/truth.csv",
    "WITNESS": "--witness OUT/witness.jsonl",
}
PRINTED = {
    "anchor": [
        "anchor IN/points.csv --crs EPSG:4326 --accuracy 0.02 --write OUT/a.toml LANE",
    ],
    "benchmark validate": ["benchmark validate IN/submission --ground IN/ground.toml"],
    "calibrate clock": ["calibrate clock IN/rail.zarr AREA CLOCK"],
    "calibrate joint": ["calibrate joint IN/rail.zarr REFLECTORS CLOCK --biases -0.5 1"],
    "calibrate permittivity": [
        "import gpr IN/long.dt1 -o OUT/a.zarr --time-zero 4 --band 1.25e8 1e9 --separation 0.2",
        "prepare OUT/a.zarr -o OUT/b.zarr --background",
        "calibrate permittivity OUT/b.zarr",
    ],
    "calibrate poses": ["calibrate poses IN/ahead.zarr"],
    "calibrate range-bias": ["calibrate range-bias IN/posed.zarr REFLECTORS"],
    "demo": ["demo -o OUT/demo"],
    "design": ["design sri-array --signal-to-clutter BODY"],
    "detect": ["detect IN/lane.zarr RECIPE LANE -o OUT/result"],
    "detect in sections": ["detect IN/lane.zarr RECIPE LANE --section 4 -o OUT/result"],
    "detect a survey": ["detect IN/lane.zarr IN/other-lane.zarr RECIPE LANE LANE -o OUT/all"],
    "image": ["image IN/run.zarr --spacing 0.2 -o OUT/a.png"],
    "image depth": ["image IN/line.zarr --permittivity 9 --x -0.2 0.2 --depth 0.2 -o OUT/a.npz"],
    "image recording": ["image IN/line.dt1 --gain -o OUT/a.npz"],
    "check": ["check IN/run.zarr"],
    "open": ["open IN/mapped.npz -o OUT/a.toml"],
    "recipe suggest": ["recipe suggest IN/run.zarr"],
    "info": ["info IN/run.zarr"],
    "info recipes": ["info IN/run.zarr --recipes"],
    "info file": ["info IN/lane_a.npz"],
    "info files": ["info IN/mapped.npz IN/track.csv"],
    "info model": [
        "train IN/lane.zarr TRUTH LANE RECIPE --feature C_HH_F1 -o OUT/model",
        "info OUT/model",
    ],
    "plan check": [
        "plan lane IN/lane.toml IN/sorts.csv --seed 3 --spacing 0.5 --edge 0.1 --halo 0.3 BOOK "
        "-o OUT/plan.csv",
        "plan register IN/small.toml BOOK WITNESS",
        "score IN/alarms.csv --truth OUT/plan.csv LANE --halo 0.3 RECIPE BOOK -o OUT/score",
        "plan check OUT/book.jsonl --report OUT/score/roc.json WITNESS",
    ],
    "replay": ["replay IN/result"],
    "trial intake": [
        "trial new OUT/trial LANE",
        "trial intake OUT/trial ACME IN/alarms.csv",
    ],
    "trial verdict": [
        "trial new OUT/trial LANE",
        "trial intake OUT/trial ACME IN/alarms.csv --signed Director",
        "trial intake OUT/trial Globex IN/others.csv --signed Director",
        "seal IN/truth.csv LANE --book OUT/trial/register.jsonl -o OUT/trial/truth.sealed",
        "trial verdict OUT/trial",
    ],
    "agree": ["agree IN/first.json IN/second.json"],
    "compare": ["compare IN/alarms.csv IN/others.csv TRUTH LANE -o OUT/score"],
    "score": ["score IN/result TRUTH -o OUT/score"],
    "score a list": ["score IN/alarms.csv TRUTH LANE -o OUT/score"],
    "score agreement": ["score --agreement IN/first.json IN/second.json"],
    "score sealed": ["score IN/alarms.csv --sealed IN/sealed -o OUT/score"],
    "score side by side": ["score IN/alarms.csv IN/others.csv TRUTH LANE -o OUT/score"],
}
"""Commands to give, the last of each with ``--json``; all commands that have it are among them.

``IN`` stands for the folder of inputs, ``OUT`` for that of outputs, and other capitals for what is
in ``SHORT``.
"""


def make_inputs(folder: Path) -> None:
    """Make what ``PRINTED`` reads: inputs of all commands, a longer recording, and verdicts."""
    every_command.make_inputs(folder)
    io_gpr.write_dt1(folder / "long.dt1", io_gpr.section(60))
    for name, verdicts in (("first", ("mine", "clutter")), ("second", ("mine", "mine"))):
        notes = [
            {"result": "lane", "detection": "main", "alarm_id": f"alarm-{k}", "verdict": verdict}
            for k, verdict in enumerate(verdicts)
        ]
        (folder / f"{name}.json").write_bytes(verdict_bytes(notes))


def printed(name: str, inputs: Path, output: Path):
    """Return the structure of what the last command of a case prints with ``--json``."""
    *before, last = PRINTED[name]
    told = ""
    for text in [*before, f"{last} --json"]:
        words = _words(text, inputs, output)
        done = CliRunner().invoke(app, words, input=2 * f"{every_command.PHRASE}\n")
        assert done.exit_code == 0, (words, done.output, done.exception)
        told = done.stdout
    # What is asked for, as a passphrase is, ends in a line of its own.
    return json_shape(json.loads(told.strip().splitlines()[-1]), output.parent)


def _words(text: str, inputs: Path, output: Path) -> list[str]:
    """Split a command of ``PRINTED`` into words with all that they stand for."""
    spelled = []
    for word in text.split():
        spelled += SHORT.get(word, word).split()
    folders = {"IN/": f"{inputs}/", "OUT/": f"{output}/"}
    for short, folder in folders.items():
        spelled = [re.sub(f"^{short}", folder, word) for word in spelled]
    return spelled
