"""One call of every command as a table: which files it writes, how it ends and what it says."""

import fnmatch
import json
import re
import tomllib
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import uvicorn

import every_command
from every_command import Command
from freeze import commands, formats
from freeze.frozen import DATA, json_digest, json_shape, merged, read_json
from freeze.recipes import flgpr

TABLE = DATA / "calls.json"
BEFORE = [
    "import gpr {in}/long.dt1 -o {in}/long.zarr --time-zero 4 --band 1.25e8 1e9 --separation 0.2",
    "prepare {in}/long.zarr -o {in}/prepared.zarr --background",
    "plan lane {in}/lane.toml {in}/sorts.csv -o {in}/sealed-plan.csv --seed 3 --spacing 0.5 "
    "--edge 0.1 --halo 0.3 --book {in}/book.jsonl",
    "plan register {in}/small.toml --book {in}/book.jsonl --witness {in}/witness.jsonl",
    "score {in}/alarms.csv --truth {in}/sealed-plan.csv --lane {in}/lane.toml --halo 0.3 "
    "--recipe {in}/small.toml --book {in}/book.jsonl -o {in}/book-score",
]
"""Commands that make what commands of ``ONLY_TOLD`` read."""
ONLY_TOLD = [
    Command("agree", "agree {in}/first.json {in}/second.json"),
    Command("benchmark list", "benchmark list --ground {in}/ground.toml"),
    Command("benchmark validate", "benchmark validate {in}/submission --ground {in}/ground.toml"),
    Command("calibrate permittivity", "calibrate permittivity {in}/prepared.zarr"),
    Command(
        "plan check",
        "plan check {in}/book.jsonl --report {in}/book-score/roc.json --witness {in}/witness.jsonl",
    ),
    Command("plan mines", "plan mines"),
    Command("check", "check {in}/run.zarr"),
    Command("recipe check", "recipe check {in}/small.toml"),
    Command("recipe suggest", "recipe suggest {in}/run.zarr"),
    Command("recipe list", "recipe list"),
    Command("recipe show", "recipe show demo"),
    Command("replay", "replay {in}/result"),
    Command("view", "view {in}/result --no-browser"),
]
"""Commands that write nothing; ``every_command`` has those that write."""
CALLS = {one.name: one for one in [*every_command.COMMANDS, *ONLY_TOLD]}
_MASKS = (
    (r"https?://\S+", "URL"),
    (r"\d{4}-\d\d-\d\dT[\d:.]+(\+[\d:]+|Z)?", "TIME"),
    (r"\b[0-9a-f]{12,}\b(\.\.\.)?", "DIGEST"),
    (r"\d+(\.\d+)+(e[-+]?\d+)?", "NUMBER"),
    (r"(?<=\s\s)\d+(?=\s|$)", "NUMBER"),  # in a table: seconds and bytes, too
    (r"\d+ (s|ms|kB|MB|MiB|GiB|scans/s|GFLOP/s|GB/s)\b", r"NUMBER \1"),
    (r"\s+", " "),
)
"""What differs from machine to machine or from day to day, and what stands for it."""
_BAR = "━"


def make_inputs(folder: Path) -> None:
    """Make what the calls read."""
    commands.make_inputs(folder)
    for text in BEFORE:
        flgpr(*text.replace("{in}", str(folder)).split(), "--quiet")


def call(name: str, inputs: Path, output: Path, change=setattr) -> dict:
    """Give a command and describe its end, its files, and its first and last lines.

    ``change`` sets what lets a command that works for long do with numbers that cost nothing, see
    ``every_command.make_cheap``.
    """
    command = CALLS[name]
    command.inputs = inputs
    every_command.make_cheap(command, change)
    change(uvicorn.Server, "run", lambda *_, **__: None)  # the viewer ends at once
    command.start(output)
    done = command.run(output)
    return {
        "exit code": done.exit_code,
        "files": written_files(output, command.drawn, command.cache),
        "printed": ends(done.stdout, inputs, output),
        "told beside it": ends(done.stderr, inputs, output),
    }


