"""The files of a detection in a result folder: tables, the run-view, and the alarms of frames."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.archive import Archive
from flgpr.door import Folder
from flgpr.method.detection import MAIN, Detection
from flgpr.model.constants import IMAGE_ATTRS
from flgpr.model.run import described
from flgpr.results.manifest import ResultError
from flgpr.store import sha256, write_geojson, write_table, write_whole
from flgpr.store.notes import log_note
from flgpr.store.tables import parse_columns, parse_own_table
from flgpr.types import Entries, FloatArray

if TYPE_CHECKING:
    from flgpr.geo import Anchor

FRAMES = "frames.npz"
"""Alarms of every frame, where the recipe scores by frames."""
_FRAME_COLUMNS = ("frame", "across", "ahead", "confidence")


def write_detection(folder: Path, detection: Detection, reference: Any, recipe_text: str) -> None:
    """Write the tables and the run-view of one detection, and its recipe where it is not the result's own."""
    write_table(detection.alarms, folder / "alarms.csv")
    _write_points(detection.alarms, folder, reference, sha256(recipe_text.encode()))
    arrays: Entries = {}
    for name in ("y", "x", "looks"):
        arrays[name] = np.asarray(detection.view[name].values)
    for name in ("polarization", "subband"):
        arrays[name] = np.asarray(detection.view[name].values, dtype=str)
    arrays["magnitude"] = detection.view.values.astype(np.float32)
    write_whole(folder / "run_view.npz", _npz(arrays))
    if detection.features is not None:
        write_table(detection.features, folder / "features.csv")
    if detection.frames is not None:
        write_whole(folder / FRAMES, _frames_bytes(*detection.frames))
    if detection.recipe_text:
        write_whole(folder / "recipe.toml", detection.recipe_text)


def _write_points(alarms: pd.DataFrame, folder: Path, reference: Any, processing_id: str) -> None:
    """Write alarms as GeoJSON in longitude and latitude.

    As JSON if the lane is not georeferenced.
    """
    anchor = None if reference is None else _anchor_of(reference)
    if anchor is None:
        write_geojson(alarms, folder / "alarms.json")
        return
    from flgpr.geo import georeference, write_earth_geojson

    points = georeference(alarms, anchor, "alarms", processing_id)
    attributes = {
        "kind": "alarms",
        "anchor_crs": anchor.crs,
        "anchor_sigma_m": None,
        "processing_id": processing_id,
    }
    write_earth_geojson(points, folder / "alarms.geojson", attributes)


def _anchor_of(reference: Any) -> Anchor | None:
    """Return the anchor of a run's attribute ``georeference``.

    None, with a note, if it is damaged.
    """
    # Geodesy takes its time to load, and few runs are georeferenced.
    from flgpr.geo import own_anchor

    try:
        return own_anchor(reference)
    except ValueError as error:
        log_note(f"alarms are written in the lane frame alone: {error}")
        return None


@dataclass(frozen=True)
class DetectionFiles:
    """The files of a detection, which were read and are as they were written."""

    root: Path  #: the result folder
    prefix: str  #: what stands before the names of the files there
    alarms: bytes  #: ``alarms.csv``
    view: bytes  #: ``run_view.npz``
    features: bytes | None  #: ``features.csv``
    frames: bytes | None  #: ``frames.npz``
    recipe: bytes | None  #: ``recipe.toml`` of a recipe beside the result's own


def read_detection_files(files: Folder, name: str) -> DetectionFiles:
    """Read the files of a detection, and parse none of them.

    Parameters
    ----------
    files : Folder
        The files of the result.
    name : str
        Name of the detection.
    """
    prefix = "" if name == MAIN else f"variants/{name}/"
    view = files.read(f"{prefix}run_view.npz")
    alarms = files.read(f"{prefix}alarms.csv")
    features = files.read_if_listed(f"{prefix}features.csv")
    frames = files.read_if_listed(f"{prefix}{FRAMES}")
    recipe = files.read_if_listed(f"{prefix}recipe.toml") if prefix else None
    return DetectionFiles(files.root, prefix, alarms, view, features, frames, recipe)


