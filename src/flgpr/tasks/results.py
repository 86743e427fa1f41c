"""The demonstration, and running a result again: files in, files out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import flgpr
from flgpr.chain.detection import Detection
from flgpr.chain.method import detect
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.chain.recipe_for_run import area_of
from flgpr.chain.sections import noted_section
from flgpr.model import Lane
from flgpr.results.description import describe_run
from flgpr.results.errors import ResultError
from flgpr.results.result import Result, check_free, read_result, write_result
from flgpr.results.sections import SECTIONS
from flgpr.scoring import Score
from flgpr.store import open_run, read_manifest, sample_lane
from flgpr.store.outputs import OVERWRITE, other_output, tell_finished
from flgpr.tasks.scoring import score_result

PathLike = str | Path
BESIDE_DEMO = ("mean-self-signature", "median-self-signature", "roadside-suppressed")
"""Names, after ``demo-``, of the recipes that the demonstration sets beside the recipe demo."""


def demo(
    output: PathLike, track: Track = silent, overwrite: bool = True
) -> tuple[Result, list[Score]]:
    """Detect on the packaged lane by the recipe demo and three beside it, then score all of them.

    A place where something that is no result lies is refused. So is another result without ``overwrite``, and that of
    the packaged lane then stays.
    """
    home = sample_lane()
    folder = check_free(output)
    text = recipe_text("demo")
    beside = {name: recipe_text(f"demo-{name}") for name in BESIDE_DEMO}
    run = open_run(home / "run.zarr")
    recipe = parse_recipe(text)
    described = describe_run(run, home / "run.zarr", recipe.motion)
    if not overwrite and _holds_demo(folder, described, text, beside):
        tell_finished(folder, OVERWRITE)
    else:
        lane = area_of(run, recipe)
        detections = [detect(run, recipe, lane, track)]
        for name, other in beside.items():
            detections.append(_detect_beside(run, name, other, lane, track))
        write_result(folder, detections, text, lane, described)
    return score_result(
        folder, home / "truth.csv", home / "objects.csv", track=track, overwrite=overwrite
    )


def _detect_beside(run: xr.Dataset, name: str, text: str, lane: Lane, track: Track) -> Detection:
    """Detect by a recipe that stands beside a result's own, under a name of its own."""

    def named(items: Any, label: str, total: int) -> Any:
        return track(items, f"{name}: {label}", total)

    found = detect(run, parse_recipe(text), lane, named)
    return replace(found, name=name, recipe_text=text)


def _holds_demo(folder: Path, described: dict[str, Any], text: str, beside: dict[str, str]) -> bool:
    """Return whether the result of the packaged lane is there; another one is a FileExistsError."""
    if not any((folder / name).is_file() for name in ("manifest.json", SECTIONS)):
        return False
    try:
        there = read_result(folder)
    except ResultError:
        raise other_output(folder, f"{OVERWRITE}, or choose another output") from None
    manifest = there.manifest
    recipes = {one.name: one.recipe_text for one in there.detections[1:]}
    same = (
        manifest["flgpr"] == flgpr.__version__
        and manifest["run"].get("store_sha256") == described["store_sha256"]
        and (there.recipe_text, recipes) == (text, beside)
    )
    if not same:
        raise other_output(folder, f"{OVERWRITE}, or choose another output")
    return True


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
    lane = old.lane
    section = None
    if told is not None:
        lane, section = noted_section(told)
    detections = [detect(dataset, old.recipe, lane, track, model, section, others)]
    for beside in old.detections[1:]:
        detections.append(_detect_beside(dataset, beside.name, beside.recipe_text, lane, track))
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
