"""``flgpr replay``: run a result's recipe again and compare."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.beside import detect_beside
from flgpr.commands.options import PathLike, Progress
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import xarray as xr

    from flgpr.results.result import Result


def _lines(outcome: dict[str, Any], _: Arguments) -> Iterator[str]:
    if outcome["identical"]:
        yield "identical: every file has the same bytes"
        return
    word = "agrees" if outcome["agrees"] else "DIFFERS"
    files = ", ".join(outcome["files"])
    yield f"{word}: run-views differ by {outcome['difference']:.1e}; other bytes in {files}"


def _status(outcome: dict[str, Any]) -> int:
    return 0 if outcome["agrees"] else 1


@command(lines=_lines, as_json=lambda outcome, _: outcome, status=_status, answers=True)
def replay(
    result: Annotated[PathLike, Argument(help="Result folder.")],
    run: Annotated[
        PathLike | None, Option(help="Run store, if it is no longer where the result says.")
    ] = None,
    *,
    track: Progress = None,
    tolerance: Annotated[
        float, "Largest relative L2 difference of run-views that agree, for another machine."
    ] = 1e-3,
) -> dict[str, Any]:
    """Run a result's recipe again and compare; exit status 1 if it does not agree.

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

    from flgpr.chain.method import detect
    from flgpr.chain.progress import silent
    from flgpr.chain.sections import noted_section
    from flgpr.results.description import describe_run
    from flgpr.results.result import read_result, write_result
    from flgpr.store import open_run

    old = read_result(result)
    described = old.manifest["run"]
    store = described["path"] if run is None else run
    dataset = open_run(store)
    now = describe_run(dataset, store, old.recipe.motion)
    if now["store_sha256"] != described["store_sha256"]:
        raise ValueError(
            f"run must be the one the result was made of ({described['store_sha256'][:12]}…), got {run}"
        )
    if "others" in described:
        now["others"] = described["others"]
    model = old.model()
    others = _other_runs(described.get("others", {}))
    note = old.manifest.get("section")
    lane = old.lane
    section = None
    if note is not None:
        lane, section = noted_section(note)
    track = track or silent
    detections = [detect(dataset, old.recipe, lane, track, model, section, others)]
    for beside in old.detections[1:]:
        detections.append(detect_beside(dataset, beside.name, beside.recipe_text, lane, track))
    with TemporaryDirectory() as temporary:
        home = Path(temporary) / "result"
        write_result(home, detections, old.recipe_text, old.lane, now, model, note)
        return _comparison(old, read_result(home), tolerance)


def _comparison(old: Result, new: Result, tolerance: float) -> dict[str, Any]:
    """Compare the files, the alarms and the run-views of two results."""
    before = old.manifest["files"]
    after = new.manifest["files"]
    names = before.keys() | after.keys()
    differ = sorted(name for name in names if before.get(name) != after.get(name))
    difference = 0.0
    same_places = True
    for first, second in zip(old.detections, new.detections, strict=True):
        difference = max(difference, _difference(first.view.values, second.view.values))
        places = first.alarms[["x", "y"]]
        same_places = same_places and places.equals(second.alarms[["x", "y"]])
    return {
        "identical": not differ,
        "agrees": same_places and difference <= tolerance,
        "files": differ,
        "difference": difference,
    }


def _other_runs(described: dict[str, Any]) -> dict[str, xr.Dataset]:
    """Open the runs that were taken together with that of a result."""
    from flgpr.store import open_run, read_manifest

    for name, run in described.items():
        if read_manifest(run["path"])["sha256"] != run["store_sha256"]:
            raise ValueError(
                f"run {name} must be the one the result was made with, got another at {run['path']}"
            )
    return {name: open_run(run["path"]) for name, run in described.items()}


def _difference(old: Any, new: Any) -> float:
    """Return the relative L2 difference of two run-views; infinity where they do not fit."""
    import numpy as np

    if old.shape != new.shape or not np.array_equal(np.isnan(old), np.isnan(new)):
        return float("inf")
    return float(np.linalg.norm(np.nan_to_num(new - old)) / np.linalg.norm(np.nan_to_num(old)))
