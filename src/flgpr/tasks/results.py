"""Training, the demonstration, and running a result again: files in, files out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.chain.classifier import (
    CLASSIFIER_B,
    Classifier,
    check_free_model,
    make_training_set,
    save_classifier,
    train,
)
from flgpr.chain.detect import detect
from flgpr.chain.fitting import area_of
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.chain.sections import noted_section
from flgpr.execution.checkpoint import finish
from flgpr.execution.lane_run import features_of_lane
from flgpr.execution.lane_work import make_job
from flgpr.execution.survey import executor_for
from flgpr.io import (
    MAX_MEMORY,
    open_run,
    read_lane,
    read_manifest,
    read_table,
    sample_lane,
    sha256,
)
from flgpr.results.description import describe_run
from flgpr.results.result import Result, read_result, write_result
from flgpr.scoring import Score
from flgpr.tasks.detection import detect_run
from flgpr.tasks.scoring import score_result

PathLike = str | Path


def train_runs(
    runs: Sequence[PathLike],
    truths: Sequence[PathLike],
    recipe: PathLike,
    output: PathLike,
    features: Sequence[str] = CLASSIFIER_B,
    lanes: Sequence[PathLike] | None = None,
    label_radius: float = 1.0,
    track: Track = silent,
    workers: int | None = None,
    scheduler: str | None = None,
    max_memory: int = MAX_MEMORY,
) -> Classifier:
    """Train a classifier on stored runs and write it.

    What is found in the runs is kept beside the output until the classifier is written (``OUTPUT-1.work`` and so on),
    so that a training that was stopped goes on.

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
    track, workers, scheduler, max_memory
        As for ``detect_run``.

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
    found, jobs = [], []
    check_free_model(output).parent.mkdir(parents=True, exist_ok=True)
    with executor_for(workers, scheduler) as executor:
        for number, (run, targets) in enumerate(zip(runs, tables, strict=True)):
            lane = read_lane(lanes[number]) if lanes is not None else None
            area = area_of(open_run(run, max_memory), parsed, lane)
            beside = Path(output).with_name(f"{Path(output).name}-{number + 1}")
            jobs.append(make_job(run, text, area, beside, max_memory=max_memory))
            alarms, table = features_of_lane(jobs[-1], executor, track)
            found.append((f"{number + 1}:{Path(run).stem}", alarms, table, targets, area))
    classifier = train(make_training_set(found, label_radius, features), features)
    digests = [read_manifest(run)["sha256"] for run in runs]
    notes = {"recipe": parsed.name, "recipe_sha256": sha256(text.encode()), "runs": digests}
    save_classifier(classifier, output, notes)
    for job in jobs:
        finish(job.work)
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
    classifier = old.classifier()
    told = old.manifest.get("section")
    lane, section = (old.lane, None) if told is None else noted_section(told)
    detections = detect(dataset, old.recipe, lane, track, classifier, section)
    with TemporaryDirectory() as temporary:
        home = write_result(Path(temporary) / "result", detections, old.recipe_text, old.lane, now, classifier, told)
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
