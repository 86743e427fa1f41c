"""The result folder.

Alarms and run-views of a run, and the recipe, lane and run that they come from.
"""

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
from flgpr.chain.detection import MAIN, Detection
from flgpr.chain.model import MODEL_FILE, Detector, Model, as_model, load_model, save_model
from flgpr.chain.recipe import Recipe, parse_recipe
from flgpr.door import DoorError, Folder
from flgpr.model import Lane
from flgpr.results.description import check_description
from flgpr.results.errors import ResultError
from flgpr.results.sections import SECTIONS, read_sections
from flgpr.results.view_files import plain_json, write_view
from flgpr.store import canonical_json, json_with_digest, sha256
from flgpr.store.files import check_free_folder, listed_files, read_with_digest, write_whole
from flgpr.store.notes import log_note
from flgpr.store.outputs import atomic_output, locked_folder
from flgpr.store.tables import parse_columns, parse_own_table, write_geojson, write_table

if TYPE_CHECKING:
    from flgpr.geo import Anchor

FORMAT = "flgpr-result"
VERSION = 2
MANIFEST = "manifest.json"
MODEL = "model"
"""Folder of the model inside a result."""
_NOT_CONTENT = ("identity", "added", "added_sizes", "sha256")
FRAMES = "frames.npz"
"""Alarms of every frame, where the recipe scores by frames."""
_FRAME_COLUMNS = ("frame", "across", "ahead", "confidence")
_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "zarr", "pandas", "scikit-learn")


@dataclass(frozen=True)
class Result:
    """The content of a result folder."""

    folder: Path
    manifest: dict[str, Any]  #: version, run, recipe and digests
    recipe: Recipe
    lane: Lane  #: ground that was searched
    detections: list[Detection]  #: that of its recipe first, then those of recipes beside it
    recipe_text: str = ""  #: TOML of the recipe

    @property
    def alarms(self) -> pd.DataFrame:
        """Alarms of the result's own recipe, the most mine-like first."""
        return self.detections[0].alarms

    def files(self) -> Folder:
        """Return the folder's files, as the manifest that was read lists them."""
        return listed_files(self.folder, self.manifest)

    def model(self) -> Model | None:
        """Load the model that the result was computed with; None if there was none."""
        name = f"{MODEL}/{MODEL_FILE}"
        if name not in self.manifest["files"]:
            return None
        return load_model(self.files().path(MODEL), self.manifest["files"][name])

    def _repr_html_(self) -> str:
        from flgpr.results.notebook_html import detection_html

        return detection_html(self.detections[0], self.lane, self.manifest["run"]["title"])

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
    """Write a result folder completely or not at all, and return it.

    Parameters
    ----------
    folder : path
        Folder to write. An older result there is replaced.
    detections : list of Detection
        Main result first, then its variants.
    recipe_text : str
        TOML of the recipe.
    lane : Lane
        Ground that was searched.
    run : dict
        The run, as :func:`flgpr.results.description.describe_run` describes it.
    model : Model or Detector, optional
        What the recipe's stages had learnt.
    section : dict, optional
        Which section of a longer lane it is, see :func:`flgpr.chain.sections.section_note`.

    Raises
    ------
    FileExistsError
        If anything but an older result lies there.
    """
    folder = check_free(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(folder, replace=True) as partial:
        _write_files(partial, detections, recipe_text, lane, run, model, section)
    return folder


def _write_files(
    root: Path,
    detections: list[Detection],
    recipe_text: str,
    lane: Lane,
    run: dict[str, Any],
    model: Model | Detector | None,
    section: dict[str, Any] | None,
) -> None:
    """Write all files of a result, its manifest last."""
    root.mkdir()
    for detection in detections:
        folder = root if detection.name == MAIN else root / "variants" / detection.name
        folder.mkdir(parents=True, exist_ok=True)
        _write_detection(folder, detection, run.get("georeference"), recipe_text)
    learnt = as_model(model)
    border = None if learnt.detector is None else learnt.detector.border
    write_view(root, detections, lane, run, parse_recipe(recipe_text), border)
    write_whole(root / "recipe.toml", recipe_text)
    if learnt.detector is not None or learnt.stages:
        save_model(learnt, root / MODEL)
    content = plain_json(_content(root, detections, recipe_text, lane, run))
    if section is not None:
        content["section"] = section
    write_whole(root / MANIFEST, _manifest(content, {}))


def _write_detection(folder: Path, detection: Detection, reference: Any, recipe_text: str) -> None:
    """Write the tables and the run-view of one detection, and its recipe where it is not the result's own."""
    write_table(detection.alarms, folder / "alarms.csv")
    _write_points(detection.alarms, folder, reference, sha256(recipe_text.encode()))
    write_whole(folder / "run_view.npz", _view_bytes(detection.view))
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


def check_free(folder: str | Path) -> Path:
    """Return the folder if a result may be written there.

    Raises
    ------
    FileExistsError
        If anything but a result lies there.
    """
    return check_free_folder(folder, (MANIFEST, SECTIONS), "result")


def _content(
    root: Path, detections: list[Detection], recipe_text: str, lane: Lane, run: dict[str, Any]
) -> dict[str, Any]:
    """Return what a manifest holds of the result that was written to ``root``."""
    entries = []
    for detection in detections:
        entries.append({"name": detection.name, "title": detection.title, "notes": detection.notes})
    return {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in _LIBRARIES},
        "recipe_sha256": sha256(recipe_text.encode()),
        "lane": asdict(lane),
        "run": run,
        "detections": entries,
        **_listing(root),
    }


