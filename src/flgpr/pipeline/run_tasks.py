"""Making runs and telling what they hold, as functions: files in, files out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flgpr.calibrate import channel_health, health_summary
from flgpr.imaging import ScanImager
from flgpr.io import import_fullwave, open_run, save_run, write_geojson, write_table
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, load_sensor
from flgpr.pipeline.detect import lane_of
from flgpr.pipeline.figures import geometry_figure, looks_of
from flgpr.pipeline.fullwave import write_gprmax_decks
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import load_recipe
from flgpr.pipeline.result import describe_run
from flgpr.pipeline.simulation import preview_figure, simulate_to_store
from flgpr.simulate import Scene, load_scene

PathLike = str | Path


def simulate_lane(
    scene: PathLike,
    sensor: PathLike,
    seed: int,
    output: PathLike | None,
    preview: PathLike | None = None,
    errors: bool = True,
    track: Track = silent,
    resume: bool = True,
    truth: PathLike | None = None,
) -> list[Path]:
    """Simulate a scene file into a run store, or draw it.

    Parameters
    ----------
    scene : path
        Scene (TOML).
    sensor : str or path
        Sensor preset or TOML file.
    seed : int
        Seed.
    output : path, optional
        Run store to make, see :func:`flgpr.pipeline.simulation.simulate_to_store`.
    preview : path, optional
        PNG to write.
    errors : bool
        Whether the sensor's errors are added.
    track : Track
        Shows progress.
    resume : bool
        Go on with what a stopped call left; otherwise begin again.
    truth : path, optional
        CSV of the truth in place of the one beside the store.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError, FileExistsError
        If an input is not valid or the store exists.
    """
    world, array = load_scene(scene), load_sensor(sensor)
    written = []
    if preview is not None:
        written.append(_write_preview(world, seed, preview))
    if output is not None:
        written += simulate_to_store(world, array, seed, output, errors, track, resume, truth)
    return written


def write_gprmax_lane(
    scene: PathLike,
    sensor: PathLike,
    seed: int,
    output: PathLike | None,
    preview: PathLike | None = None,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
) -> tuple[list[Path], list[str]]:
    """Write a scene file as gprMax input files, or draw it.

    Parameters
    ----------
    scene, sensor, seed, preview
        As in :func:`simulate_lane`.
    output : path, optional
        Folder to make, see :func:`flgpr.pipeline.fullwave.write_gprmax_decks`.
    cells_per_wavelength, max_cells : float
        As there.

    Returns
    -------
    written : list of Path
        What was written.
    lines : list of str
        Size of the model, and what was left out, in words.

    Raises
    ------
    ValueError, FileExistsError
        If an input is not valid or the folder exists.
    """
    world, array = load_scene(scene), load_sensor(sensor)
    written, lines = [], []
    if preview is not None:
        written.append(_write_preview(world, seed, preview))
    if output is not None:
        decks = write_gprmax_decks(world, array, seed, output, cells_per_wavelength, max_cells)
        lines = [*decks.summary, *(f"left out: {one}" for one in decks.omissions)]
        written.append(Path(output))
    return written, lines


def _write_preview(scene: Scene, seed: int, path: PathLike) -> Path:
    preview_figure(scene, seed).savefig(path, dpi=100, format="png", metadata={"Software": None})
    return Path(path)


def run_info(run: PathLike, recipe: PathLike | None = None, plot: PathLike | None = None) -> dict[str, Any]:
    """Tell what a run holds.

    Parameters
    ----------
    run : path
        Run store.
    recipe : str or path, optional
        Recipe whose scan images and lane decide what counts as covered. Without it: the ground from 1 to 5 array
        heights ahead and 1.2 to either side.
    plot : path, optional
        PNG to write: plan, coverage and side view.

    Returns
    -------
    dict
        The run's description (see :func:`flgpr.pipeline.result.describe_run`) and what follows from it: unambiguous
        path, range resolution (m), largest step between tones (Hz), span travelled (m), ``looks`` on a coarse grid.

    Raises
    ------
    ValueError, FileNotFoundError
        If the run or the recipe is not valid.
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
    imager = ScanImager(dataset, grid, {"all": (frequency[0], frequency[-1])})
    looks = looks_of(imager, lane, max((lane.x_max - lane.x_min) / 24, (lane.y_max - lane.y_min) / 400))
    if plot is not None:
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


def import_fullwave_lane(archive: PathLike, output: PathLike) -> list[Path]:
    """Import a full-wave archive: run, and truth and objects if the archive tells.

    Parameters
    ----------
    archive : path
        The .npz archive, see :func:`flgpr.io.import_fullwave`.
    output : path
        Run store to make; ``NAME-truth.csv`` and ``NAME-objects.csv`` are written beside it.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If the archive is not valid or the store exists.
    """
    store = Path(output)
    if store.exists():
        raise FileExistsError(f"output must not exist yet, got {store}")
    lane, written = import_fullwave(archive), [store]
    store.parent.mkdir(parents=True, exist_ok=True)
    for name, table in (("truth", lane.truth), ("objects", lane.objects)):
        if table is not None:
            path = store.with_name(f"{store.stem}-{name}.csv")
            write_table(table, path)
            write_geojson(table, path.with_suffix(".geojson"))
            written.append(path)
    save_run(lane.run, store, resume=True)
    return written
