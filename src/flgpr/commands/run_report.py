"""Reports of what a run or a model holds."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.door import Folder
from flgpr.health.channels import channel_health, health_summary
from flgpr.health.of_run import health_of_run, without
from flgpr.imaging import count_looks
from flgpr.imaging.ground import covered_ground, grid_ahead
from flgpr.model import (
    SPEED_OF_LIGHT,
    Grid,
    Lane,
    aperture_pose,
    complete_scans,
    unambiguous_path,
)
from flgpr.model.motion import judge_run, plausible_run
from flgpr.model.run import REAL, is_real
from flgpr.recipe.fit import fit_faults
from flgpr.recipe.schema import Recipe, lane_of, load_recipe, recipe_names
from flgpr.results.description import describe_run, plausible_poses
from flgpr.store import open_run
from flgpr.store.outputs import write_new
from flgpr.types import Entries, FloatArray, PathLike

_WIDEST = 10.0  # m, largest array that a vehicle carries; assumed
_LOOKED_AT = 8  # scans that tell whether the data are real
_UNIFORM = 1e-3  # of the step between tones, by which uniform tones may differ; assumed
_MAP_COLUMNS = 24  # of the map of looks, unless its rows would be more than these:
_MAP_ROWS = 400


def run_info(
    run: PathLike,
    recipe: PathLike | None = None,
    plot: PathLike | None = None,
    recipes: bool = False,
) -> Entries:
    """Return what a run holds and what follows from it, and draw it if a plot is asked for.

    Parameters
    ----------
    run : path
        Run store.
    recipe : path, optional
        Packaged recipe or TOML. Its images and lane decide what is covered; without one it is the
        ground from 1 to 5 array heights ahead and 1.2 to either side. It is checked against the
        run.
    plot : path, optional
        PNG to write: plan, coverage and side view.
    recipes : bool
        Whether all packaged recipes are checked, too.

    Returns
    -------
    dict
        The description (:func:`flgpr.results.description.describe_run`) with the unambiguous path
        and the range resolution (m), the largest step between tones (Hz), the distance travelled
        (m), ``array_m`` (extent of the antennas across, along and up), ``looks`` on a coarse grid,
        what of ``recipes`` does not fit the run, entry by entry, ``import_notes`` of what an import
        assumed, replaced or left out, and ``warnings`` of what is seldom meant.
        Where the radar or its poses are at fault, ``findings`` lists what is wrong.

    Raises
    ------
    ValueError
        If no scan of the run is complete.
    """
    stored = open_run(run)
    parsed = None if recipe is None else load_recipe(recipe)
    motion_rules = None if parsed is None else parsed.motion
    motion = judge_run(stored, motion_rules)
    description = describe_run(stored, run, motion_rules)
    judged = health_of_run(
        stored, None if parsed is None or parsed.lane is None else parsed.lane.lane()
    )
    whole = plausible_run(stored, motion_rules)
    dataset = plausible_run(without(stored, judged.left_out), motion_rules)

    if not complete_scans(dataset).any():
        count = dataset.sizes["scan"]
        raise ValueError(f"run must have a scan without missing sweeps, got none among {count}")

    poses = plausible_poses(description)
    lane, looks = _coverage(dataset, parsed, poses)
    if plot is not None:
        _write_plot(plot, description, lane, looks)

    checked = [] if recipe is None else [str(recipe)]
    if recipes:
        checked += recipe_names()

    doubts = geometry_doubts(dataset) + motion.notes()
    import_notes = dataset.attrs.get("import_notes", [])
    report = {
        **description,
        **_tone_figures(dataset["frequency"].values),
        **_geometry_figures(description, poses),
        "health": health_summary(channel_health(whole)),
        "lane": {"x": [lane.x_min, lane.x_max], "y": [lane.y_min, lane.y_max]},
        "looks": {
            "mean": float(looks.mean()),
            "most": int(looks.max()),
            "unseen_share": float((looks == 0).mean()),
        },
        "looks_map": looks.values.tolist(),
        "recipes": {name: _recipe_faults(dataset, load_recipe(name)) for name in checked},
        "import_notes": [str(line) for line in import_notes if line not in doubts],
        "warnings": doubts,
    }
    if judged.findings:
        report["findings"] = [finding.as_json() for finding in judged.findings]
    return report


def _tone_figures(frequency: FloatArray) -> Entries:
    """Return what follows from the tones (Hz): range, resolution, and whether they are uniform."""
    steps = np.diff(frequency)
    unambiguous = unambiguous_path(frequency)
    is_uniform = steps.size == 0 or np.ptp(steps) < _UNIFORM * np.median(steps)
    resolution = None
    if steps.size:
        resolution = SPEED_OF_LIGHT / (2 * float(np.ptp(frequency)))
    return {
        "unambiguous_path_m": unambiguous if math.isfinite(unambiguous) else None,
        "uniform_tones": bool(is_uniform),
        "largest_step_hz": float(steps.max(initial=0.0)),
        "range_resolution_m": resolution,
    }


def _geometry_figures(description: Entries, poses: FloatArray) -> Entries:
    """Return distance travelled, distances of scans, extent of the array and its mean height, m."""
    spacing = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    antennas = np.array(description["tx_m"] + description["rx_m"])
    return {
        "travelled_m": float(spacing.sum()),
        "scan_spacing_m": [float(spacing.min()), float(spacing.max())] if spacing.size else None,
        "array_m": np.ptp(antennas, axis=0).tolist(),
        "height_m": float(poses[:, 2].mean() + antennas[:, 2].mean()),
    }


def _coverage(
    run: xr.Dataset, recipe: Recipe | None, poses: FloatArray
) -> tuple[Lane, xr.DataArray]:
    """Return the lane, and how many scans see each cell (y, x) of a coarse grid of it.

    With images of all scans together there is a single look, from the middle of the aperture.
    """
    scan_poses = run["pose"].values[complete_scans(run)]
    farthest = math.inf
    if recipe is None:
        grid = grid_ahead(run, poses)
        lane = covered_ground(grid, scan_poses)
    else:
        grid = recipe.image.grid()
        farthest = recipe.run_view.y_max  # beyond it a detection takes no look
        lane = lane_of(run, recipe)
        if recipe.image.frames == "all":
            scan_poses = aperture_pose(run)[None]

    width = lane.x_max - lane.x_min
    length = lane.y_max - lane.y_min
    cell = max(width / _MAP_COLUMNS, length / _MAP_ROWS)
    coarse = Grid.spanning((lane.x_min, lane.x_max), (lane.y_min, lane.y_max), cell)

    counts = count_looks(scan_poses, grid, coarse.points(), farthest)
    return lane, xr.DataArray(counts, dims=("y", "x"), coords={"y": coarse.y, "x": coarse.x})


def _write_plot(path: PathLike, description: Entries, lane: Lane, looks: xr.DataArray) -> None:
    """Draw plan, coverage and side view as PNG."""
    from flgpr.report import (  # loads Matplotlib, which the text does without
        figure_png,
        geometry_figure,
    )

    margin = 0.1 * (lane.x_max - lane.x_min)
    figure = geometry_figure(description, lane, looks, margin)
    write_new(Path(path), figure_png(figure))


def model_info(folder: PathLike) -> Entries:
    """Return what a model, or the model of a result, holds, without loading it.

    It is the dict of :func:`flgpr.method.model.describe_model`; for a result, ``result`` is its
    folder. A result that was made without a model is a ValueError. ``check`` has sentences about
    what the model finds on simulated lanes, where it was checked.
    """
    # Loads the detectors, which reports of runs do without.
    from flgpr.method.model import MODEL_FILE, describe_model
    from flgpr.method.model_check import check_sentences
    from flgpr.results.result import MODEL

    path = Path(folder)
    if (path / MODEL_FILE).is_file():
        described = describe_model(path)
        check = check_sentences(path)
        return {**described, "check": check} if check else described
    files = Folder(path)
    if not files.has(f"{MODEL}/{MODEL_FILE}"):
        raise ValueError(
            f"{folder}: this result was made without a model: its recipe alone decides; "
            "`flgpr.view` shows what it found"
        )
    return {**describe_model(files.path(MODEL)), "result": str(path)}


def _recipe_faults(run: xr.Dataset, recipe: Recipe) -> list[str]:
    """Return what of a recipe does not fit a run, and then what is doubtful."""
    faults, doubts = fit_faults(run, recipe)
    return faults + doubts


def geometry_doubts(run: xr.Dataset) -> list[str]:
    """Return warnings of real data, antennas too far apart for a vehicle, or not above the ground."""
    antennas = np.concatenate([run["tx_position"].values, run["rx_position"].values])
    warnings = [REAL] if is_real(run["signal"].variable[:_LOOKED_AT].values) else []
    widest = np.ptp(antennas, axis=0).max()
    if widest > _WIDEST:
        warnings.append(
            f"antennas lie up to {widest:.4g} m apart, more than {_WIDEST:g} m: are positions "
            "metres, and relative to the vehicle, not to the Earth?"
        )

    height = float(run["pose"].values[:, 2].mean() + antennas[:, 2].mean())
    if height <= 0 and run.attrs.get("sounding") != "ground-coupled":
        warnings.append(
            f"antennas stand {height:.3g} m above the ground on average: heights of poses and "
            "antennas add up, and count upwards from the ground"
        )
    return warnings
