"""``flgpr detect``: raise alarms on runs."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import (
    REQUIRED,
    OneOrMorePaths,
    Overwrite,
    PathLike,
    Progress,
    RunsLike,
    Scheduler,
    ShellType,
    With,
    one_or_more,
    runs_by_name,
)
from flgpr.commands.run_options import run_options
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.execution.survey import RunOptions
    from flgpr.results.result import Result
    from flgpr.results.survey import Survey


def _before(call: Arguments) -> Iterator[str]:
    if call.recipe is None:
        yield f"no --recipe: detecting with the one that `flgpr recipe for {call.runs[0]}` prints"


def _results(returned: Result | Survey) -> list[Result]:
    """Return the results of lanes, each of a lane in sections as the results of its sections."""
    from flgpr.execution.finished import results_at
    from flgpr.results.result import Result, read_result

    if isinstance(returned, Result) and results_at(returned.folder) == [returned.folder]:
        return [returned]
    folders = [returned.folder] if isinstance(returned, Result) else returned.folders
    results = []
    for folder in folders:
        results += [read_result(home) for home in results_at(folder)]
    return results


def _lines(returned: Result | Survey, call: Arguments) -> Iterator[str]:
    results = _results(returned)
    for result in results:
        yield from _lines_of(result)
    if len(call.runs) == 1 and len(results) > 1:
        table = (Path(call.output) / "alarms.csv").resolve()
        yield f"the lane was taken in {len(results)} sections; all alarms: {table}"


def _lines_of(result: Result) -> Iterator[str]:
    run = result.manifest["run"]
    masked = run["masked_scans"]
    if masked:
        yield f"{len(masked)} of {run['scans']} scans left out for missing sweeps: {masked}"
    yield from run.get("motion", {}).get("notes", [])
    page = (result.folder / "report.html").resolve()
    yield f"{len(result.detections[0].alarms)} alarms; report: {page}"


def _as_json(returned: Result | Survey, call: Arguments) -> Any:
    summaries = [_summary(result) for result in _results(returned)]
    several = len(call.runs) > 1 or len(summaries) > 1
    return summaries if several else summaries[0]


def _summary(result: Result) -> dict[str, Any]:
    run = result.manifest["run"]
    return {
        "alarms": len(result.detections[0].alarms),
        "masked_scans": run["masked_scans"],
        "implausible_scans": run.get("motion", {}).get("scans", []),
        "result": str(result.folder),
    }


@command(lines=_lines, as_json=_as_json, before=_before, compiles=True)
def detect(
    runs: Annotated[RunsLike, Argument(help="Run stores; several make a survey.")],
    recipe: Annotated[
        PathLike | None,
        Option(help="Packaged recipe or TOML file; else one is made for the run."),
        ShellType(str),
    ] = None,
    output: Annotated[
        PathLike | None, Option("-o", "--output", help="What to write."), REQUIRED
    ] = None,
    lane: Annotated[
        OneOrMorePaths | None,
        Option(help="TOML with x_min, x_max, y_min, y_max, m; once per run."),
    ] = None,
    model: Annotated[
        PathLike | None, Option(help="What `flgpr train` made for the recipe.")
    ] = None,
    workers: Annotated[int | None, Option(help="Processes; the result is the same.", min=1)] = None,
    scheduler: Scheduler = None,
    lanes_at_once: Annotated[
        int | None, Option(help="Lanes at the same time; needs workers or a scheduler.", min=1)
    ] = None,
    max_memory: Annotated[
        str | int, Option(help="Memory of each process; larger lanes are taken in sections.")
    ] = "2GB",
    section: Annotated[
        float | None, Option(help="Longest section of a lane, m, for recipes without variants.")
    ] = None,
    others: With = (),
    overwrite: Overwrite = True,
    *,
    report: Annotated[bool, "Whether to write report.html now; scoring writes it anew."] = True,
    track: Progress = None,
    note: Annotated[Any, "Takes a report of every piece of work that was done."] = None,
    pass_cache: Annotated[
        PathLike | None, "Folder of backgrounds and run-views that other recipes share."
    ] = None,
) -> Result | Survey:
    """Raise alarms on runs; truth is not needed and not read. An interrupted run resumes.

    One run gives the result folder OUTPUT, several give OUTPUT/NAME each and OUTPUT/survey.json. A lane in sections
    has a result folder for each of them, section-01 and so on, and a table of all alarms.

    Returns
    -------
    Result or Survey
        Of one run its result, that of a lane in sections read as one; of several a survey, which
        reads the result of each when it is asked for. Without an output the result lies in a
        temporary folder that lives as long as the object.

    Raises
    ------
    ValueError
        If a recipe does not fit a run, or an option breaks its rule; nothing is written then.
    FileExistsError
        If another result is there, and it is not to be overwritten, or something that is no result.
    """
    from flgpr.execution.survey import detect_survey, lane_names
    from flgpr.results.survey import Survey

    listed = one_or_more(runs)
    lanes = one_or_more(lane) or None
    how = run_options(workers, scheduler, max_memory, track, note, pass_cache)
    by_run = runs_by_name(others, len(listed))
    if not listed:
        raise ValueError("runs must hold at least one run, got none")
    if len(listed) == 1:
        if lanes is not None and len(lanes) > 1:
            raise ValueError(f"lane must be one per run, got {len(lanes)} for 1 run")
        one_lane = None if lanes is None else lanes[0]
        with _Places(listed[0], output, by_run[0]) as places:
            _detect_one(places, recipe, one_lane, model, section, report, how, overwrite)
            return places.result()
    if output is None:
        raise ValueError(f"output must be given for several runs, got none for {len(listed)}")
    if any(_is_in_memory(run) for run in listed):
        raise ValueError("runs of a survey must be stored, got one in memory: give each alone")
    lane_names(listed)  # refuses runs of one name before a recipe is made
    text = _recipe_of_survey(listed, recipe, lanes, model, how)
    folders = detect_survey(
        listed, text, output, lanes, model, section, by_run, report, lanes_at_once, how, overwrite
    )
    return Survey(Path(output), folders)


def _detect_one(
    places: _Places,
    recipe: PathLike | None,
    lane: PathLike | None,
    model: PathLike | None,
    section: float | None,
    report: bool,
    how: RunOptions,
    overwrite: bool,
) -> None:
    """Detect on one stored run, in one piece or in sections."""
    from flgpr.chain.recipe import parse_recipe
    from flgpr.chain.recipe_fit import area_of
    from flgpr.execution.driver import detect_lane
    from flgpr.execution.job import make_job
    from flgpr.store import open_run, read_lane

    text = _recipe_text(recipe, places.run, model, how)
    parsed = parse_recipe(text, str(recipe))
    given = None if lane is None else read_lane(lane)
    area = area_of(open_run(places.run, how.max_memory), parsed, given)
    job = make_job(
        places.run, text, area, places.output, report, model, how.max_memory, places.others,
        pass_cache=how.pass_cache,
    )  # fmt: skip
    with how.executor() as executor:
        detect_lane(job, executor, how.track, how.note, section, overwrite)


def _recipe_text(
    recipe: PathLike | None, run: PathLike, model: PathLike | None, how: RunOptions
) -> str:
    """Return the text of a recipe, or of the one that is made for a run."""
    from flgpr.chain.recipe import recipe_text
    from flgpr.chain.recipe_for_run import recipe_for

    if recipe is not None:
        return recipe_text(recipe)
    if model is not None:
        raise ValueError("recipe must be given with a model: the one it was trained with, got none")
    return recipe_for(run, max_memory=how.max_memory)


def _recipe_of_survey(
    runs: Sequence[PathLike],
    recipe: PathLike | None,
    lanes: Sequence[PathLike] | None,
    model: PathLike | None,
    how: RunOptions,
) -> str:
    """Return the text of the recipe of all runs; one made for the first run may not fix its lane."""
    from flgpr.chain.recipe import parse_recipe

    text = _recipe_text(recipe, runs[0], model, how)
    if recipe is None and lanes is None and parse_recipe(text).lane is not None:
        raise ValueError(
            f"lanes must be given or a recipe: {runs[0]} is so short that its own recipe has its lane"
        )
    return text


def _is_in_memory(run: Any) -> bool:
    return not isinstance(run, str | Path)


class _Places:
    """Where a run and its result lie; what is in memory is stored in a temporary folder.

    The folder lives as long as the result that :meth:`result` returns.
    """

    def __init__(self, run: Any, output: PathLike | None, others: Mapping[str, Any]) -> None:
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self.run: Path = self._stored(run, "run")
        self.others = {name: self._stored(other, name) for name, other in others.items()}
        self.output = self._folder() / "result" if output is None else Path(output)
        self._keeps_folder = output is None

    def __enter__(self) -> _Places:
        return self

    def __exit__(self, *_: object) -> None:
        if self._temporary is not None and not self._keeps_folder:
            self._temporary.cleanup()

    def result(self) -> Result:
        """Read the result that was made."""
        from flgpr.results.result import read_lane_result

        result = read_lane_result(self.output)
        if self._temporary is not None:
            weakref.finalize(result, self._temporary.cleanup)
        return result

    def _folder(self) -> Path:
        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="flgpr-")
        return Path(self._temporary.name)

    def _stored(self, run: Any, name: str) -> Path:
        """Return the store of a run; one in memory is saved."""
        if not _is_in_memory(run):
            return Path(run)
        from flgpr.store import save_run

        store = self._folder() / f"{name}.zarr"
        save_run(run, store)
        return store
