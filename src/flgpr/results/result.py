"""The result folder.

Alarms and run-views of a run, and the recipe, lane and run that they come from.

The results of a survey: many lanes, each read when it is asked for.
"""

from __future__ import annotations

import html
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import pandas as pd
import xarray as xr

import flgpr
from flgpr.door import Folder, Version, added_versions, listed_files
from flgpr.method.detection import MAIN, Detection
from flgpr.method.model import MODEL_FILE, Detector, Model, as_model, load_model, save_model
from flgpr.model import Lane
from flgpr.model.constants import IMAGE_ATTRS
from flgpr.model.printable import text_bytes
from flgpr.model.run import described
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.results.detection_files import parse_detection, read_detection_files, write_detection
from flgpr.results.manifest import (
    FORMAT,
    MANIFEST,
    VERSION,
    listing,
    read_result_manifest,
    reading,
    sealed_manifest,
)
from flgpr.results.sections import SECTIONS, read_sections, sections_at
from flgpr.results.view_files import plain_json, write_view
from flgpr.store import check_free_folder, sha256, write_whole
from flgpr.store.outputs import atomic_output, locked_folder
from flgpr.types import Entries, PathLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MODEL = "model"
"""Folder of the model inside a result."""
_NOT_CONTENT = ("identity", "added", "added_sizes", "sha256")
_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "zarr", "pandas", "scikit-learn")


@dataclass(frozen=True)
class Result:
    """The content of a result folder."""

    folder: Path
    manifest: Entries  #: version, run, recipe and digests
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

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the run-view of the result's own recipe with its alarms, by default into a new figure."""
        from flgpr.results.notebook_html import draw_detection

        return draw_detection(self.detections[0], self.lane, ax)[1]

    def score(self, truth: str | Path | pd.DataFrame, **options: Any) -> Any:
        """Score the result against truth, as :func:`flgpr.commands.score.score` does."""
        return flgpr.score(self, truth, **options)

    def view(self, **options: Any) -> Any:
        """Show the result in the viewer, as :func:`flgpr.commands.view.view` does."""
        return flgpr.view(self, **options)

    def _repr_html_(self) -> str:
        from flgpr.results.notebook_html import detection_html

        return detection_html(self.detections[0], self.lane, self.manifest["run"]["title"])

    def __repr__(self) -> str:
        return f"result of {self.recipe.name}: {len(self.alarms)} alarms, in {self.folder}"


