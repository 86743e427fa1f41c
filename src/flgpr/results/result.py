"""The result folder: what detection found, how, and from what."""

from __future__ import annotations

import io
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flgpr
from flgpr.chain.lane_chain import MAIN, Detection
from flgpr.chain.model import MODEL_FILE, Detector, Model, as_model, load_model, save_model
from flgpr.chain.recipe import Recipe, parse_recipe
from flgpr.io import canonical_json, inside, read_lane, read_limited, read_table, seal, sha256, unseal
from flgpr.io.files import check_free_folder, write_whole
from flgpr.io.outputs import held_folder, whole_output
from flgpr.io.tables import write_geojson, write_table
from flgpr.model import Lane
from flgpr.results.view_files import plain_json, write_view

FORMAT, VERSION = "flgpr-result", 2
MODEL = "model"
"""Folder of the model inside a result."""
SECTIONS = "sections.json"
"""What lists the result folders of a lane that was taken in sections."""
_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "zarr", "pandas", "scikit-learn", "scikit-image")


class ResultError(ValueError):
    """A result folder is incomplete, altered or not a result folder at all."""


@dataclass(frozen=True)
class Result:
    """A result folder, read."""

    folder: Path  #: where it lies
    manifest: dict[str, Any]  #: version, run, recipe and digests
    recipe: Recipe  #: what was run
    lane: Lane  #: the lane it was run for
    detections: list[Detection]  #: main result and variants
    recipe_text: str = ""  #: TOML of the recipe

    def model(self) -> Model | None:
        """Load the model that it was made with; None if there was none."""
        return load_model(self.folder / MODEL) if f"{MODEL}/{MODEL_FILE}" in self.manifest["files"] else None


def write_result(
    folder: str | Path,
    detections: list[Detection],
    recipe_text: str,
    lane: Lane,
    run: dict[str, Any],
    model: Model | Detector | None = None,
    section: dict[str, Any] | None = None,
) -> Path:
    """Write a result folder, whole or not at all; an older result there is replaced, anything else refused.

    ``section`` tells what part of a longer lane it is, see :func:`flgpr.chain.sections.section_note`.
    """
    folder = check_free(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_output(folder, replace=True) as made:
        _write_files(made, detections, recipe_text, lane, run, model, section)
    return folder


def _write_files(
    made: Path,
    detections: list[Detection],
    recipe_text: str,
    lane: Lane,
    run: dict[str, Any],
    model: Model | Detector | None,
    section: dict[str, Any] | None,
) -> None:
    """Write all files of a result, its manifest last."""
    made.mkdir()
    for detection in detections:
        home = made if detection.name == MAIN else made / "variants" / detection.name
        home.mkdir(parents=True, exist_ok=True)
        write_table(detection.alarms, home / "alarms.csv")
        write_geojson(detection.alarms, home / "alarms.geojson")
        write_whole(home / "run_view.npz", _view_bytes(detection.view))
        if detection.features is not None:
            write_whole(home / "features.csv", detection.features.to_csv(index=False, lineterminator="\n"))
    learnt = as_model(model)
    border = None if learnt.detector is None else learnt.detector.border
    write_view(made, detections, lane, run, parse_recipe(recipe_text), border)
    write_whole(made / "recipe.toml", recipe_text)
    if learnt.detector is not None or learnt.stages:
        save_model(learnt, made / MODEL)
    content = plain_json(_content(made, detections, recipe_text, lane, run))
    if section is not None:
        content["section"] = section
    write_whole(made / "manifest.json", _manifest(content, {}))


def check_free(folder: str | Path) -> Path:
    """Return the place if a result may be written there; a FileExistsError if something else lies there."""
    return check_free_folder(folder, ("manifest.json", SECTIONS), "result")


def _content(
    home: Path, detections: list[Detection], recipe_text: str, lane: Lane, run: dict[str, Any]
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in _LIBRARIES},
        "recipe_sha256": sha256(recipe_text.encode()),
        "lane": asdict(lane),
        "run": run,
        "detections": [{"name": d.name, "title": d.title, "notes": d.notes} for d in detections],
        "files": {
            file.relative_to(home).as_posix(): sha256(file.read_bytes())
            for file in sorted(home.rglob("*"))
            if file.is_file()
        },
    }


def _manifest(content: dict[str, Any], added: dict[str, list[str | None]]) -> bytes:
    """Seal the content, its identity, and the digests of what is added to the folder later."""
    return seal({**content, "identity": sha256(canonical_json(content)), "added": added})


def add_files(folder: str | Path, files: Mapping[str, bytes | str]) -> None:
    """Add pages and scores to a result, or replace some; it can be read whenever this is interrupted.

    The manifest first allows the old and the new digests, then, when the files are written, the new ones only. One
    process after the other does so.
    """
    folder = Path(folder)
    read_result_manifest(folder)
    with held_folder(folder, wait=True):
        _add_files(folder, {name: text.encode() if isinstance(text, str) else text for name, text in files.items()})


