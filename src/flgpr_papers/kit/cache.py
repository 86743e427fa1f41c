"""Finished steps of a study on disk, under a key of their inputs: a stopped study resumes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.progress import Track
from flgpr.execution.simulated_lane import simulate_to_store
from flgpr.model import Lane
from flgpr.simulate import Scene, Sensor, draw_world
from flgpr.store import Bundle, canonical_json, read_manifest, sha256, write_bundle, write_whole

Arrays = dict[str, NDArray[Any]]


def key_of(*content: Any) -> str:
    """Compute twelve digits that stand for all that a result was made from."""
    return sha256(canonical_json(content))[:12]


def kept(path: Path, make: Callable[[], Any]) -> Any:
    """Read a record (JSON), or make and write it."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(make()))
    return json.loads(path.read_text("utf-8"))


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays into one file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bundle(path, arrays)


def read_arrays(path: Path) -> Arrays:
    """Read arrays from one file."""
    return dict(Bundle(path))


def store_lane(
    folder: Path, scene: Scene, seed: int, sensor: Sensor, track: Track
) -> tuple[Path, pd.DataFrame, Lane]:
    """Simulate a lane into a run store, unless exactly this lane is there already.

    Store, its targets and the lane.
    """
    path = folder / f"{scene.name}.zarr"
    note = folder / f"{scene.name}.digest"
    content = {
        "scene": scene.model_dump(mode="json"),
        "seed": seed,
        "sensor": sensor.model_dump(mode="json"),
    }
    digest = sha256(canonical_json(content))
    if path.is_dir() and note.is_file() and note.read_text(encoding="utf-8").strip() == digest:
        read_manifest(path)
    else:
        note.unlink(missing_ok=True)
        shutil.rmtree(path, ignore_errors=True)
        simulate_to_store(scene, sensor, seed, path, track=track)
        write_whole(note, digest + "\n")
    return path, draw_world(scene, seed).truth(), scene.lane