def call_table(found: dict[str, dict]) -> dict[str, dict]:
    """Put structures of files into a table of their own, so that calls which write alike share them.

    In their place stands the name of the file with a digest of the structure.
    """
    calls = {}
    structures = {}
    for name, one in found.items():
        files = {}
        for path, structure in one["files"].items():
            files[path] = structure
            if not isinstance(structure, str):
                digest = json_digest(structure)[:8]
                files[path] = f"{Path(path.partition(', ')[0]).name} {digest}"
                structures[files[path]] = structure
        calls[name] = {**one, "files": files}
    return {"calls": calls, "structures": structures}


def frozen_call(name: str) -> dict:
    """Return what is frozen of a call, with the structures of its files."""
    table = read_json(TABLE)
    one = table["calls"][name]
    structures = table["structures"]
    return {**one, "files": {path: structures.get(of, of) for path, of in one["files"].items()}}


def ends(text: str, inputs: Path, output: Path) -> list[str]:
    """Return the first and the last line of a text, without bars of progress and with masks."""
    lines = [line.strip() for line in text.splitlines() if _BAR not in line]
    lines = [_masked(line, inputs, output) for line in lines if line]
    return lines if len(lines) < 2 else [lines[0], lines[-1]]


def _masked(line: str, inputs: Path, output: Path) -> str:
    if line.startswith("{"):
        return json.dumps(json_shape(json.loads(line), output))
    line = line.replace(str(inputs), "IN").replace(str(output), "OUT")
    for pattern, stands in _MASKS:
        line = re.sub(pattern, stands, line)
    return line


def written_files(folder: Path, drawn: tuple[str, ...], cache: tuple[str, ...]) -> dict:
    """Describe every file of a folder; those with a star in their name are one entry, counted.

    Chunks of a store have one name, as have files of ``drawn``, patterns of names with a random
    number or a digest in them. Of a cache only that it is there is told.
    """
    kinds = {}
    described = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        inside = path.relative_to(folder)
        kept = [pattern for pattern in cache if fnmatch.fnmatch(inside.as_posix(), pattern)]
        if kept:
            described[kept[0]] = "there"
            continue
        kinds.setdefault(_name(inside, drawn), []).append(describe(path))
    for name, found in kinds.items():
        key = f"{name}, {len(found)} of them" if "*" in name else name
        described[key] = merged(found)
    return described


def _name(path: Path, drawn: tuple[str, ...]) -> str:
    """Return a file's name, with a star for what differs between files of one kind."""
    name = path.as_posix()
    for pattern in drawn:
        if fnmatch.fnmatch(name, pattern):
            return (path.parent / Path(pattern).name).as_posix()
    name = re.sub("/c/[0-9/]+$", "/c/*", name)
    return re.sub("[0-9a-f]{12,}", "*", name)


def describe(path: Path):
    """Describe a file by what a program that reads it relies on, or by its kind alone."""
    readers = {
        ".f16": _kind, ".geojson": _json, ".gpx": _tags, ".kml": _tags, ".log": _kind,
        ".sigmf-meta": _json, ".toml": _toml, ".zip": _members,
    }  # fmt: skip
    if "c" in path.parts:
        return "chunk"  # its size depends on the last bits of what it holds
    return readers.get(path.suffix, formats.describe)(path)


def _kind(_: Path) -> str:
    return "file"


def _json(path: Path):
    return json_shape(json.loads(path.read_text()), path.parent)


def _toml(path: Path):
    """Return keys and types, or that it is no TOML yet, as with question marks to fill in."""
    try:
        return json_shape(tomllib.loads(path.read_text()), path.parent)
    except tomllib.TOMLDecodeError:
        return "no TOML yet"


def _tags(path: Path) -> list[str]:
    return sorted({one.tag.rpartition("}")[2] for one in ElementTree.parse(path).iter()})


def _members(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as archive:
        return sorted(archive.namelist())
