"""Small files of each of today's formats: how they are made and read, and what is in them."""

import csv
import json
import shutil
import tomllib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.commands.detect import detect
from flgpr.live.feeding import feed
from flgpr.model import make_run
from flgpr.results.result import read_result
from flgpr.results.sections import read_sections
from flgpr.store import (
    Bundle,
    RunWriter,
    decode_frame,
    open_run,
    read_description,
    read_verdicts,
    save_run,
    verdict_bytes,
    write_bundle,
)
from freeze.frozen import DATA, array_digest, digest, json_digest, json_shape
from freeze.recipes import flgpr
from small_lane import cut_down, small_recipe, small_run

FILES = DATA / "formats"
TABLE = DATA / "formats.json"
PHRASE = "gravel otter seven lamps"
QUANTUM = 2.0**-12
LANE = "x_min = -0.5\nx_max = 0.5\ny_min = 4.0\ny_max = 5.6\n"
TRAINING_LANE = "x_min = -1.0\nx_max = 1.0\ny_min = 3.0\ny_max = 8.0\n"
TRAINING_TRUTH = "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.05\n"
TRUTH = "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.05\nb,plastic,-0.4,5.2,0.1\n"
SCANS = 8
FIRST = 5
"""Scans that had come live when the snapshot was written."""
NOTE = {
    "result": "lane",
    "result_sha256": "0" * 64,
    "detection": "main",
    "alarm_id": "alarm-1",
    "x": 0.2,
    "y": 4.5,
    "verdict": "mine",
    "text": "bright",
}
_RECIPE = (
    ("variants = true\n", ""),
    ("x = [-2.0, 2.0]", "x = [-1.0, 1.0]"),
    ("spacing = 0.05", "spacing = 0.1"),
    ("size = 25", "size = 13"),
    ("halo = 1.0", "halo = 0.3"),
)
_ONE_CHANNEL = (
    ('window = "boxcar"', 'window = "boxcar"\npolarizations = ["HH"]'),
    ("F2 = [1.25e9, 1.85e9]\n", ""),
    ('[features]\ninner = [5, 3]\npsi = "circular"\ngain = "shared"\n', ""),
)


def make_formats(folder: Path) -> None:
    """Write small files of every format to a folder."""
    _write_inputs(folder)
    _write_unfinished(folder / "unfinished.zarr")
    about = {"words": "näher", "numbers": [1, 2.5, None]}
    write_bundle(folder / "arrays.bundle", _arrays(), about)
    lane = folder / "lane.toml"
    run = folder / "run.zarr"
    recipe = folder / "features.toml"
    flgpr(
        "train", run, "--truth", folder / "training-truth.csv", "--recipe", recipe,
        "--lane", folder / "training-lane.toml", "--feature", "C_HH_F1", "--feature", "M_VV_F1",
        "-o", folder / "model", "--quiet",
    )  # fmt: skip
    learnt = folder / "model"
    detect(run, recipe, folder / "result", lane, model=learnt, report=False)
    recipe = folder / "simple.toml"
    detect(run, recipe, folder / "sections", lane, section=0.9, report=False)
    _write_live(folder)
    _write_test_plan(folder)
    (folder / "verdicts.json").write_bytes(verdict_bytes([NOTE]))


def _write_inputs(folder: Path) -> None:
    run = small_run(scans=SCANS, step=0.5, tones=48).isel(pair=slice(0, 8, 2))
    signal = np.round(run["signal"].values / QUANTUM) * QUANTUM
    run = run.assign(signal=(run["signal"].dims, signal.astype(np.complex64)))
    run = run.assign_coords(time=("scan", 0.25 * np.arange(SCANS)))
    attrs = {"title": "small", "soil": {"permittivity": 4.0}, "notes": ["made up", None]}
    save_run(run.assign_attrs(attrs), folder / "run.zarr")
    recipe = cut_down(small_recipe(), _RECIPE)
    (folder / "features.toml").write_text(recipe)
    (folder / "simple.toml").write_text(cut_down(recipe, _ONE_CHANNEL))
    (folder / "lane.toml").write_text(LANE)
    (folder / "truth.csv").write_text(TRUTH)
    (folder / "training-lane.toml").write_text(TRAINING_LANE)
    (folder / "training-truth.csv").write_text(TRAINING_TRUTH)


