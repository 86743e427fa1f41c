"""What a run holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.calibrate import channel_health, health_summary
from flgpr.chain.recipe import lane_of, load_recipe
from flgpr.imaging import count_looks
from flgpr.io import open_run
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, complete_scans
from flgpr.results.description import describe_run

PathLike = str | Path


def run_info(run: PathLike, recipe: PathLike | None = None, plot: PathLike | None = None) -> dict[str, Any]:
    """Tell what a run holds and what follows from it, and perhaps draw it (PNG): plan, coverage and side view.

    Beside the description (:func:`flgpr.results.description.describe_run`) it is the unambiguous path, range resolution
    (m), largest step between tones (Hz), span travelled (m) and ``looks`` on a coarse grid. The recipe's images and
    lane decide what is covered; without one it is the ground from 1 to 5 array heights ahead and 1.2 to either side.
    """
    dataset = open_run(run)
    description = describe_run(dataset, run)
    pose, frequency = np.asarray(description["pose"]), dataset["frequency"].values
    steps = np.diff(frequency)
    spacing = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    if recipe is not None:
        table = load_recipe(recipe)
        grid, lane = table.image.grid(), lane_of(dataset, table)
    else:
        height = float(pose[:, 2].mean())
        grid = Grid.spanning((-1.2 * height, 1.2 * height), (height, 5 * height), height / 20)
        ends = pose[:, 1].min() + height, pose[:, 1].max() + 5 * height
        middle = float(pose[:, 0].mean())
        lane = Lane(middle - 1.2 * height, middle + 1.2 * height, *ends)
    complete = complete_scans(dataset)
    if not complete.any():
        raise ValueError(f"run must have a scan without missing sweeps, got none among {complete.size}")
    spot = max((lane.x_max - lane.x_min) / 24, (lane.y_max - lane.y_min) / 400)
    around = Grid.spanning((lane.x_min, lane.x_max), (lane.y_min, lane.y_max), spot)
    counted = count_looks(pose[complete], grid, around.points())
    looks = xr.DataArray(counted, dims=("y", "x"), coords={"y": around.y, "x": around.x})
    if plot is not None:
        from flgpr.report import geometry_figure  # loads what draws, which words can do without

        figure = geometry_figure(description, lane, looks, 0.1 * (lane.x_max - lane.x_min))
        figure.savefig(plot, dpi=110, format="png", metadata={"Software": None})
    return description | {
        "unambiguous_path_m": SPEED_OF_LIGHT / float(np.median(steps)) if steps.size else None,
        "uniform_tones": bool(steps.size == 0 or np.ptp(steps) < 1e-3 * np.median(steps)),
        "largest_step_hz": float(steps.max(initial=0.0)),
        "range_resolution_m": SPEED_OF_LIGHT / (2 * float(np.ptp(frequency))) if steps.size else None,
        "travelled_m": float(spacing.sum()),
        "scan_spacing_m": [float(spacing.min()), float(spacing.max())] if spacing.size else None,
        "health": health_summary(channel_health(dataset)),
        "lane": {"x": [lane.x_min, lane.x_max], "y": [lane.y_min, lane.y_max]},
        "looks": {"mean": float(looks.mean()), "most": int(looks.max()), "unseen_share": float((looks == 0).mean())},
        "looks_map": looks.values.tolist(),
    }