def _add_files(folder: Path, data: Mapping[str, bytes]) -> None:
    manifest = read_result_manifest(folder)
    for name in data:
        (folder / name).parent.mkdir(exist_ok=True)
    content = {name: value for name, value in manifest.items() if name not in ("identity", "added", "sha256")}
    added: dict[str, list[str | None]] = dict(manifest["added"])
    both = {name: [*added.get(name, [None]), sha256(body)] for name, body in data.items()}
    write_whole(folder / "manifest.json", _manifest(content, added | both))
    for name, body in data.items():
        write_whole(folder / name, body)
    write_whole(folder / "manifest.json", _manifest(content, added | {n: [sha256(b)] for n, b in data.items()}))


def are_settled(folder: str | Path) -> bool:
    """Tell whether all that was added to a result was written to the end."""
    return all(len(digests) == 1 for digests in read_result_manifest(folder)["added"].values())


def read_result_manifest(folder: str | Path) -> dict[str, Any]:
    """Read the manifest of a result folder and no other file; ``identity`` stays when files are added."""
    folder = Path(folder)
    try:
        manifest = unseal(read_limited(folder / "manifest.json"))
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        return manifest
    except OSError as error:
        raise ResultError(f"{folder}: not a whole result folder: {error.filename} is missing") from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json is altered: {error}") from None


def read_result(folder: str | Path) -> Result:
    """Read a result folder; if one of the files it was written with is missing or altered, that is a ResultError."""
    folder = Path(folder)
    manifest = read_result_manifest(folder)
    try:
        for name, digest in manifest["files"].items():
            _check_file(folder, name, [digest])
        for name, digests in manifest["added"].items():
            _check_file(folder, name, digests)
        lane = Lane(**manifest["lane"])
        detections = [_read_detection(folder, entry) for entry in manifest["detections"]]
        text = (folder / "recipe.toml").read_text(encoding="utf-8")
        recipe = parse_recipe(text, str(folder / "recipe.toml"))
    except FileNotFoundError as error:
        raise ResultError(f"{folder}: not a whole result folder: {error.filename} is missing") from None
    except ResultError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError, OSError) as error:
        raise ResultError(f"{folder}: manifest.json cannot be read ({error})") from None
    return Result(folder, manifest, recipe, lane, detections, text)


def join_sections(folder: Path, homes: Sequence[Path], most: int = 2400) -> Result:
    """Read a lane that was taken in sections as if it were in one piece, its run-view thinned to so many rows."""
    first = read_result(homes[0])
    rows = read_result_manifest(homes[-1])["section"]["rows"][1]
    step = -(-rows // max(1, most - len(homes)))
    views = [_thinned_view(read_result(home).detections[0].view, step) for home in homes]
    alarms = read_table(folder / "alarms.csv", "alarms")
    whole = replace(first.detections[0], alarms=alarms, view=xr.concat(views, "y"), features=None)
    return replace(first, folder=folder, lane=read_lane(folder / "lane.toml"), detections=[whole])


def thinned(view: xr.DataArray, step: int) -> xr.DataArray:
    """Take the largest of so many neighbouring rows."""
    if step == 1:
        return view
    rows = np.arange(0, view.sizes["y"], step)
    middle = view["y"].values[np.minimum(rows + step // 2, view.sizes["y"] - 1)]
    values = np.fmax.reduceat(view.values, rows, axis=view.get_axis_num("y"))
    coords = {name: middle if name == "y" else view[name].values for name in map(str, view.dims)}
    return xr.DataArray(values, dims=view.dims, coords=coords, name=view.name)


def _thinned_view(view: xr.DataArray, step: int) -> xr.DataArray:
    return thinned(view, step).assign_coords(looks=thinned(view["looks"].reset_coords(drop=True), step))


def _check_file(folder: Path, name: str, digests: list[str | None]) -> None:
    try:
        path = inside(folder, name)
    except ValueError as error:
        raise ResultError(str(error)) from None
    if None in digests and not path.exists():
        return
    if sha256(path.read_bytes()) not in digests:
        raise ResultError(f"{folder}: {name} differs from what was written")


def _read_detection(folder: Path, entry: dict[str, Any]) -> Detection:
    home = folder if entry["name"] == MAIN else inside(folder, f"variants/{entry['name']}")
    try:
        view = _read_view(home / "run_view.npz")
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ResultError(f"{folder}: run_view.npz cannot be read ({error!r})") from None
    alarms = read_table(home / "alarms.csv", "alarms")
    features = pd.read_csv(home / "features.csv") if (home / "features.csv").is_file() else None
    return Detection(entry["name"], entry["title"], alarms, view, entry["notes"], features=features)


def _read_view(path: Path) -> xr.DataArray:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return xr.DataArray(
            arrays["magnitude"],
            dims=("polarization", "subband", "y", "x"),
            coords={
                **{name: [str(label) for label in arrays[name]] for name in ("polarization", "subband")},
                "y": arrays["y"],
                "x": arrays["x"],
                "looks": (("y", "x"), arrays["looks"]),
            },
            name="run_view",
        )


def _view_bytes(view: xr.DataArray) -> bytes:
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(view[name].values) for name in ("y", "x", "looks")}
    arrays |= {name: np.asarray(view[name].values, dtype=str) for name in ("polarization", "subband")}
    arrays["magnitude"] = view.values.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()
