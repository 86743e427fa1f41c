"""The result folder: what detection found, how, and from what."""

from __future__ import annotations

import io
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import flgpr
from flgpr.archive import Archive
from flgpr.chain.lane_chain import MAIN, Detection
from flgpr.chain.model import MODEL_FILE, Detector, Model, as_model, load_model, save_model
from flgpr.chain.recipe import Recipe, parse_recipe
from flgpr.door import DoorError, Folder
from flgpr.model import Lane
from flgpr.results.errors import ResultError
from flgpr.results.sections import SECTIONS, read_sections
from flgpr.results.view_files import plain_json, write_view
from flgpr.store import canonical_json, seal, sha256
from flgpr.store.files import check_free_folder, listed_files, read_sealed, write_whole
from flgpr.store.notes import tell_note
from flgpr.store.outputs import held_folder, whole_output
from flgpr.store.tables import parse_columns, parse_own_table, write_geojson, write_table

if TYPE_CHECKING:
    from flgpr.geo import Anchor

FORMAT = "flgpr-result"
VERSION = 2
MODEL = "model"
"""Folder of the model inside a result."""
_NOT_CONTENT = ("identity", "added", "added_sizes", "sha256")
FRAMES = "frames.npz"
"""Alarms of every frame, where the recipe scores by frames."""
_FRAME_COLUMNS = ("frame", "across", "ahead", "confidence")
_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "zarr", "pandas", "scikit-learn", "scikit-image")


@dataclass(frozen=True)
class Result:
    """A result folder, read."""

    folder: Path  #: where it lies
    manifest: dict[str, Any]  #: version, run, recipe and digests
    recipe: Recipe  #: what was run
    lane: Lane  #: the lane it was run for
    detections: list[Detection]  #: main result and variants
    recipe_text: str = ""  #: TOML of the recipe

    def files(self) -> Folder:
        """Give the folder's files, as the manifest that was read lists them."""
        return listed_files(self.folder, self.manifest)

    def model(self) -> Model | None:
        """Load the model that it was made with; None if there was none."""
        name = f"{MODEL}/{MODEL_FILE}"
        if name not in self.manifest["files"]:
            return None
        return load_model(self.files().path(MODEL), self.manifest["files"][name])

    def _repr_html_(self) -> str:
        from flgpr.results.notebook_html import result_html

        return result_html(self)

    def __repr__(self) -> str:
        alarms = len(self.detections[0].alarms)
        return f"result of {self.recipe.name}: {alarms} alarms, in {self.folder}"


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
        _write_places(detection.alarms, home, run.get("georeference"), sha256(recipe_text.encode()))
        write_whole(home / "run_view.npz", _view_bytes(detection.view))
        if detection.features is not None:
            write_table(detection.features, home / "features.csv")
        if detection.frames is not None:
            write_whole(home / FRAMES, _frames_bytes(*detection.frames))
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


def _write_places(alarms: pd.DataFrame, home: Path, reference: Any, processing_id: str) -> None:
    """Write alarms as GeoJSON, which is longitude and latitude; of a lane that knows no place on Earth, as JSON."""
    anchor = None if reference is None else _anchor_of(reference)
    if anchor is None:
        write_geojson(alarms, home / "alarms.json")
        return
    from flgpr.geo import georeference, write_earth_geojson

    points = georeference(alarms, anchor, "alarms", processing_id)
    about = {
        "kind": "alarms",
        "anchor_crs": anchor.crs,
        "anchor_sigma_m": None,
        "processing_id": processing_id,
    }
    write_earth_geojson(points, home / "alarms.geojson", about)


def _anchor_of(reference: Any) -> Anchor | None:
    """Make the anchor of a run's attribute ``georeference``; none, with a note, of one that is damaged."""
    from flgpr.geo import own_anchor

    try:
        return own_anchor(reference)
    except ValueError as error:
        tell_note(f"alarms are written in the lane frame alone: {error}")
        return None


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
        **_listing(home),
    }


