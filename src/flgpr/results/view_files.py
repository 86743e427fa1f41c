"""The files that the viewer shows, written with the result: the viewer itself only reads.

``view/index.json`` lists all; ``view/layers/*.f16`` hold one run-view channel at one level each;
and ``view/evidence/*.f16`` hold what explains the alarms. All numbers in ``.f16`` files are
little-endian half floats in dB.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.door import Folder
from flgpr.json_text import compact_json
from flgpr.method.detection import MAIN, Detection
from flgpr.method.evidence import Evidence
from flgpr.method.look_samples import decibels
from flgpr.model import Lane
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.results.description import left_out_scans
from flgpr.store import write_whole
from flgpr.store.view_format import VIEW_FORMAT, VIEW_VERSION, check_view_index
from flgpr.types import Entries, FloatArray, floats

TILE_ROWS = 512
EARLIER = "earlier"
"""Name of the layers of an earlier drive."""
_ALARM_COLUMNS = ("alarm_id", "x", "y", "confidence")
_PERCENTILES = ("1", "50", "99", "99.9", "100")


def write_view(
    folder: Path,
    detections: Sequence[Detection],
    lane: Lane,
    run: Mapping[str, Any],
    recipe: Recipe,
    border: float | None = None,
) -> None:
    """Write the viewer's files to ``folder/view``.

    Parameters
    ----------
    folder : Path
        Result folder.
    detections : sequence of Detection
        That of the recipe first, then those of recipes beside it.
    lane : Lane
        Ground that was searched.
    run : mapping
        Description of the run.
    recipe : Recipe
        What was computed.
    border : float, optional
        Confidence at which a learnt detector decides.

    Raises
    ------
    ValueError
        If the run-views do not share one grid.
    """
    view_folder = folder / "view"
    (view_folder / "layers").mkdir(parents=True)
    (view_folder / "evidence").mkdir()
    views = []
    if detections[0].before is not None:
        stage = "before clutter suppression" if _removes_clutter(recipe) else "as imaged"
        if detections[0].earlier is not None:
            stage = "today"
        views.append(("before", stage, detections[0].before))
    if detections[0].earlier is not None:
        views.append((EARLIER, "earlier drive", detections[0].earlier))
    for detection in detections:
        own = parse_recipe(detection.recipe_text) if detection.recipe_text else recipe
        views.append((detection.name, shown_stage(own), detection.view))
    grid = _grid(views[0][2])
    for name, _, view in views:
        if _grid(view) != grid:
            raise ValueError(
                f"run-views must share one grid, got another in {name!r}: {_grid(view)} and {grid}"
            )
    layers: list[Entries] = []
    for name, stage, view in views:
        layers.extend(_write_layers(view_folder, name, stage, view))
    entries = []
    for detection in detections:
        entries.append(_write_detection(view_folder, detection) | {"border": border})
    channel = detections[0].channel
    if not channel:
        last_view = views[-1][2]
        channel = (last_view["polarization"].values[0], last_view["subband"].values[0])
    pose = floats(run.get("pose", np.zeros((0, 6)))).reshape(-1, 6)
    columns: dict[str, list[Any]] = {}
    for i, name in enumerate(("x", "y", "z", "heading")):
        columns[name] = np.round(pose[:, i], 4).tolist()
    columns["masked"] = left_out_scans(run)
    index = {
        "format": VIEW_FORMAT,
        "version": VIEW_VERSION,
        "title": run.get("title", ""),
        "lane": asdict(lane),
        "grid": grid,
        "tile_rows": TILE_ROWS,
        "unit": "dB",
        "channel": [str(label) for label in channel],
        "layers": layers,
        "scans": columns,
        "sight": [recipe.image.y[0], recipe.run_view.y_max],
        "georeference": run.get("georeference"),
        "detections": entries,
    }
    if "stands_out" in run:
        index["stands_out"] = {name: run["stands_out"][name] for name in ("border", "notes")}
    unlike = run.get("unlike", {}).get("notes", [])
    if unlike:
        index["unlike"] = unlike
    if recipe.image.frames == "all":
        index["aperture"] = True  # what explains alarms is of all scans
    write_whole(view_folder / "index.json", compact_json(plain_json(index)) + "\n")


def read_layer(files: Folder, name: str, channel: xr.DataArray) -> xr.DataArray | None:
    """Return what a layer of a result's view shows, on the pixels of a run-view's channel.

    Parameters
    ----------
    files : Folder
        Files of the result.
    name : str
        Name of the layer: "before" or "earlier".
    channel : (y, x) DataArray
        Run-view, whose ``polarization`` and ``subband`` are those of the layer.

    Returns
    -------
    (y, x) DataArray or None
        Magnitude; None if the result has no such layer.

    Raises
    ------
    ValueError
        If the index cannot be read, or the layer has other pixels.
    """
    if not files.has("view/index.json"):
        return None
    wanted = [name, *(str(channel[label].values) for label in ("polarization", "subband"))]
    for layer in check_view_index(files.json("view/index.json"))["layers"]:
        shows = [layer.get(entry) for entry in ("detection", "polarization", "subband")]
        if shows == wanted and layer["levels"]:
            data = files.read(f"view/{layer['levels'][0]['file']}")
            if len(data) != 2 * channel.size:
                raise ValueError(
                    f"layer {name} must have {2 * channel.size} bytes for {channel.size} pixels, got "
                    f"{len(data)}"
                )
            level = np.frombuffer(data, "<f2").astype(np.float32)
            return channel.copy(data=10 ** (level.reshape(channel.shape) / 20))
    return None


def shown_stage(recipe: Recipe) -> str:
    """Return what a recipe's run-view shows: suppression is named only where clutter is removed."""
    if "clutter.earlier" in recipe.named():
        return "what has changed"
    if recipe.map is not None:
        return f"map by {recipe.map.stage}"
    if _removes_clutter(recipe):
        return "after clutter suppression"
    return "without clutter suppression"


