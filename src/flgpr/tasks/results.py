"""The demonstration, and running a result again: files in, files out."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.detect import detect
from flgpr.chain.progress import Track, silent
from flgpr.chain.sections import noted_section
from flgpr.commands.detect import detect as detect_run
from flgpr.io import open_run, read_manifest, sample_lane
from flgpr.results.description import describe_run
from flgpr.results.result import Result, read_result, write_result
from flgpr.scoring import Score
from flgpr.tasks.scoring import score_result

PathLike = str | Path


def demo(
    output: PathLike, track: Track = silent, overwrite: bool = True
) -> tuple[Result, list[Score]]:
    """Detect on the packaged lane, then score it; a place where something that is no result lies is refused.

    So is another result without ``overwrite``, and that of the packaged lane then stays.
    """
    lane = sample_lane()
    detect_run(
        lane / "run.zarr",
        "demo",
        output,
        section=math.inf,
        overwrite=overwrite,
        report=False,
        track=track,
    )
    return score_result(
        output, lane / "truth.csv", lane / "objects.csv", track=track, overwrite=overwrite
    )


def replay(
    folder: PathLike, run: PathLike | None = None, track: Track = silent, tolerance: float = 1e-3
) -> dict[str, Any]:
    """Run a result's recipe again, with the model the result holds, and compare.

    ``run`` is its store, by default where the result says; ``tolerance`` the largest relative L2 difference of a
    run-view that still counts as agreement, for another machine or version. It tells ``identical``: whether every file
    has the same bytes; ``agrees``: whether the alarms stand at the same places in the same order and the run-views
    agree; ``files`` that differ; and ``difference``, the largest of the run-views'. A run that is not the result's is a
    ValueError.
    """
    old = read_result(folder)
    described = old.manifest["run"]
    dataset = open_run(run if run is not None else described["path"])
    now = describe_run(dataset, run if run is not None else described["path"], old.recipe.motion)
    if now["store_sha256"] != described["store_sha256"]:
        raise ValueError(
            f"run must be the one the result was made of ({described['store_sha256'][:12]}…), got {run}"
        )
    if "others" in described:
        now["others"] = described["others"]
    model = old.model()
    others = _others(described.get("others", {}))
    told = old.manifest.get("section")
    lane, section = (old.lane, None) if told is None else noted_section(told)
    detections = detect(dataset, old.recipe, lane, track, model, section, others)
    with TemporaryDirectory() as temporary:
        home = write_result(
            Path(temporary) / "result", detections, old.recipe_text, old.lane, now, model, told
        )
        new = read_result(home)
    files = new.manifest["files"]
    before = old.manifest["files"]
    differ = sorted(
        name for name in before.keys() | files.keys() if before.get(name) != files.get(name)
    )
    pairs = list(zip(old.detections, new.detections, strict=True))
    difference = max(_difference(a.view.values, b.view.values) for a, b in pairs)
    places = all(a.alarms[["x", "y"]].equals(b.alarms[["x", "y"]]) for a, b in pairs)
    return {
        "identical": not differ,
        "agrees": places and difference <= tolerance,
        "files": differ,
        "difference": difference,
    }


def _others(told: dict[str, Any]) -> dict[str, xr.Dataset]:
    """Open the runs that were taken together with a result's."""
    for name, one in told.items():
        if read_manifest(one["path"])["sha256"] != one["store_sha256"]:
            raise ValueError(
                f"run {name} must be the one the result was made with, got another at {one['path']}"
            )
    return {name: open_run(one["path"]) for name, one in told.items()}


def _difference(old: NDArray[np.float32], new: NDArray[np.float32]) -> float:
    if old.shape != new.shape or not np.array_equal(np.isnan(old), np.isnan(new)):
        return float("inf")
    return float(np.linalg.norm(np.nan_to_num(new - old)) / np.linalg.norm(np.nan_to_num(old)))