def _listing(home: Path) -> dict[str, dict[str, Any]]:
    """List digests and sizes of all files of a folder that was just written."""
    files = {
        path.relative_to(home).as_posix(): path.read_bytes()
        for path in sorted(home.rglob("*"))
        if path.is_file()
    }
    return {
        "files": {name: sha256(data) for name, data in files.items()},
        "sizes": {name: len(data) for name, data in files.items()},
    }


Added = Mapping[str, list[tuple[str | None, int | None]]]
"""Digest and size of what is added to a folder later; several, and None for no file, while it is being written."""


def _manifest(content: dict[str, Any], added: Added) -> bytes:
    """Seal the content, its identity, and digests and sizes of what is added to the folder later."""
    digests = {name: [digest for digest, _ in versions] for name, versions in added.items()}
    sizes = {name: [size for _, size in versions] for name, versions in added.items()}
    identity = sha256(canonical_json(content))
    return seal({**content, "identity": identity, "added": digests, "added_sizes": sizes})


def _added(manifest: Mapping[str, Any]) -> dict[str, list[tuple[str | None, int | None]]]:
    """Read what :func:`_manifest` told of files that were added; sizes are None in a manifest of an older version."""
    sizes = manifest.get("added_sizes", {})
    return {
        name: list(zip(digests, sizes.get(name, [None] * len(digests)), strict=True))
        for name, digests in manifest["added"].items()
    }


def add_files(folder: str | Path, files: Mapping[str, bytes | str]) -> None:
    """Add pages and scores to a result, or replace some; it can be read whenever this is interrupted.

    The manifest first allows the old and the new digests, then, when the files are written, the new ones only. One
    process after the other does so.
    """
    folder = Path(folder)
    read_result_manifest(folder)
    with held_folder(folder, wait=True):
        _add_files(
            folder,
            {
                name: text.encode() if isinstance(text, str) else text
                for name, text in files.items()
            },
        )


def _add_files(folder: Path, data: Mapping[str, bytes]) -> None:
    manifest = read_result_manifest(folder)
    for name in data:
        parent = (folder / name).parent
        parent.mkdir(exist_ok=True)
        if parent != folder:
            Folder(folder).path(
                parent.relative_to(folder).as_posix()
            )  # a link would lead the file elsewhere
    content = {name: value for name, value in manifest.items() if name not in _NOT_CONTENT}
    before = _added(manifest)
    after: Added = {name: [(sha256(body), len(body))] for name, body in data.items()}
    both = {
        name: [*before.get(name, [(None, None)]), *versions] for name, versions in after.items()
    }
    write_whole(folder / "manifest.json", _manifest(content, {**before, **both}))
    for name, body in data.items():
        write_whole(folder / name, body)
    write_whole(folder / "manifest.json", _manifest(content, {**before, **after}))


def are_settled(folder: str | Path) -> bool:
    """Tell whether all that was added to a result was written to the end."""
    return all(len(digests) == 1 for digests in read_result_manifest(folder)["added"].values())


def read_result_manifest(folder: str | Path) -> dict[str, Any]:
    """Read the manifest of a result folder and no other file; ``identity`` stays when files are added."""
    folder = Path(folder)
    try:
        manifest = read_sealed(folder, "manifest.json")
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        return manifest
    except OSError as error:
        raise ResultError(
            f"{folder}: not a whole result folder: {error.filename} is missing"
        ) from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json is altered: {error}") from None


def read_result(folder: str | Path) -> Result:
    """Read a result folder; if one of the files it was written with is missing or altered, that is a ResultError."""
    folder = Path(folder)
    manifest = read_result_manifest(folder)
    try:
        files = listed_files(folder, manifest)
        lane = Lane(**manifest["lane"])
        detections = [_read_detection(files, entry) for entry in manifest["detections"]]
        text = files.read("recipe.toml").decode("utf-8")
        recipe = parse_recipe(text, str(folder / "recipe.toml"))
        for name in (files.listed or {}).keys() - files.proven:
            files.check(name)
    except FileNotFoundError as error:
        raise ResultError(
            f"{folder}: not a whole result folder: {error.filename} is missing"
        ) from None
    except DoorError as error:
        raise ResultError(str(error)) from None
    except ResultError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError, OSError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json cannot be read ({error})") from None
    return Result(folder, manifest, recipe, lane, detections, text)