def parse_detection(read: DetectionFiles, entry: Mapping[str, Any]) -> Detection:
    """Return a detection by its files and its entry in the manifest.

    Raises
    ------
    ResultError
        If the run-view or the alarms of the frames cannot be read.
    ValueError
        If a table cannot be read.
    """
    with _naming(read, "run_view.npz"):
        view = parse_view(read.view)
    with _naming(read, FRAMES):
        frames = None if read.frames is None else _parse_frames(read.frames)
    alarms = parse_own_table(read.alarms, "alarms", read.root / f"{read.prefix}alarms.csv")
    features = None if read.features is None else parse_columns(read.features)
    return Detection(
        entry["name"],
        entry["title"],
        alarms,
        view,
        entry["notes"],
        features=features,
        frames=frames,
        recipe_text="" if read.recipe is None else read.recipe.decode("utf-8"),
    )


@contextmanager
def _naming(read: DetectionFiles, name: str) -> Iterator[None]:
    """Turn whatever a parser stumbles over into a ResultError that names the file."""
    try:
        yield
    except Exception as error:
        raise ResultError(f"{read.root}: {read.prefix}{name} cannot be read ({error!r})") from None


def parse_view(data: bytes) -> xr.DataArray:
    """Return the run-view (polarization, subband, y, x) of the bytes of ``run_view.npz``.

    The shapes of all arrays are checked before one is decoded.

    Raises
    ------
    ValueError
        If the shapes do not fit one another.
    """
    arrays = Archive(io.BytesIO(data))
    shapes = {name: member.shape for name, member in arrays.members.items()}
    dims = ("polarization", "subband", "y", "x")
    axes = [shapes[name] for name in dims]
    if any(len(axis) != 1 for axis in axes):
        raise ValueError(f"polarization, subband, y and x must be lists, got the shapes {axes}")
    sizes = tuple(axis[0] for axis in axes)
    if shapes["magnitude"] != sizes or shapes["looks"] != sizes[2:]:
        raise ValueError(
            f"magnitude and looks must fit {sizes}, got {shapes['magnitude']} and {shapes['looks']}"
        )
    labels = {}
    for name in ("polarization", "subband"):
        labels[name] = [str(label) for label in arrays[name]]
    coords = {**labels, "y": arrays["y"], "x": arrays["x"], "looks": (("y", "x"), arrays["looks"])}
    view = xr.DataArray(arrays["magnitude"], dims=dims, coords=coords, name="run_view")
    return described(view, IMAGE_ATTRS)


def _frames_bytes(alarms: pd.DataFrame, poses: Mapping[int, FloatArray]) -> bytes:
    """Return the alarms of every frame and the poses of all frames that were searched, as NPZ."""
    arrays: Entries = {str(name): alarms[name].to_numpy() for name in _FRAME_COLUMNS}
    arrays |= {
        "frames": np.array(list(poses), dtype=np.int64),
        "poses": np.array(list(poses.values())).reshape(-1, 6),
    }
    return _npz(arrays)


def _npz(arrays: Mapping[str, Any]) -> bytes:
    """Return arrays as the bytes of an NPZ file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _parse_frames(data: bytes) -> tuple[pd.DataFrame, dict[int, FloatArray]]:
    """Return the alarms and poses of the frames from the bytes of ``frames.npz``.

    The shapes of all arrays are checked before one is decoded.
    """
    arrays = Archive(io.BytesIO(data))
    shapes = {name: member.shape for name, member in arrays.members.items()}
    columns = {shapes[name] for name in _FRAME_COLUMNS}
    if len(columns) != 1 or len(columns.pop()) != 1:
        raise ValueError(f"{', '.join(_FRAME_COLUMNS)} must be lists of one length")
    if len(shapes["frames"]) != 1 or shapes["poses"] != (*shapes["frames"], 6):
        raise ValueError(
            f"poses must be 6 numbers per frame, got {shapes['poses']} for {shapes['frames']}"
        )
    alarms = pd.DataFrame({name: arrays[name] for name in _FRAME_COLUMNS})
    return alarms, dict(zip(arrays["frames"].tolist(), arrays["poses"], strict=True))
