"""What a run holds."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.calibrate import channel_health, health_summary
from flgpr.chain.recipe import Recipe, lane_of, load_recipe, recipe_names
from flgpr.chain.recipe_fit import fit_faults
from flgpr.door import Folder
from flgpr.imaging import count_looks
from flgpr.imaging.ground import covered_ground, grid_ahead
from flgpr.model import (
    SPEED_OF_LIGHT,
    Grid,
    aperture_pose,
    complete_scans,
    unambiguous_path,
)
from flgpr.model.motion import judge_run, plausible_run
from flgpr.results.description import describe_run, plausible_poses
from flgpr.store import open_run
from flgpr.store.outputs import whole_output

PathLike = str | Path
_WIDEST = 10.0  # m


def run_info(
    run: PathLike,
    recipe: PathLike | None = None,
    plot: PathLike | None = None,
    recipes: bool = False,
) -> dict[str, Any]:
    """Tell what a run holds and what follows from it, and perhaps draw it (PNG): plan, coverage and side view.

    Beside the description (:func:`flgpr.results.description.describe_run`) it is the unambiguous path, range resolution
    (m), largest step between tones (Hz), span travelled (m), ``array_m`` (how far the antennas reach across, along and
    up), ``looks`` on a coarse grid, what of ``recipes`` does not fit the run, entry by entry, ``import_notes`` of what
    an import assumed, replaced or left out, and ``warnings`` of what is seldom meant. The recipe's images and lane
    decide what is covered; without one it is the ground from 1 to 5 array heights ahead and 1.2 to either side. The
    recipe is tried, and with ``recipes`` all packaged ones are.
    """
    dataset = open_run(run)
    table = None if recipe is None else load_recipe(recipe)
    motion = judge_run(dataset, None if table is None else table.motion)
    description = describe_run(dataset, run, None if table is None else table.motion)
    dataset = plausible_run(dataset, None if table is None else table.motion)
    pose = plausible_poses(description)
    frequency = dataset["frequency"].values
    steps = np.diff(frequency)
    unambiguous = unambiguous_path(frequency)
    spacing = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    complete = complete_scans(dataset)
    if not complete.any():
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {complete.size}"
        )
    antennas = np.array(description["tx_m"] + description["rx_m"])
    height = float(pose[:, 2].mean() + antennas[:, 2].mean())
    array = np.ptp(antennas, axis=0)
    if table is not None:
        grid = table.image.grid()
        lane = lane_of(dataset, table)
        seen = (
            aperture_pose(dataset)[None]
            if table.image.frames == "all"
            else dataset["pose"].values[complete]
        )
    else:
        grid = grid_ahead(dataset, pose)
        seen = dataset["pose"].values[complete]
        lane = covered_ground(grid, seen)
    names = ([] if recipe is None else [str(recipe)]) + (recipe_names() if recipes else [])
    spot = max((lane.x_max - lane.x_min) / 24, (lane.y_max - lane.y_min) / 400)
    around = Grid.spanning((lane.x_min, lane.x_max), (lane.y_min, lane.y_max), spot)
    counted = count_looks(seen, grid, around.points())
    looks = xr.DataArray(counted, dims=("y", "x"), coords={"y": around.y, "x": around.x})
    if plot is not None:
        from flgpr.report import figure_png, geometry_figure  # loads what draws

        figure = geometry_figure(description, lane, looks, 0.1 * (lane.x_max - lane.x_min))
        with whole_output(Path(plot)) as made:
            made.write_bytes(figure_png(figure))
    doubts = geometry_doubts(dataset) + motion.notes()
    return description | {
        "unambiguous_path_m": unambiguous if math.isfinite(unambiguous) else None,
        "uniform_tones": bool(steps.size == 0 or np.ptp(steps) < 1e-3 * np.median(steps)),
        "largest_step_hz": float(steps.max(initial=0.0)),
        "range_resolution_m": SPEED_OF_LIGHT / (2 * float(np.ptp(frequency)))
        if steps.size
        else None,
        "travelled_m": float(spacing.sum()),
        "scan_spacing_m": [float(spacing.min()), float(spacing.max())] if spacing.size else None,
        "array_m": array.tolist(),
        "height_m": height,
        "health": health_summary(channel_health(dataset)),
        "lane": {"x": [lane.x_min, lane.x_max], "y": [lane.y_min, lane.y_max]},
        "looks": {
            "mean": float(looks.mean()),
            "most": int(looks.max()),
            "unseen_share": float((looks == 0).mean()),
        },
        "looks_map": looks.values.tolist(),
        "recipes": {name: _faults(dataset, load_recipe(name)) for name in names},
        "import_notes": [
            str(note) for note in dataset.attrs.get("import_notes", []) if note not in doubts
        ],
        "warnings": doubts,
    }


def model_info(folder: PathLike) -> dict[str, Any]:
    """Tell what a model holds without loading it, or what the model of a result does.

    Beside :func:`flgpr.chain.model.describe_model`, of a result ``result`` is its folder.
    """
    from flgpr.chain.model import (
        MODEL_FILE,
        describe_model,
    )  # with what detects, which runs are told of without
    from flgpr.results.result import MODEL

    home = Path(folder)
    if (home / MODEL_FILE).is_file():
        return describe_model(home)
    if not Folder(home).has(f"{MODEL}/{MODEL_FILE}"):
        raise ValueError(
            f"{folder}: this result was made without a model: its recipe alone decides"
        )
    return describe_model(Folder(home).path(MODEL)) | {"result": str(home)}


def _faults(run: xr.Dataset, recipe: Recipe) -> list[str]:
    """Tell what of a recipe does not fit, and what is doubtful."""
    faults, doubts = fit_faults(run, recipe)
    return faults + doubts


def geometry_doubts(run: xr.Dataset) -> list[str]:
    """Warn of antennas that lie wider apart than any vehicle, or do not stand over the ground at the poses."""
    antennas = np.concatenate([run["tx_position"].values, run["rx_position"].values])
    told = []
    array = np.ptp(antennas, axis=0)
    height = float(run["pose"].values[:, 2].mean() + antennas[:, 2].mean())
    if array.max() > _WIDEST:
        told.append(
            f"antennas lie up to {array.max():.4g} m apart, more than {_WIDEST:g} m: are positions metres, and "
            "relative to the vehicle, not to the Earth?"
        )
    if height <= 0 and run.attrs.get("sounding") != "ground-coupled":
        told.append(
            f"antennas stand {height:.3g} m above the ground on average: heights of poses and antennas add up, and "
            "count upwards from the ground"
        )
    return told
