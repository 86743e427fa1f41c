"""What the command line does, as functions: files in, files out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.calibrate import channel_health, health_summary
from flgpr.imaging import ScanImager
from flgpr.io import (
    MAX_MEMORY,
    import_fullwave,
    open_run,
    read_lane,
    read_manifest,
    read_table,
    sample_lane,
    save_run,
    sha256,
    write_geojson,
    write_table,
    write_whole,
)
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, load_sensor
from flgpr.pipeline.classifier import (
    CLASSIFIER_B,
    Classifier,
    load_classifier,
    make_training_set,
    save_classifier,
    train,
)
from flgpr.pipeline.detect import detect, lane_of
from flgpr.pipeline.figures import geometry_figure, looks_of
from flgpr.pipeline.fullwave import write_gprmax_decks
from flgpr.pipeline.lane_work import make_job
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import load_recipe, parse_recipe, recipe_text
from flgpr.pipeline.report import report_html
from flgpr.pipeline.result import Result, add_files, check_free, describe_run, read_result, write_result
from flgpr.pipeline.score import Score, roc_json, score
from flgpr.pipeline.simulation import preview_figure, simulate_to_store
from flgpr.pipeline.survey import Note, area_of, detect_lane, detect_survey, executor_for, lane_names, unnoted
from flgpr.pipeline.view_score import VIEW_SCORE, view_score
from flgpr.simulate import Scene, load_scene

PathLike = str | Path


def detect_run(
    run: PathLike,
    recipe: PathLike,
    output: PathLike,
    lane: PathLike | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
) -> Result:
    """Detect on a stored run and write a result folder with its report.

    With a recipe that has features this works block by block and can be stopped and gone on with, see
    :func:`flgpr.pipeline.survey.detect_lane`.

    Parameters
    ----------
    run : path
        Run store.
    recipe : str or path
        Name of a packaged recipe, or a TOML file.
    output : path
        Result folder to make.
    lane : path, optional
        TOML with x_min, x_max, y_min, y_max (m) in place of the recipe's lane.
    track : Track
        Shows progress.
    report : bool
        Whether to write ``report.html`` now; scoring writes it anew anyway.
    model : path, optional
        Folder of a trained classifier, for recipes with features.
    workers : int, optional
        Number of processes, for recipes with features; default this one. The result is the same, bit for bit.
    scheduler : str, optional
        Address of a Dask scheduler in place of workers.
    note : callable
        Takes a report of every piece of work that was done.
    max_memory : int
        Memory that each process may take, bytes; what would take more is refused before anything is decoded.

    Returns
    -------
    Result
        The result as written.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the output would overwrite something else; nothing is written then.
    """
    text = recipe_text(recipe)
    parsed = parse_recipe(text, str(recipe))
    if parsed.features is not None:
        area = area_of(run, parsed, read_lane(lane) if lane is not None else None, max_memory)
        job = make_job(run, text, area, output, report, model, max_memory)
        with executor_for(workers, scheduler) as executor:
            return read_result(detect_lane(job, executor, track, note))
    if workers is not None or scheduler is not None:
        raise ValueError(f"workers and scheduler need a recipe with the table features, got {recipe}")
    check_free(output)
    dataset = open_run(run, max_memory)
    area = read_lane(lane) if lane is not None else lane_of(dataset, parsed)
    classifier = load_classifier(model) if model is not None else None
    detections = detect(dataset, parsed, area, track, classifier)
    folder = write_result(output, detections, text, area, describe_run(dataset, run))
    result = read_result(folder)
    if report:
        for page in track(["report.html"], "drawing the report", 1):
            add_files(folder, {page: report_html(result)})
    return read_result(folder)


def detect_runs(
    runs: Sequence[PathLike],
    recipe: PathLike,
    output: PathLike,
    lanes: Sequence[PathLike] | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    lanes_at_once: int | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
) -> list[Result]:
    """Detect on many stored runs; goes on where it was stopped.

    Parameters
    ----------
    runs : sequence of path
        Run stores with different names.
    recipe : str or path
        Name of a packaged recipe, or a TOML file.
    output : path
        Folder that takes a result folder per run, named like it, and ``survey.json``.
    lanes : sequence of path, optional
        TOML of each lane, in the same order, in place of the recipe's.
    track, report, model, workers, scheduler, note, max_memory
        As for :func:`detect_run`.
    lanes_at_once : int, optional
        How many lanes are worked on at the same time; more than 1 needs workers or a scheduler.

    Returns
    -------
    list of Result
        The results as written, in the order of the runs.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the output would overwrite something else.
    """
    text = recipe_text(recipe)
    if parse_recipe(text, str(recipe)).features is None:
        names = lane_names(runs)
        areas = [None] * len(runs) if lanes is None else list(lanes)
        if len(areas) != len(runs):
            raise ValueError(f"lanes must be one per run, got {len(areas)} for {len(runs)} runs")
        found = []
        for run, name, area in zip(runs, names, areas, strict=True):
            found.append(detect_run(run, recipe, Path(output) / name, area, track, report, model, workers, scheduler))
        return found
    who = executor_for(workers, scheduler)
    folders = detect_survey(runs, text, output, lanes, model, report, who, lanes_at_once, max_memory, track, note)
    return [read_result(folder) for folder in folders]


def score_result(
    folder: PathLike,
    truth: PathLike,
    objects: PathLike | None = None,
    output: PathLike | None = None,
    track: Track = silent,
) -> tuple[Result, list[Score]]:
    """Score a result folder and write its ROC and report.

    Parameters
    ----------
    folder : path
        Result folder.
    truth : path
        CSV of the targets.
    objects : path, optional
        CSV of what else stands there, for the pictures.
    output : path, optional
        Folder for ``roc.json`` and ``report.html``; default the result folder.
    track : Track
        Shows progress.

    Returns
    -------
    Result, list of Score
        The result and its scores.

    Raises
    ------
    ValueError, FileNotFoundError
        If an input is not valid; nothing is written then.
    """
    result = read_result(folder)
    targets = read_table(truth, "truth")
    others = read_table(objects, "objects") if objects is not None else None
    scored = score(result, targets)
    home = Path(output) if output is not None else result.folder
    home.mkdir(parents=True, exist_ok=True)
    files: dict[str, bytes | str] = {"roc.json": roc_json(scored)}
    files[VIEW_SCORE] = view_score(result, scored, targets, others)
    for page in track(["report.html"], "drawing the report", 1):
        files[page] = report_html(result, scored, targets, others)
    if home.resolve() == result.folder.resolve():
        add_files(home, files)
        return read_result(home), scored
    for name, data in files.items():
        (home / name).parent.mkdir(exist_ok=True)
        write_whole(home / name, data)
    return result, scored


def train_runs(
    runs: Sequence[PathLike],
    truths: Sequence[PathLike],
    recipe: PathLike,
    output: PathLike,
    features: Sequence[str] = CLASSIFIER_B,
    lanes: Sequence[PathLike] | None = None,
    label_radius: float = 1.0,
    track: Track = silent,
) -> Classifier:
    """Train a classifier on stored runs and write it.

    Parameters
    ----------
    runs : sequence of path
        Run stores, one lane each.
    truths : sequence of path
        CSV of the targets of each run, in the same order. Truth is read here and in scoring, nowhere else.
    recipe : str or path
        Name of a packaged recipe with features, or a TOML file.
    output : path
        Folder to make.
    features : sequence of str
        Columns the classifier reads.
    lanes : sequence of path, optional
        TOML of each lane, in the same order, in place of the recipe's.
    label_radius : float
        Alarms this near to a target are its hits, m.
    track : Track
        Shows progress.

    Returns
    -------
    Classifier
        As written.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid; nothing is written then.
    """
    if len(runs) != len(truths) or not runs or (lanes is not None and len(lanes) != len(runs)):
        raise ValueError(f"train needs one truth per run, got {len(runs)} runs and {len(truths)} truths")
    text = recipe_text(recipe)
    parsed = parse_recipe(text, str(recipe))
    if parsed.features is None:
        raise ValueError(f"recipe must have the table features to train, got {recipe}")
    tables = [read_table(truth, "truth") for truth in truths]
    found = []
    for number, (run, truth) in enumerate(zip(runs, tables, strict=True)):
        dataset = open_run(run)
        area = read_lane(lanes[number]) if lanes is not None else lane_of(dataset, parsed)
        detection = detect(dataset, parsed, area, track)[0]
        if detection.features is None:
            raise ValueError(f"recipe must compute features to train, got {recipe}")
        found.append((f"{number + 1}:{Path(run).stem}", detection.alarms, detection.features, truth, area))
    classifier = train(make_training_set(found, label_radius, features), features)
    digests = [read_manifest(run)["sha256"] for run in runs]
    notes = {"recipe": parsed.name, "recipe_sha256": sha256(text.encode()), "runs": digests}
    save_classifier(classifier, output, notes)
    return classifier


def demo(output: PathLike, track: Track = silent) -> tuple[Result, list[Score]]:
    """Detect on the packaged lane, then score it.

    Parameters
    ----------
    output : path
        Result folder to make.
    track : Track
        Shows progress.

    Returns
    -------
    Result, list of Score
        The result and its scores.

    Raises
    ------
    FileExistsError
        If something that is no result lies at the path.
    """
    lane = sample_lane()
    detect_run(lane / "run.zarr", "demo", output, track=track, report=False)
    return score_result(output, lane / "truth.csv", lane / "objects.csv", track=track)


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


def replay(
    folder: PathLike, run: PathLike | None = None, track: Track = silent, tolerance: float = 1e-3
) -> dict[str, Any]:
    """Run a result's recipe again, with the classifier the result holds, and compare.

    Parameters
    ----------
    folder : path
        Result folder.
    run : path, optional
        Run store; default the one the result names.
    track : Track
        Shows progress.
    tolerance : float
        Largest relative L2 difference of a run-view that still counts as agreement, for another machine or version.

    Returns
    -------
    dict
        ``identical``: whether every file has the same bytes; ``agrees``: whether the alarms stand at the same places in
        the same order and the run-views differ by at most ``tolerance``; ``files`` that differ; ``difference``, the
        largest of the run-views' relative differences.

    Raises
    ------
    ValueError, FileNotFoundError
        If the result or the run is not valid, or the run is not the one the result was made of.
    """
    old = read_result(folder)
    described = old.manifest["run"]
    dataset = open_run(run if run is not None else described["path"])
    now = describe_run(dataset, run if run is not None else described["path"])
    if now["store_sha256"] != described["store_sha256"]:
        raise ValueError(f"run must be the one the result was made of ({described['store_sha256'][:12]}…), got {run}")
    text = (old.folder / "recipe.toml").read_text(encoding="utf-8")
    classifier = old.classifier()
    detections = detect(dataset, old.recipe, old.lane, track, classifier)
    with TemporaryDirectory() as temporary:
        home = write_result(Path(temporary) / "result", detections, text, old.lane, now, classifier)
        new = read_result(home)
    files, before = new.manifest["files"], old.manifest["files"]
    differ = sorted(name for name in before.keys() | files.keys() if before.get(name) != files.get(name))
    pairs = list(zip(old.detections, new.detections, strict=True))
    difference = max(_difference(a.view.values, b.view.values) for a, b in pairs)
    places = all(a.alarms[["x", "y"]].equals(b.alarms[["x", "y"]]) for a, b in pairs)
    return {
        "identical": not differ,
        "agrees": places and difference <= tolerance,
        "files": differ,
        "difference": difference,
    }


def _difference(old: NDArray[np.float32], new: NDArray[np.float32]) -> float:
    if old.shape != new.shape or not np.array_equal(np.isnan(old), np.isnan(new)):
        return float("inf")
    return float(np.linalg.norm(np.nan_to_num(new - old)) / np.linalg.norm(np.nan_to_num(old)))


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


def outcome_table(scored: list[Score]) -> pd.DataFrame:
    """Gather what became of each target in every detection.

    Parameters
    ----------
    scored : list of Score
        Scores.

    Returns
    -------
    DataFrame
        One row per detection and target: detection, target_id, kind, detected, rank, n_false, distance.
    """
    columns = ["target_id", "kind", "depth", "detected", "rank", "n_false", "distance"]
    return pd.concat([one.outcomes[columns].assign(detection=one.detection.name) for one in scored], ignore_index=True)