def tiny_run():
    """Make a run of three scans, two pairs and five tones, with a sweep and a time missing."""
    rng = np.random.default_rng(5)
    signal = (rng.normal(size=(3, 2, 2, 5)) + 1j * rng.normal(size=(3, 2, 2, 5))).astype(
        np.complex64
    )
    signal[1, 0, 1, 2] = np.nan
    pose = np.zeros((3, 6))
    pose[:, 1] = np.arange(3)
    pose[:, 2] = 1.5
    ends = [[-0.5, 0, 0], [0.5, 0, 0]]
    frequency = 1e9 + 1e7 * np.arange(5)
    return make_run(signal, frequency, ["HH", "VV"], ends, ends[::-1], pose, [0.0, np.nan, 2.0])


def begin_writing(path: Path, scans: int) -> int:
    """Write the tiny run, or go on with it, up to so many scans; return how many were there."""
    run = tiny_run()
    fixed = [
        run[name].values for name in ("frequency", "polarization", "tx_position", "rx_position")
    ]
    with RunWriter(path, *fixed, {"title": "tiny"}, resume=True, inputs={"digest": "0f"}) as writer:
        there = len(writer)
        for scan in range(there, scans):
            pose = run["pose"].values[scan]
            writer.append(run["signal"].values[scan], pose, float(run["time"].values[scan]))
        if scans < run.sizes["scan"]:
            raise InterruptedError
    return there


def _write_unfinished(path: Path) -> None:
    """Write a store that is whole, and one whose writer was stopped."""
    begin_writing(path.with_name("tiny.zarr"), 3)
    with suppress(InterruptedError):
        begin_writing(path, 2)


def _arrays():
    return {
        "complex": np.array([[1 + 2j, np.nan]], np.complex64),
        "double": np.linspace(0, 1, 3),
        "empty": np.zeros((0, 4), np.float32),
        "flags": np.array([True, False]),
        "numbers": np.arange(5, dtype=np.int16),
        "scalar": np.array(7, np.uint64),
        "words": np.array(["HH", "VV", "ä"]),
    }


def live(folder: Path, output: Path) -> None:
    """Take the scans that came, or the rest of them, with the recipe of one channel."""
    flgpr(
        "live", folder / "incoming", "--recipe", folder / "simple.toml",
        "--lane", folder / "lane.toml", "--warm-up", 3, "--looks", 1, "-o", output, "--quiet",
    )  # fmt: skip


def _write_live(folder: Path) -> None:
    """Write live scans, the snapshot after some of them, and what a whole live run leaves."""
    feed(folder / "run.zarr", folder / "incoming", np.inf, count=FIRST)
    end = folder / "incoming" / "end.json"
    end.write_text("{}")
    live(folder, folder / "live")
    shutil.copytree(folder / "live", folder / "live-so-far")
    end.unlink()
    feed(folder / "run.zarr", folder / "incoming", np.inf, first=FIRST)
    live(folder, folder / "live")


