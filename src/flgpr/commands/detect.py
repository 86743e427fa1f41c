"""``flgpr detect``: raise alarms on runs.

Runs and options become jobs. What is computed stands in ``method/method.py``; how it is divided
among threads, processes and sections, in ``jobs/driver.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Concatenate, ParamSpec, Protocol, cast, overload

from typer import Option

from flgpr.commands.options import (
    LANE,
    REQUIRED,
    LanesLike,
    OptionalOutput,
    Overwrite,
    PathLike,
    Paths,
    Progress,
    RunLike,
    RunsLike,
    Scheduler,
    ShellType,
    With,
    one_or_more,
    runs_by_name,
)
from flgpr.commands.runs import RunLocations, is_in_memory, run_options
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.results.result import Result, Survey
    from flgpr.types import Entries

TRAINED_ON_THIS_RUN = (
    "the model was trained on this very run: what it finds here says nothing of other ground"
)


_TRUST = ("unlike", "far", "stands_out")  # what a result says of its alarms


def _before(call: Arguments) -> Iterator[str]:
    """Yield which recipe is used where none is named."""
    if call.recipe is None:
        yield f"no --recipe: detecting with the one that `flgpr recipe for {call.runs[0]}` prints"


def _results(returned: Result | Survey) -> list[Result]:
    """Return the results of all lanes; a lane in sections counts as one result a section."""
    from flgpr.results.result import Result, read_result
    from flgpr.results.sections import results_at

    if isinstance(returned, Result) and results_at(returned.folder) == [returned.folder]:
        return [returned]
    lane_folders = [returned.folder] if isinstance(returned, Result) else returned.folders
    results = []
    for lane_folder in lane_folders:
        for folder in results_at(lane_folder):
            results.append(read_result(folder))
    return results


def _lines(returned: Result | Survey, call: Arguments) -> Iterator[str]:
    """Yield what is printed of one lane or several."""
    results = _results(returned)
    for result in results:
        yield from _lines_of_result(result)
    if len(call.runs) == 1 and len(results) > 1:
        table = (Path(call.output) / "alarms.csv").resolve()
        yield f"the lane was processed in {len(results)} sections; all alarms: {table}"


def _lines_of_result(result: Result) -> Iterator[str]:
    """Yield scans left out, notes on motion, and the number of alarms with the report."""
    run = result.manifest["run"]
    masked_scans = run["masked_scans"]
    if masked_scans:
        left_out = f"{len(masked_scans)} of {run['scans']} scans"
        yield f"{left_out} left out for missing sweeps: {masked_scans}"
    yield from run.get("motion", {}).get("notes", [])
    for finding in run.get("health", []):
        yield finding["sentence"]
    if "health" in run:
        yield f"`flgpr check {run['path']}` says what else may be wrong, and what to try"
    for name in ("searched", *_TRUST):
        if name == "unlike":
            if run.get("trained_on_this_run"):
                yield TRAINED_ON_THIS_RUN
            if "another_array" in run:
                yield run["another_array"]
        yield from run.get(name, {}).get("notes", [])
    page = (result.folder / "report.html").resolve()
    alarms = result.alarms
    outside = int((~result.lane.contains(alarms["x"], alarms["y"])).sum())
    beside = f", {outside} of them beside the lane" if outside else ""
    yield f"{len(alarms)} alarms{beside}; report: {page}"


def _as_json(returned: Result | Survey, call: Arguments) -> Any:
    """Return the summary of a lane in one piece, else a list of summaries."""
    summaries = [_summary(result) for result in _results(returned)]
    return summaries if len(call.runs) > 1 or len(summaries) > 1 else summaries[0]


def _summary(result: Result) -> Entries:
    """Return number of alarms, scans left out, and folder of a result."""
    run = result.manifest["run"]
    summary = {
        "alarms": len(result.alarms),
        "masked_scans": run["masked_scans"],
        "implausible_scans": run.get("motion", {}).get("scans", []),
        "searched": run.get("searched", {}),
        "trained_on_this_run": bool(run.get("trained_on_this_run", False)),
        **{name: run.get(name, {}) for name in _TRUST},
        "result": str(result.folder),
    }
    if "health" in run:
        summary["health"] = run["health"]
    return summary


def _one_run(call: Arguments) -> Entries:
    """Return the run alone where the command line names one: a list is a survey."""
    return {"runs": call.runs[0]} if len(call.runs) == 1 else {}


P = ParamSpec("P")


class OneOrList(Protocol[P]):
    """What ``detect`` returns of one run and of a list of runs, for type checkers."""

    @overload
    def __call__(self, runs: RunLike, *args: P.args, **kwargs: P.kwargs) -> Result: ...  # type: ignore[overload-overlap]
    @overload
    def __call__(self, runs: Sequence[RunLike], *args: P.args, **kwargs: P.kwargs) -> Survey: ...


def _typed(function: Callable[Concatenate[Any, P], Any]) -> OneOrList[P]:
    """Return a function of one run or a list of runs with both of its types."""
    return cast("OneOrList[P]", function)


@_typed
@command(
    lines=_lines,
    as_json=_as_json,
    lines_before=_before,
    python_values=_one_run,
    resumes=True,
    compiles_kernels=True,
)
def detect(
    runs: RunsLike,
    recipe: Annotated[PathLike | None, ShellType(str)] = None,
    output: Annotated[OptionalOutput, REQUIRED] = None,
    lane: Annotated[LanesLike | None, LANE] = None,
    model: PathLike | None = None,
    workers: Annotated[int | None, Option(min=1)] = None,
    scheduler: Scheduler = None,
    lanes_at_once: Annotated[int | None, Option(min=1)] = None,
    max_memory: str | int = "2GB",
    section: float | None = None,
    before: Paths | None = None,
    others: With = (),
    unlike: str = "fallback",
    far: float | None = None,
    overwrite: Overwrite = True,
    *,
    report: bool = True,
    track: Progress = None,
    note: Any = None,
    pass_cache: PathLike | None = None,
) -> Result | Survey:
    """Raise alarms on runs; truth is not needed and not read. An interrupted run resumes.

    Several runs give OUTPUT/NAME each and survey.json; sections of a lane lie in section-01 and on.

    Parameters
    ----------
    runs
        Run stores; several make a survey.
    report
        Whether to write report.html now; scoring writes it anew.
    note
        Takes a report of every piece of work that was done.
    pass_cache
        Folder of backgrounds and run-views that other recipes share.
    output
        result folder; a folder of them for several runs

    Recipe and lane
    ---------------
    recipe
        Packaged recipe or TOML file; else one is made for the run.
    model
        Model of `flgpr train` for the recipe.
    lane
        once per run
    before
        Earlier run of the same road, of a single run; once per run. What they predict is
        subtracted: what has changed stands out.
    others

    Trust
    -----
    unlike
        On ground unlike the model's training: rank by contrast (fallback), keep, or refuse.
    far
        False alarms per m² to state a threshold for; alarms above it are marked.

    Work
    ----
    workers
        Processes; the result is the same.
    scheduler
    lanes_at_once
        Lanes at the same time; needs workers or a scheduler.
    max_memory
        Memory of each process; larger lanes are processed in sections.
    section
        Longest section of a lane, m, for recipes without variants.

    Returns
    -------
    Result or Survey
        Of one run its result, of a list a survey. Without an output it lives as long as the object.

    Raises
    ------
    ValueError
        If a recipe does not fit a run or its ground, or an option breaks its rule.
    FileExistsError
        If something that is no result is there, or a result that is not to be overwritten.
    """
    from flgpr.jobs.driver import detect_lane
    from flgpr.jobs.job import LaneJob, make_job
    from flgpr.jobs.survey import detect_survey, lane_names
    from flgpr.method.unlike import Trust
    from flgpr.recipe.make import recipe_or_fitted
    from flgpr.results.result import Survey
    from flgpr.stages.earlier import before_names

    run_list = one_or_more(runs)
    is_one = isinstance(runs, str) or not isinstance(runs, Sequence)
    lanes = one_or_more(lane) or [None] * len(run_list)
    options = run_options(workers, scheduler, max_memory, track, note, pass_cache)
    other_runs = runs_by_name(others, len(run_list))
    if not run_list:
        raise ValueError("runs must hold at least one run, got none")
    if len(lanes) != len(run_list):
        counted = "1 run" if len(run_list) == 1 else f"{len(run_list)} runs"
        raise ValueError(f"lane must be given once per run, got {len(lanes)} for {counted}")

    def job_of(number: int, run: PathLike, text: str, to: Path, beside: Any) -> LaneJob:
        """Return the job of a run, by its number, whose result goes into a folder."""
        return make_job(
            run,
            text,
            lanes[number],
            to,
            report,
            model=model,
            others=beside,
            options=options,
            trust=Trust(unlike, far),
        )

    earlier = one_or_more(before)
    if earlier and not is_one:
        raise ValueError(f"before must be given for a single run, got {len(run_list)} runs")
    if is_one:
        beside_it = other_runs[0] | dict(zip(before_names(len(earlier)), earlier, strict=True))
        with RunLocations(run_list[0], output, beside_it) as place:
            text = recipe_or_fitted(recipe, place.run, model, options.max_memory, bool(earlier))
            job = job_of(0, place.run, text, place.output, place.other_runs)
            with options.executor() as executor:
                detect_lane(job, executor, options, section, overwrite)
            return place.result()

    if output is None:
        raise ValueError(f"output must be given for a list of runs, got none for {len(run_list)}")
    if any(is_in_memory(run) for run in run_list):
        raise ValueError("runs of a survey must be stored, got one in memory: give each alone")
    survey = Path(output)
    names = lane_names(run_list)  # refuses runs of one name before a recipe is made
    text = recipe_or_fitted(recipe, run_list[0], model, options.max_memory)
    jobs = (
        job_of(number, run_list[number], text, survey / name, other_runs[number])
        for number, name in enumerate(names)
    )
    folders = detect_survey(jobs, survey, section, lanes_at_once, options, overwrite)
    return Survey(survey, folders)
