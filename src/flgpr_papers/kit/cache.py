"""Finished steps of a study on disk, under a key of their inputs: an interrupted study resumes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import refuse_links
from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.model import Lane
from flgpr.progress import Track
from flgpr.simulate import Scene, Sensor, draw_world
from flgpr.store import Bundle, canonical_json, read_manifest, sha256, write_bundle, write_whole
from flgpr.types import Arrays


def key_of(*content: Any) -> str:
    """Return a key of twelve hexadecimal digits for everything that a result was made from.

    Parameters
    ----------
    *content
        Anything that JSON can hold. Equal content has the same key on every machine.
    """
    return sha256(canonical_json(content))[:12]


def read_or_make(path: Path, make: Callable[[], Any]) -> Any:
    """Read a record (JSON) from a file, or make it and write the file.

    Parameters
    ----------
    path : Path
        The file; its name holds the key of what the record is made from, see :func:`key_of`.
    make : callable
        Makes the record if there is no file.
    """
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(make()))
    # A new record is read back, too: a resumed study works on the same values, bit by bit.
    return json.loads(path.read_text("utf-8"))


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays into one file, which is complete or not there at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bundle(path, arrays)


def read_arrays(path: Path) -> Arrays:
    """Read the arrays that :func:`write_arrays` wrote."""
    return dict(Bundle(path))


def store_lane(
    folder: Path, scene: Scene, seed: int, sensor: Sensor, track: Track
) -> tuple[Path, pd.DataFrame, Lane]:
    """Simulate a lane into a run store, unless exactly this lane is there already.

    Parameters
    ----------
    folder : Path
        Folder of the stores; the lane's store and digest are named after the scene.
    scene : Scene
        The lane.
    seed : int
        Seed of everything that the scene leaves to chance.
    sensor : Sensor
        The radar.
    track : Track
        Shows progress.

    Returns
    -------
    store : Path
        The run store.
    truth : DataFrame
        The lane's targets.
    lane : Lane
        Its borders.
    """
    store = folder / f"{scene.name}.zarr"
    digest_file = folder / f"{scene.name}.digest"
    described = {
        name: one.model_dump(mode="json") for name, one in (("scene", scene), ("sensor", sensor))
    }
    digest = sha256(canonical_json({**described, "seed": seed}))
    known = digest_file.read_text("utf-8").strip() if digest_file.is_file() else ""
    if store.is_dir() and known == digest:
        read_manifest(store)  # raises an error for a store that is not committed
    else:
        refuse_links(store, digest_file)
        # The digest goes first: an interrupted simulation must not pass for a finished one.
        digest_file.unlink(missing_ok=True)
        shutil.rmtree(store, ignore_errors=True)
        for beside in ("truth.*", "objects.*", "lane.toml"):
            for path in store.parent.glob(f"{store.stem}-{beside}"):
                path.unlink()
        simulate_to_store(scene, sensor, seed, store, track=track)
        write_whole(digest_file, digest + "\n")
    return store, draw_world(scene, seed).truth(), scene.lane