def _listing(root: Path) -> dict[str, dict[str, Any]]:
    """Return digests and sizes of all files of a folder that was just written."""
    digests = {}
    sizes = {}
    for path in sorted(root.rglob("*")):
        if path.is_file():
            name = path.relative_to(root).as_posix()
            data = path.read_bytes()
            digests[name] = sha256(data)
            sizes[name] = len(data)
    return {"files": digests, "sizes": sizes}


# Digest and size of a file; None for no file, and a size of None where it is not known.
Version = tuple[str | None, int | None]
# Versions of the files that are added to a folder later; several of a file while it is written.
Added = Mapping[str, list[Version]]


def _manifest(content: dict[str, Any], added: Added) -> bytes:
    """Return the sealed content with its identity and the versions of files that were added."""
    digests = {}
    sizes = {}
    for name, versions in added.items():
        digests[name] = [digest for digest, _ in versions]
        sizes[name] = [size for _, size in versions]
    identity = sha256(canonical_json(content))
    return json_with_digest(
        {**content, "identity": identity, "added": digests, "added_sizes": sizes}
    )


def _added_versions(manifest: Mapping[str, Any]) -> dict[str, list[Version]]:
    """Return the versions of files that were added, as :func:`_manifest` lists them.

    Manifests of an older version have no sizes.
    """
    sizes = manifest.get("added_sizes", {})
    added = {}
    for name, digests in manifest["added"].items():
        unknown: list[int | None] = [None] * len(digests)
        added[name] = list(zip(digests, sizes.get(name, unknown), strict=True))
    return added


def add_files(folder: str | Path, files: Mapping[str, bytes | str]) -> None:
    """Add pages and scores to a result, or replace some.

    The result can be read at any moment, also after an interruption: the manifest first allows the
    old and the new digests, then, when the files are written, only the new ones. Processes do so
    one after the other.

    Parameters
    ----------
    folder : path
        Result folder.
    files : mapping of str to bytes or str
        Content of the files by name.

    Raises
    ------
    ResultError
        If the folder is no result.
    """
    folder = Path(folder)
    read_result_manifest(folder)
    data = {}
    for name, body in files.items():
        data[name] = body.encode() if isinstance(body, str) else body
    with locked_folder(folder, wait=True):
        _add_files(folder, data)


def _add_files(folder: Path, data: Mapping[str, bytes]) -> None:
    """Add files to a result that no other process writes to."""
    manifest = read_result_manifest(folder)
    for name in data:
        parent = (folder / name).parent
        parent.mkdir(exist_ok=True)
        if parent != folder:
            # Refuses a link, which would lead the file out of the folder.
            Folder(folder).path(parent.relative_to(folder).as_posix())
    content = {name: value for name, value in manifest.items() if name not in _NOT_CONTENT}
    before = _added_versions(manifest)
    after: dict[str, list[Version]] = {}
    both: dict[str, list[Version]] = {}
    for name, body in data.items():
        new_version = (sha256(body), len(body))
        after[name] = [new_version]
        both[name] = [*before.get(name, [(None, None)]), new_version]
    write_whole(folder / MANIFEST, _manifest(content, {**before, **both}))
    for name, body in data.items():
        write_whole(folder / name, body)
    write_whole(folder / MANIFEST, _manifest(content, {**before, **after}))


def are_settled(folder: str | Path) -> bool:
    """Return whether every file that was added to a result was written completely."""
    added = read_result_manifest(folder)["added"]
    return all(len(digests) == 1 for digests in added.values())


def _check_origin(manifest: Mapping[str, Any]) -> None:
    """Check the types of what a manifest says of program and recipe; another type is a ValueError."""
    for name in ("flgpr", "python", "recipe_sha256", "identity"):
        value = manifest.get(name, "")
        if not isinstance(value, str):
            raise ValueError(f"{name} must be text, got {str(value)[:60]!r}")
    libraries = manifest.get("libraries", {})
    if not isinstance(libraries, dict):
        raise ValueError(f"libraries must be a table, got {str(libraries)[:60]!r}")


def read_result_manifest(folder: str | Path) -> dict[str, Any]:
    """Read the manifest of a result folder and no other file.

    Its ``identity`` does not change when files are added.

    Raises
    ------
    ResultError
        If the manifest is missing, altered or of another format.
    """
    folder = Path(folder)
    try:
        manifest = read_with_digest(folder, MANIFEST)
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        _check_origin(manifest)
        check_description(manifest["run"])
        return manifest
    except OSError as error:
        raise ResultError(
            f"{folder}: not a complete result folder: {error.filename} is missing"
        ) from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json is altered: {error}") from None