def _write_test_plan(folder: Path) -> None:
    """Write a register with a witness, a sealed truth and the score of it."""
    (folder / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,1\nplastic,0.1,1\n")
    lane = folder / "lane.toml"
    book = folder / "register.jsonl"
    drawn = ["--seed", 3, "--spacing", 0.5, "--edge", 0.1, "--book", book]
    plan = folder / "plan.csv"
    flgpr("plan", "lane", lane, folder / "sorts.csv", "-o", plan, *drawn, "--quiet")
    witness = folder / "witness.jsonl"
    known = ["--book", book, "--witness", witness]
    flgpr("plan", "register", folder / "simple.toml", *known, "--quiet")
    truth = folder / "truth.csv"
    typed = f"{PHRASE}\n{PHRASE}\n"
    flgpr(
        "score",
        truth,
        "--seal",
        "--lane",
        lane,
        "--halo",
        0.3,
        "-o",
        folder / "sealed",
        typed=typed,
    )
    alarms = folder / "result" / "alarms.csv"
    flgpr(
        "score", alarms, "--truth", truth, "--lane", lane, "--halo", 0.3,
        "-o", folder / "score", "--quiet",
    )  # fmt: skip


def file_table(folder: Path) -> dict:
    """Describe every file below a folder: keys, columns, types and shapes, or its size."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): describe(path) for path in paths}


def describe(path: Path):
    if path.name == "zarr.json":
        return _zarr(json.loads(path.read_text()))
    readers = {
        ".arrays": _bundle, ".bundle": _bundle, ".csv": _columns, ".f16": _size, ".json": _json,
        ".jsonl": _lines, ".npz": _archive, ".scan": _frame,
    }  # fmt: skip
    if path.name == "sealed":
        return _json(path)
    if path.name == "lane.toml":
        return _keys(path)
    if "c" in path.parts:
        return _size(path)  # a chunk
    return readers.get(path.suffix, lambda _: "file")(path)


def _json(path: Path):
    return json_shape(json.loads(path.read_text()), path.parent)


def _size(path: Path) -> str:
    return f"{path.stat().st_size} bytes"


def _keys(path: Path):
    return json_shape(tomllib.loads(path.read_text()), path.parent)


def _columns(path: Path) -> list[str]:
    with path.open(newline="") as file:
        return next(csv.reader(file))


def _lines(path: Path) -> dict:
    """Return the keys of the lines of a log, by their event where they have one."""
    kinds = {}
    for text in path.read_text().splitlines():
        line = json.loads(text[text.index("{") :])  # a journal's lines begin with a digest
        kinds.setdefault(str(line.get("event", "line")), []).append(line)
    return {kind: json_shape(lines, path.parent) for kind, lines in sorted(kinds.items())}


def _array(values: np.ndarray) -> str:
    return f"{values.dtype.str} {values.shape}"


def _archive(path: Path) -> dict:
    with np.load(path, allow_pickle=False) as arrays:
        return {name: _array(arrays[name]) for name in arrays.files}


def _bundle(path: Path) -> dict:
    bundle = Bundle(path)
    arrays = {name: _array(values) for name, values in bundle.items()}
    return {"about": json_shape(bundle.about, path.parent), "arrays": arrays}


def _frame(path: Path) -> dict:
    frame = decode_frame(path.read_bytes())
    return {"header": json_shape(frame.header, path.parent), "payload": len(frame.payload)}


def _zarr(content: dict) -> dict:
    """Return what a reader of Zarr needs to know of an array, or the attributes of a group."""
    if content["node_type"] == "group":
        return {"attributes": json_shape(content["attributes"], Path())}
    chunks = content["chunk_grid"]["configuration"]["chunk_shape"]
    return {
        "chunks": str(chunks),
        "codecs": [one["name"] for one in content["codecs"]],
        "dimensions": content["dimension_names"],
        "shape": str(content["shape"]),
        "type": content["data_type"],
    }


def values(folder: Path) -> dict:
    """Read files by the package's readers and return their words, and digests of their numbers."""
    result = read_result(folder / "result")
    detection = result.detections[0]
    sections = read_sections(folder / "sections")
    snapshot = Bundle(folder / "live-so-far" / "snapshot.bundle")
    frame = decode_frame((folder / "incoming" / "scan-000003.scan").read_bytes())
    bundle = Bundle(folder / "arrays.bundle")
    check = ["plan", "check", folder / "register.jsonl", "--witness", folder / "witness.jsonl"]
    return {
        "run": _run(folder / "run.zarr"),
        "tiny run": _run(folder / "tiny.zarr"),
        "bundle": {"about": bundle.about, "arrays": _digests(bundle)},
        "result": {
            "alarms": _table(detection.alarms),
            "features": _table(detection.features),
            "lane": str(result.lane),
            "run": result.manifest["run"]["store_sha256"],
            "view": array_digest(detection.view.values),
        },
        "sections": {"alarms": _table(sections.alarms()), "names": list(sections.names)},
        "model": json.loads(flgpr("info", folder / "model", "--json").replace(str(folder), "")),
        "snapshot": {"about": json_digest(snapshot.about), "arrays": _digests(snapshot)},
        "scan": {"header": frame.header, "payload": digest(frame.payload)},
        "description": json_digest(read_description(folder / "incoming").as_json()),
        "register": json.loads(flgpr(*check, "--json").replace(str(folder), "")),
        "verdicts": read_verdicts(folder / "verdicts.json"),
    }


def _run(path: Path) -> dict:
    run = open_run(path)
    arrays = {
        str(name): f"{one.dims} {array_digest(one.values)}" for name, one in run.variables.items()
    }
    return {"arrays": arrays, "attrs": run.attrs}


def _digests(arrays) -> dict[str, str]:
    return {name: f"{_array(one)} {array_digest(one)}" for name, one in arrays.items()}


def _table(table) -> dict[str, str]:
    digests = {}
    for name in table.columns:
        if pd.api.types.is_numeric_dtype(table[name]):
            digests[str(name)] = array_digest(table[name].to_numpy(dtype=np.float64))
        else:
            digests[str(name)] = json_digest([str(one) for one in table[name]])
    return digests


def copy_formats(source: Path, target: Path) -> None:
    """Copy what is committed of ``make_formats``: no pages and pictures, no snapshot of the end."""
    shutil.rmtree(target, ignore_errors=True)
    unwanted = shutil.ignore_patterns("*.html", "*.png", "*.pdf")
    shutil.copytree(source, target, ignore=unwanted)
    (target / "live" / "snapshot.bundle").unlink()