def join_sections(folder: Path, homes: Sequence[Path], most: int = 2400) -> Result:
    """Read a lane that was taken in sections as if it were in one piece, its run-view thinned to so many rows."""
    first = read_result(homes[0])
    rows = read_result_manifest(homes[-1])["section"]["rows"][1]
    step = -(-rows // max(1, most - len(homes)))
    views = [_thinned_view(read_result(home).detections[0].view, step) for home in homes]
    sections = read_sections(folder)
    whole = replace(
        first.detections[0], alarms=sections.alarms(), view=xr.concat(views, "y"), features=None
    )
    return replace(first, folder=folder, lane=sections.lane(), detections=[whole])


def read_lane_result(folder: str | Path) -> Result:
    """Read the result of a lane; of one that was taken in sections they are joined."""
    home = Path(folder)
    if not Folder(home).has(SECTIONS):
        return read_result(home)
    return join_sections(home, read_sections(home).homes)


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
    return thinned(view, step).assign_coords(
        looks=thinned(view["looks"].reset_coords(drop=True), step)
    )


def _read_detection(files: Folder, entry: dict[str, Any]) -> Detection:
    home = "" if entry["name"] == MAIN else f"variants/{entry['name']}/"
    data = files.read(f"{home}run_view.npz")
    try:
        view = parse_view(data)
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ResultError(f"{files.root}: {home}run_view.npz cannot be read ({error!r})") from None
    alarms = parse_own_table(
        files.read(f"{home}alarms.csv"), "alarms", files.root / f"{home}alarms.csv"
    )
    table = files.read_if_listed(f"{home}features.csv")
    features = None if table is None else parse_columns(table)
    stored = files.read_if_listed(f"{home}{FRAMES}")
    try:
        frames = None if stored is None else _parse_frames(stored)
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ResultError(f"{files.root}: {home}{FRAMES} cannot be read ({error!r})") from None
    return Detection(
        entry["name"],
        entry["title"],
        alarms,
        view,
        entry["notes"],
        features=features,
        frames=frames,
    )


def parse_view(data: bytes) -> xr.DataArray:
    """Read a run-view from the bytes of ``run_view.npz``, whose arrays must fit one another before one is decoded."""
    arrays = Archive(io.BytesIO(data))
    shapes = {name: member.shape for name, member in arrays.members.items()}
    axes = [shapes[name] for name in ("polarization", "subband", "y", "x")]
    if any(len(axis) != 1 for axis in axes):
        raise ValueError(f"polarization, subband, y and x must be lists, got the shapes {axes}")
    sizes = tuple(axis[0] for axis in axes)
    if shapes["magnitude"] != sizes or shapes["looks"] != sizes[2:]:
        raise ValueError(
            f"magnitude and looks must fit {sizes}, got {shapes['magnitude']} and {shapes['looks']}"
        )
    labels = {name: [str(label) for label in arrays[name]] for name in ("polarization", "subband")}
    coords = {**labels, "y": arrays["y"], "x": arrays["x"], "looks": (("y", "x"), arrays["looks"])}
    dims = ("polarization", "subband", "y", "x")
    return xr.DataArray(arrays["magnitude"], dims=dims, coords=coords, name="run_view")


def _frames_bytes(alarms: pd.DataFrame, poses: Mapping[int, NDArray[np.float64]]) -> bytes:
    """Write the alarms of every frame, and the poses of all frames that were searched, as arrays."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {str(name): alarms[name].to_numpy() for name in _FRAME_COLUMNS}
    arrays |= {
        "frames": np.array(list(poses), dtype=np.int64),
        "poses": np.array(list(poses.values())).reshape(-1, 6),
    }
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _parse_frames(data: bytes) -> tuple[pd.DataFrame, dict[int, NDArray[np.float64]]]:
    """Read the alarms and poses of the frames from the bytes of ``frames.npz``, whose arrays must fit one another."""
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


def _view_bytes(view: xr.DataArray) -> bytes:
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(view[name].values) for name in ("y", "x", "looks")}
    arrays |= {
        name: np.asarray(view[name].values, dtype=str) for name in ("polarization", "subband")
    }
    arrays["magnitude"] = view.values.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()