def _removes_clutter(recipe: Recipe) -> bool:
    return bool(recipe.clutter) or recipe.background.self_signature != "none"


def pyramid(level: NDArray[np.float16]) -> Iterable[NDArray[np.float16]]:
    """Yield a run-view at every level down to one tile.

    Each level has half the rows of the one before: two rows become their maximum.
    """
    yield level
    while len(level) > TILE_ROWS:
        if len(level) % 2:
            level = np.concatenate([level, level[-1:]])
        level = np.fmax(level[0::2], level[1::2])
        yield level


def _write_layers(
    folder: Path, detection: str, stage: str, view: xr.DataArray
) -> Iterable[Entries]:
    """Write every channel of a run-view at every level; yield their entries of the index."""
    for p, polarization in enumerate(view["polarization"].values):
        for s, subband in enumerate(view["subband"].values):
            values = decibels(view.sel(polarization=polarization, subband=subband).values)
            files = []
            for number, level in enumerate(pyramid(values)):
                name = f"layers/{detection}.{p}.{s}.{number}.f16"
                write_whole(folder / name, level.astype("<f2").tobytes())
                files.append({"file": name, "rows": len(level)})
            finite = values[np.isfinite(values)].astype(np.float32)
            levels = np.zeros(len(_PERCENTILES))
            if finite.size:
                levels = np.percentile(finite, [float(name) for name in _PERCENTILES])
            yield {
                "detection": detection,
                "stage": stage,
                "polarization": str(polarization),
                "subband": str(subband),
                "percentiles": dict(zip(_PERCENTILES, np.round(levels, 2).tolist(), strict=True)),
                "levels": files,
            }


def _write_detection(folder: Path, detection: Detection) -> Entries:
    """Write what explains a detection's alarms; return its entry of the index."""
    alarms = detection.alarms.reset_index(drop=True)
    features = detection.features
    if features is None:
        other_columns = [name for name in alarms.columns if name not in _ALARM_COLUMNS]
        features = alarms[other_columns].select_dtypes("number")
    contributions = detection.contributions
    training = detection.training
    own_columns = [name for name in alarms.columns if name in _ALARM_COLUMNS]
    entry: Entries = {
        "name": detection.name,
        "title": detection.title,
        "notes": detection.notes,
        "alarms": alarms[own_columns].to_dict("list"),
        "features": _columns(features),
        "contributions": None if contributions is None else _columns(contributions),
        "training": None if training is None else _distribution(training),
        "main": detection.name == MAIN,
    }
    if detection.evidence is not None:
        entry["evidence"] = _write_evidence(folder, detection.name, detection.evidence)
    return entry


def _columns(table: pd.DataFrame) -> dict[str, list[float]]:
    """Return a table of numbers as lists by column."""
    columns = {}
    for name in table.columns:
        columns[str(name)] = [_rounded(value) for value in table[name]]
    return columns


def _rounded(value: float) -> float:
    """Return a number with six significant digits; NaN for an infinite one."""
    return float(f"{value:.6g}") if np.isfinite(value) else float("nan")


def _distribution(training: pd.DataFrame) -> list[Entries]:
    """Return the quantiles of every feature, per value of ``label`` if there is such a column."""
    groups = training.groupby("label") if "label" in training.columns else [("training", training)]
    shares = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
    entries = []
    for label, group in groups:
        quantiles = _columns(group.select_dtypes("number").quantile(shares))
        entries.append(
            {"label": str(label), "count": len(group), "shares": shares, "quantiles": quantiles}
        )
    return entries


def _write_evidence(folder: Path, name: str, evidence: Evidence) -> Entries:
    """Write the images that explain the alarms, one after the other; return their entry."""
    file = f"evidence/{name}.f16"
    data = [block.astype("<f2").tobytes() for block in evidence.blocks]
    write_whole(folder / file, b"".join(data))
    starts = np.cumsum([0, *(block.size for block in evidence.blocks)])
    causes = [_rounded_rows(matrix) for matrix in evidence.causes]
    return {
        "file": file,
        "polarization": evidence.polarization,
        "subband": evidence.subband,
        "patch": asdict(evidence.patch),
        "cut": evidence.cut.tolist(),
        "trace": evidence.trace.tolist(),
        "start": starts.tolist(),
        "scans": evidence.scans,
        "polarimetric": _columns(evidence.polarimetric),
        "adds": evidence.adds,
        "alone": evidence.alone,
        "causes": causes,
    }


def _rounded_rows(matrix: FloatArray) -> list[list[float]]:
    """Return a matrix as rows of numbers with three decimals."""
    rows = []
    for row in np.round(matrix, 3):
        rows.append([_rounded(value) for value in row])
    return rows


def _grid(view: xr.DataArray) -> dict[str, float]:
    """Return the lattice of a run-view: first pixel, number of pixels and spacings, m."""
    y = view["y"].values
    x = view["x"].values
    return {
        "x": round(float(x[0]), 9),
        "y": round(float(y[0]), 9),
        "nx": len(x),
        "ny": len(y),
        "dx": _step(x),
        "dy": _step(y),
    }


def _step(axis: FloatArray) -> float:
    """Return the spacing of an axis, m; 1 m of an axis of one pixel."""
    return round(float(axis[1] - axis[0]), 9) if len(axis) > 1 else 1.0


def plain_json(value: Any) -> Any:
    """Return a value as JSON holds it.

    NaN and infinity become null, arrays become lists, and NumPy numbers become plain ones.
    """
    if isinstance(value, Mapping):
        return {str(key): plain_json(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_json(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, str | int | bool | None):
        return value
    return str(value)