def read_result(folder: str | Path) -> Result:
    """Read a result folder.

    Raises
    ------
    ResultError
        If a file that it was written with is missing or altered.
    """
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
            f"{folder}: not a complete result folder: {error.filename} is missing"
        ) from None
    except DoorError as error:
        raise ResultError(str(error)) from None
    except ResultError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError, OSError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json cannot be read ({error})") from None
    return Result(folder, manifest, recipe, lane, detections, text)


def join_sections(folder: Path, homes: Sequence[Path], most: int = 2400) -> Result:
    """Read a lane that was processed in sections as one result.

    Parameters
    ----------
    folder : Path
        Folder of the sections.
    homes : sequence of Path
        Result folders of the sections, in order.
    most : int, default 2400
        Rows that the run-view is thinned to.
    """
    first = read_result(homes[0])
    rows = read_result_manifest(homes[-1])["section"]["rows"][1]
    step = -(-rows // max(1, most - len(homes)))
    views = []
    for home in homes:
        section_view = read_result(home).detections[0].view
        views.append(_thinned_view(section_view, step))
    sections = read_sections(folder)
    joined = replace(
        first.detections[0], alarms=sections.alarms(), view=xr.concat(views, "y"), features=None
    )
    return replace(first, folder=folder, lane=sections.lane(), detections=[joined])


def read_lane_result(folder: str | Path) -> Result:
    """Read the result of a lane; of one that was taken in sections they are joined."""
    home = Path(folder)
    if not Folder(home).has(SECTIONS):
        return read_result(home)
    return join_sections(home, read_sections(home).homes)


def thinned(view: xr.DataArray, step: int) -> xr.DataArray:
    """Return a run-view with the largest value of every ``step`` neighbouring rows."""
    if step == 1:
        return view
    rows = np.arange(0, view.sizes["y"], step)
    middle = view["y"].values[np.minimum(rows + step // 2, view.sizes["y"] - 1)]
    values = np.fmax.reduceat(view.values, rows, axis=view.get_axis_num("y"))
    coords = {str(name): view[name].values for name in view.dims}
    coords["y"] = middle
    return xr.DataArray(values, dims=view.dims, coords=coords, name=view.name)


def _thinned_view(view: xr.DataArray, step: int) -> xr.DataArray:
    """Return a thinned run-view, its looks thinned likewise."""
    looks = thinned(view["looks"].reset_coords(drop=True), step)
    return thinned(view, step).assign_coords(looks=looks)


def _read_detection(files: Folder, entry: dict[str, Any]) -> Detection:
    """Read one detection, as the manifest's entry names it."""
    prefix = "" if entry["name"] == MAIN else f"variants/{entry['name']}/"
    alarms_name = f"{prefix}alarms.csv"
    view_data = files.read(f"{prefix}run_view.npz")
    alarms_data = files.read(alarms_name)
    features_data = files.read_if_listed(f"{prefix}features.csv")
    frames_data = files.read_if_listed(f"{prefix}{FRAMES}")
    own_recipe = files.read_if_listed(f"{prefix}recipe.toml") if prefix else None

    try:
        view = parse_view(view_data)
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ResultError(
            f"{files.root}: {prefix}run_view.npz cannot be read ({error!r})"
        ) from None
    alarms = parse_own_table(alarms_data, "alarms", files.root / alarms_name)
    features = None if features_data is None else parse_columns(features_data)
    try:
        frames = None if frames_data is None else _parse_frames(frames_data)
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ResultError(f"{files.root}: {prefix}{FRAMES} cannot be read ({error!r})") from None
    return Detection(
        entry["name"],
        entry["title"],
        alarms,
        view,
        entry["notes"],
        features=features,
        frames=frames,
        recipe_text="" if own_recipe is None else own_recipe.decode("utf-8"),
    )


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
    axes = [shapes[name] for name in ("polarization", "subband", "y", "x")]
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
    dims = ("polarization", "subband", "y", "x")
    return xr.DataArray(arrays["magnitude"], dims=dims, coords=coords, name="run_view")


def _frames_bytes(alarms: pd.DataFrame, poses: Mapping[int, NDArray[np.float64]]) -> bytes:
    """Return the alarms of every frame and the poses of all frames that were searched, as NPZ."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {str(name): alarms[name].to_numpy() for name in _FRAME_COLUMNS}
    arrays |= {
        "frames": np.array(list(poses), dtype=np.int64),
        "poses": np.array(list(poses.values())).reshape(-1, 6),
    }
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _parse_frames(data: bytes) -> tuple[pd.DataFrame, dict[int, NDArray[np.float64]]]:
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


def _view_bytes(view: xr.DataArray) -> bytes:
    """Return a run-view as NPZ."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {}
    for name in ("y", "x", "looks"):
        arrays[name] = np.asarray(view[name].values)
    for name in ("polarization", "subband"):
        arrays[name] = np.asarray(view[name].values, dtype=str)
    arrays["magnitude"] = view.values.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()