def write_result(
    folder: PathLike,
    detections: list[Detection],
    recipe_text: str,
    lane: Lane,
    run: Entries,
    model: Model | Detector | None = None,
    section: Entries | None = None,
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
        Which section of a longer lane it is, see :func:`flgpr.method.sections.section_note`.

    Raises
    ------
    FileExistsError
        If anything but an older result lies there.
    """
    folder = check_free(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    learnt = as_model(model)
    border = None
    if learnt.detector is not None and not run.get("unlike", {}).get("substitute"):
        border = learnt.detector.border
    with atomic_output(folder, replace=True) as root:
        root.mkdir()
        entries = []
        for detection in detections:
            home = root if detection.name == MAIN else root / "variants" / detection.name
            home.mkdir(parents=True, exist_ok=True)
            write_detection(home, detection, run.get("georeference"), recipe_text)
            entry = {"name": detection.name, "title": detection.title, "notes": detection.notes}
            entries.append(entry)
        write_view(root, detections, lane, run, parse_recipe(recipe_text), border)
        write_whole(root / "recipe.toml", recipe_text)
        if learnt.detector is not None or learnt.stages:
            save_model(learnt, root / MODEL)
        paths = [path for path in sorted(root.rglob("*")) if path.is_file()]
        names = [path.relative_to(root).as_posix() for path in paths]
        content = plain_json(
            {
                "format": FORMAT,
                "version": VERSION,
                "flgpr": flgpr.__version__,
                "python": platform.python_version(),
                "libraries": {name: version(name) for name in _LIBRARIES},
                "recipe_sha256": sha256(recipe_text.encode()),
                "lane": asdict(lane),
                "run": run,
                "detections": entries,
                **listing(root, names),
            }
        )
        if section is not None:
            content["section"] = section
        write_whole(root / MANIFEST, sealed_manifest(content, {}))  # last: now all is there
    return folder


def check_free(folder: PathLike) -> Path:
    """Return the folder if a result may be written there.

    Raises
    ------
    FileExistsError
        If anything but a result lies there.
    """
    return check_free_folder(folder, (MANIFEST, SECTIONS), "result")


def add_files(folder: PathLike, files: Mapping[str, bytes | str]) -> None:
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
        data[name] = text_bytes(body) if isinstance(body, str) else body
    with locked_folder(folder, wait=True):
        manifest = read_result_manifest(folder)
        for name in data:
            parent = (folder / name).parent
            parent.mkdir(exist_ok=True)
            if parent != folder:
                # Refuses a link, which would lead the file out of the folder.
                Folder(folder).path(parent.relative_to(folder).as_posix())
        content = {name: value for name, value in manifest.items() if name not in _NOT_CONTENT}
        before = added_versions(manifest)
        after: dict[str, list[Version]] = {}
        both: dict[str, list[Version]] = {}
        for name, body in data.items():
            new_version = (sha256(body), len(body))
            after[name] = [new_version]
            both[name] = [*before.get(name, [(None, None)]), new_version]
        write_whole(folder / MANIFEST, sealed_manifest(content, {**before, **both}))
        for name, body in data.items():
            write_whole(folder / name, body)
        write_whole(folder / MANIFEST, sealed_manifest(content, {**before, **after}))


def are_settled(folder: PathLike) -> bool:
    """Return whether every file that was added to a result was written completely."""
    added = read_result_manifest(folder)["added"]
    return all(len(digests) == 1 for digests in added.values())


def read_result(folder: str | Path) -> Result:
    """Read a result folder.

    Raises
    ------
    ResultError
        If a file that it was written with is missing or altered.
    """
    folder = Path(folder)
    manifest = read_result_manifest(folder)
    with reading(folder, MANIFEST):
        files = listed_files(folder, manifest)
        entries = manifest["detections"]
        # Every file is read or checked before any is parsed.
        detection_files = [read_detection_files(files, entry["name"]) for entry in entries]
        text = files.read("recipe.toml").decode("utf-8")
        for name in (files.listed or {}).keys() - files.proven:
            files.check(name)
        detections = []
        for read, entry in zip(detection_files, entries, strict=True):
            detections.append(parse_detection(read, entry))
        recipe = parse_recipe(text, str(folder / "recipe.toml"))
        lane = Lane(**manifest["lane"])
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
    views = [_thinned_view(first.detections[0].view, step)]
    for home in homes[1:]:
        section_view = read_result(home).detections[0].view
        views.append(_thinned_view(section_view, step))
    sections = read_sections(folder)
    joined = replace(
        first.detections[0], alarms=sections.alarms(), view=xr.concat(views, "y"), features=None
    )
    return replace(first, folder=folder, lane=sections.lane(), detections=[joined])


def read_lane_result(folder: PathLike) -> Result:
    """Read the result of a lane; of one that was taken in sections they are joined."""
    sections = sections_at(folder)
    if sections is None:
        return read_result(folder)
    return join_sections(Path(folder), sections.homes)


def thinned(view: xr.DataArray, step: int) -> xr.DataArray:
    """Return a run-view with the largest value of every ``step`` neighbouring rows."""
    if step == 1:
        return view
    rows = np.arange(0, view.sizes["y"], step)
    middle = view["y"].values[np.minimum(rows + step // 2, view.sizes["y"] - 1)]
    values = np.fmax.reduceat(view.values, rows, axis=view.get_axis_num("y"))
    coords = {str(name): view[name].values for name in view.dims}
    coords["y"] = middle
    coarse = xr.DataArray(values, dims=view.dims, coords=coords, name=view.name)
    return described(coarse, IMAGE_ATTRS)


def _thinned_view(view: xr.DataArray, step: int) -> xr.DataArray:
    """Return a thinned run-view, its looks thinned likewise."""
    looks = thinned(view["looks"].reset_coords(drop=True), step)
    return thinned(view, step).assign_coords(looks=looks)


SURVEY = "survey.json"
"""Name of the list of the lanes of a survey."""
_COLUMNS = ("lane", "scans", "area_m2", "alarms", "sections")


class Survey(Sequence[Result]):
    """The results of several lanes, in the order of their runs.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the survey, with ``survey.json``.
    folders : sequence of pathlib.Path
        Result folders of the lanes, or folders of their sections.
    """

    def __init__(self, folder: Path, folders: Sequence[Path]) -> None:
        self.folder = folder
        self.folders = list(folders)

    def __len__(self) -> int:
        return len(self.folders)

    @overload
    def __getitem__(self, number: int) -> Result: ...
    @overload
    def __getitem__(self, number: slice) -> list[Result]: ...
    def __getitem__(self, number: int | slice) -> Result | list[Result]:
        if isinstance(number, slice):
            return [read_lane_result(folder) for folder in self.folders[number]]
        return read_lane_result(self.folders[number])

    def __iter__(self) -> Iterator[Result]:
        return (read_lane_result(folder) for folder in self.folders)

    def lanes(self) -> list[Entries]:
        """Return a row for each lane: run, counts of scans and alarms, searched area (m²)."""
        return list(Folder(self.folder).json(SURVEY))

    def __repr__(self) -> str:
        return f"survey of {len(self)} lanes in {self.folder}"

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in _COLUMNS)
        rows = []
        for lane in self.lanes():
            cells = "".join(f"<td>{html.escape(str(lane[name]))}</td>" for name in _COLUMNS)
            rows.append(f"<tr>{cells}</tr>")
        return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
