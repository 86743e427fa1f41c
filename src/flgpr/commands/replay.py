"""``flgpr replay``: run a result's recipe again and compare."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import PathLike, Progress
from flgpr.commands.runs import detect_compared
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import xarray as xr

    from flgpr.progress import Track
    from flgpr.results.result import Result
    from flgpr.types import Entries


def _lines(outcome: Entries, _: Arguments) -> Iterator[str]:
    """Yield whether the results are identical, agree, or differ."""
    if outcome["identical"]:
        yield "identical: every file has the same bytes"
        return
    verdict = "agrees" if outcome["agrees"] else "DIFFERS"
    files = ", ".join(outcome["files"])
    yield f"{verdict}: run-views differ by {outcome['difference']:.1e}; other bytes in {files}"


@command(
    lines=_lines,
    as_json=True,
    status=lambda outcome: 0 if outcome["agrees"] else 1,
    always_printed=True,
)
def replay(
    result: PathLike,
    run: PathLike | None = None,
    *,
    track: Progress = None,
    tolerance: float = 1e-3,
) -> dict[str, Any]:
    """Run a result's recipe again and compare; exit status 1 if it does not agree.

    Parameters
    ----------
    result
        Result folder.
    run
        Run store, if it has moved since.
    tolerance
        Largest relative L2 difference of run-views that agree, for another machine.

    Returns
    -------
    dict
        ``identical``: whether every file has the same bytes; ``agrees``: whether the alarms stand
        at the same places in the same order and the run-views agree; ``files`` that differ; and
        ``difference``, the largest of the run-views'.

    Raises
    ------
    ValueError
        If the run is not the one that the result was made of.
    """
    from tempfile import TemporaryDirectory

    from flgpr.progress import silent
    from flgpr.results.description import describe_run, described_store
    from flgpr.results.result import read_result
    from flgpr.store import open_run

    old = read_result(result)
    recorded = old.manifest["run"]
    recorded_path, digest = described_store(recorded)
    store = recorded_path if run is None else run
    dataset = open_run(store)
    description = describe_run(dataset, store, old.recipe.motion)
    if description["store_sha256"] != digest:
        raise ValueError(
            f"run must be the one the result was made of ({digest[:12]}…), got {store}"
        )

    for name in ("others", "health", "left_out"):
        if name in recorded:
            description[name] = recorded[name]

    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "result"
        _detect_again(old, dataset, description, folder, track or silent)
        return _comparison(old, read_result(folder), tolerance)


def _detect_again(
    old: Result, run: xr.Dataset, description: Entries, folder: Path, track: Track
) -> None:
    """Detect by the recipes of a result and write the new result."""
    from flgpr.health.judging import LeftOut
    from flgpr.health.of_run import without
    from flgpr.jobs.pieces import with_recipes
    from flgpr.method.imaged_run import ImagedRun
    from flgpr.method.instead import describe_trust
    from flgpr.method.method import detections_of, engine_of
    from flgpr.method.sections import noted_section
    from flgpr.method.unlike import Trust
    from flgpr.recipe.fit import area_of
    from flgpr.results.description import described_store
    from flgpr.results.result import write_result
    from flgpr.store import open_run, read_manifest

    model = old.model()
    other_runs = {}
    for name, other in description.get("others", {}).items():
        store, digest = described_store(other)
        if read_manifest(store)["sha256"] != digest:
            raise ValueError(
                f"run {name} must be the one the result was made with, got another at {store}"
            )
        other_runs[name] = without(open_run(store), LeftOut.recorded(other))

    section_note = old.manifest.get("section")
    # A section is part of a lane: its note states the lane, its rows and the threshold of all.
    lane = old.lane
    section = None
    if section_note is not None:
        lane, section = noted_section(section_note)

    recorded = old.manifest["run"]
    far = recorded.get("far", {}).get("rate")
    trust = Trust(recorded.get("unlike", {}).get("choice", "fallback"), far)
    used = without(run, LeftOut.recorded(description))
    area = area_of(used, old.recipe, lane)
    setup = ImagedRun(
        used, old.recipe, area, model, section=section, others=other_runs, trust=trust
    )
    engine_of(setup).run(track)
    detections = with_recipes(detections_of(setup), old.recipe_text)
    description |= describe_trust(setup, detections)
    made = {detection.name for detection in detections}
    for compared in old.detections[1:]:
        if compared.name not in made:
            detections.append(
                detect_compared(run, compared.name, compared.recipe_text, lane, track)
            )
    write_result(folder, detections, old.recipe_text, old.lane, description, model, section_note)


def _comparison(old: Result, new: Result, tolerance: float) -> Entries:
    """Compare the files, the alarms and the run-views of two results."""
    old_files = old.manifest["files"]
    new_files = new.manifest["files"]
    names = old_files.keys() | new_files.keys()
    differing = sorted(name for name in names if old_files.get(name) != new_files.get(name))

    difference = 0.0
    same_positions = True
    for first, second in zip(old.detections, new.detections, strict=True):
        difference = max(difference, _difference(first.view.values, second.view.values))
        old_positions = first.alarms[["x", "y"]]
        new_positions = second.alarms[["x", "y"]]
        same_positions &= old_positions.equals(new_positions)
    return {
        "identical": not differing,
        "agrees": same_positions and difference <= tolerance,
        "files": differing,
        "difference": difference,
    }


def _difference(old: Any, new: Any) -> float:
    """Return the relative L2 difference of two run-views; infinity where they do not fit."""
    import numpy as np

    # Ground that no scan has seen is NaN, and must be the same ground.
    if old.shape != new.shape or not np.array_equal(np.isnan(old), np.isnan(new)):
        return float("inf")
    change = np.linalg.norm(np.nan_to_num(new - old))
    size = np.linalg.norm(np.nan_to_num(old))
    return float(change / size)
