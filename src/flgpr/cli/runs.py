"""Commands on runs and results: demo, detect, train, info, replay, view."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from flgpr import tasks, viewer
from flgpr.cli.common import (
    Json,
    Output,
    Overwrite,
    Quiet,
    Scheduler,
    plain_errors,
    progress,
    tell_written,
)
from flgpr.cli.show import info_lines, model_lines, print_scores, score_summary

if TYPE_CHECKING:
    from flgpr.tasks import Result

app = typer.Typer()
With = Annotated[
    list[str] | None,
    Option(
        "--with",
        help="NAME=RUN: a run taken together with it, such as a second band; once per name and run.",
    ),
]


def _others(beside: list[str] | None, runs: int) -> list[dict[str, Path]]:
    """Sort NAME=RUN by run: the first of a name belongs to the first run, and so on."""
    named: dict[str, list[Path]] = {}
    for one in beside or []:
        name, equals, path = one.partition("=")
        if not (name and equals and path):
            raise ValueError(f"with must be NAME=RUN, got {one!r}")
        named.setdefault(name, []).append(Path(path))
    for name, paths in named.items():
        if len(paths) != runs:
            raise ValueError(
                f"with must give {name} once per run, got {len(paths)} for {runs} runs"
            )
    return [{name: paths[number] for name, paths in named.items()} for number in range(runs)]


@app.command()
def view(
    paths: Annotated[
        list[Path] | None,
        Argument(
            help="Result, run, recording or score; two results or two scores stand side by side; none with --live."
        ),
    ] = None,
    port: Annotated[int, Option(help="Port; 0 takes a free one.", min=0, max=65535)] = 0,
    host: Annotated[str, Option(help="Address to listen on.")] = "127.0.0.1",
    allow_remote: Annotated[
        bool, Option("--allow-remote", help="Let other machines see it.")
    ] = False,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address only.")] = False,
    live: Annotated[Path | None, Option(help="JSON lines of a live detection to follow.")] = None,
    anchor: Annotated[Path | None, Option(help="TOML that ties the lane to the Earth.")] = None,
    backdrop: Annotated[
        Path | None,
        Option("--map", help="Map or photograph below the lane: GeoTIFF, MBTiles, GeoPackage."),
    ] = None,
    verdicts: Annotated[
        Path | None,
        Option(help="JSON beside the result that keeps an analyst's verdicts and notes."),
    ] = None,
) -> None:
    """Show results in the browser, on this machine; nothing is written but what --verdicts asks for."""
    with plain_errors():
        shown = paths or []
        raw = lambda path: tasks.RawRun(path)  # noqa: E731 - what computes is loaded when it is asked
        viewer.serve(
            shown, host, port, not no_browser, allow_remote, live, None, anchor, typer.echo, raw=raw,
            backdrop=backdrop, verdicts=verdicts, make_map=lambda *given: tasks.map_bytes(*given),
        )  # fmt: skip


@app.command()
def demo(
    output: Output = Path("demo-result"),
    view: Annotated[bool, Option("--view", help="Open the result in the browser.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Process the packaged lane: image, detect, score, report."""
    with plain_errors(quiet), tasks.compiled_beside(), progress(quiet or as_json) as track:
        result, scored = tasks.demo(output, track, overwrite)
    if as_json:
        typer.echo(json.dumps(score_summary(result.folder, scored)))
    elif not quiet:
        print_scores(scored)
        typer.echo(f"report: {(result.folder / 'report.html').resolve()}")
    if view:
        viewer.serve(result.folder, announce=typer.echo, make_map=tasks.map_bytes)


@app.command()
def detect(
    runs: Annotated[list[Path], Argument(help="Run stores; several make a survey.")],
    output: Output,
    recipe: Annotated[
        str | None, Option(help="Packaged recipe or TOML file; else one is made for the run.")
    ] = None,
    lane: Annotated[
        list[Path] | None, Option(help="TOML with x_min, x_max, y_min, y_max, m; once per run.")
    ] = None,
    model: Annotated[Path | None, Option(help="What `flgpr train` made for the recipe.")] = None,
    workers: Annotated[int | None, Option(help="Processes; the result is the same.", min=1)] = None,
    scheduler: Scheduler = None,
    lanes_at_once: Annotated[
        int | None, Option(help="Lanes at the same time; needs workers or a scheduler.", min=1)
    ] = None,
    max_memory: Annotated[
        str, Option(help="Memory of each process; larger lanes are taken in sections.")
    ] = "2GB",
    section: Annotated[float | None, Option(help="Longest section of a lane, m.")] = None,
    beside: With = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Raise alarms on runs; truth is not needed and not read. A run that was stopped is gone on with.

    One run gives the result folder OUTPUT, several give OUTPUT/NAME each and OUTPUT/survey.json. A lane in sections
    has a result folder for each of them, section-01 and so on, and a table of all alarms.
    """
    if recipe is None and not (quiet or as_json):
        typer.echo(f"no --recipe: detecting with the one that `flgpr recipe for {runs[0]}` prints")
    with plain_errors(quiet), tasks.compiled_beside(), progress(quiet or as_json) as track:
        how = tasks.RunOptions(workers, scheduler, tasks.parse_size(max_memory), track)
        others = _others(beside, len(runs))
        if len(runs) > 1:
            options: dict[str, Any] = {
                "lanes_at_once": lanes_at_once,
                "how": how,
                "overwrite": overwrite,
            }
            folders = tasks.detect_runs(
                runs, recipe, output, lane, model, section, others, **options
            )
        elif lane is not None and len(lane) > 1:
            raise ValueError(f"lane must be one per run, got {len(lane)} for 1 run")
        else:
            where = lane[0] if lane else None
            chosen: dict[str, Any] = {"how": how, "overwrite": overwrite}
            folders = tasks.detect_long(
                runs[0], recipe, output, where, model, section, others[0], **chosen
            )
        summaries = [_detected(tasks.read_result(folder), quiet or as_json) for folder in folders]
    if as_json:
        typer.echo(json.dumps(summaries if len(runs) > 1 or len(folders) > 1 else summaries[0]))
    elif not quiet and len(runs) == 1 and len(folders) > 1:
        typer.echo(
            f"the lane was taken in {len(folders)} sections; all alarms: {(output / 'alarms.csv').resolve()}"
        )


def _detected(result: Result, silently: bool) -> dict[str, Any]:
    main = result.detections[0]
    run = result.manifest["run"]
    masked = run["masked_scans"]
    motion = run.get("motion", {"scans": [], "notes": []})
    if not silently:
        if masked:
            typer.echo(
                f"{len(masked)} of {run['scans']} scans left out for missing sweeps: {masked}"
            )
        for note in motion["notes"]:
            typer.echo(note)
        typer.echo(
            f"{len(main.alarms)} alarms; report: {(result.folder / 'report.html').resolve()}"
        )
    left_out = {"masked_scans": masked, "implausible_scans": motion["scans"]}
    return {"alarms": len(main.alarms), **left_out, "result": str(result.folder)}


@app.command()
def train(
    runs: Annotated[list[Path], Argument(help="Run stores, one lane each.")],
    truth: Annotated[list[Path], Option(help="CSV of the targets of each run, in the same order.")],
    output: Output,
    recipe: Annotated[
        str, Option(help="Recipe with features, or with stages that learn.")
    ] = "wang2007",
    lane: Annotated[list[Path] | None, Option(help="TOML of each lane, in the same order.")] = None,
    feature: Annotated[
        list[str] | None, Option(help="Feature in place of the recipe's; once per feature.")
    ] = None,
    beside: With = None,
    workers: Annotated[int | None, Option(help="Processes; the model is the same.", min=1)] = None,
    scheduler: Scheduler = None,
    max_memory: Annotated[
        str, Option(help="Memory of each process; a lane that takes more is refused.")
    ] = "2GB",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Train a recipe on runs with truth; a training that was stopped resumes."""
    with plain_errors(quiet), tasks.compiled_beside(), progress(quiet) as track:
        how = tasks.RunOptions(workers, scheduler, tasks.parse_size(max_memory), track)
        others = _others(beside, len(runs))
        more: dict[str, Any] = {"others": others, "how": how, "overwrite": overwrite}
        tasks.train_runs(runs, truth, recipe, output, feature or (), lane, **more)
    tell_written(quiet, output)


@app.command()
def info(
    paths: Annotated[
        list[Path],
        Argument(
            help="Run store, file to import, model, or result whose model is meant; or all files of one measurement."
        ),
    ],
    recipe: Annotated[
        str | None,
        Option(help="Recipe whose images and lane decide what is covered; tells whether it fits."),
    ] = None,
    recipes: Annotated[
        bool, Option("--recipes", help="Tell of every packaged recipe whether it fits.")
    ] = False,
    plot: Annotated[Path | None, Option(help="PNG to write: plan, coverage and side view.")] = None,
    mapping: Annotated[
        Path | None, Option(help="TOML to write: the draft of the files' mapping.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Tell what a run, a file or a model holds, in plain words and units; a model is not loaded for it.

    Several files of one measurement are told together, with one draft of their mapping.
    """
    with plain_errors():
        run = paths[0]
        if len(paths) > 1 or run.is_file():
            _explain(paths, mapping, as_json)
            return
        if mapping is not None:
            raise ValueError(f"a mapping is drafted for files, got {run}")
        if (run / "model.bundle").is_file() or (run / "manifest.json").is_file():
            held = tasks.model_info(run)
            typer.echo(json.dumps(held) if as_json else "\n".join(model_lines(held)))
            return
        told = tasks.run_info(run, recipe, plot, recipes)
    if as_json:
        typer.echo(json.dumps(told))
        return
    for line in info_lines(told):
        typer.echo(line)
    if plot is not None:
        typer.echo(f"plot: {plot.resolve()}")


def _explain(paths: list[Path], mapping: Path | None, as_json: bool) -> None:
    several = len(paths) > 1
    told = tasks.explain_files(paths, beside=mapping) if several else tasks.explain_file(paths[0])
    if mapping is not None:
        if not told.mapping:
            raise ValueError(
                f"{paths[0]}: a {told.kind} needs no mapping, none is written to {mapping}"
            )
        tasks.write_draft(told.mapping, mapping)
    if as_json:
        typer.echo(json.dumps({"kind": told.kind, "lines": told.lines, "mapping": told.mapping}))
        return
    typer.echo(told.kind if several else f"{told.path}: {told.kind}")
    for line in told.lines:
        typer.echo(f"  {line}")
    if mapping is not None:
        guesses = told.mapping.count('?"')
        typer.echo(f"wrote {mapping}, with {guesses} question mark{'s' * (guesses != 1)}")
    elif told.mapping:
        typer.echo(f"\nA mapping to begin with (flgpr import mapped):\n\n{told.mapping}")


@app.command()
def replay(
    result: Annotated[Path, Argument(help="Result folder.")],
    run: Annotated[
        Path | None, Option(help="Run store, if it is no longer where the result says.")
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run a result's recipe again and compare; exit status 1 if it does not agree."""
    with plain_errors(quiet), progress(quiet or as_json) as track:
        outcome = tasks.replay(result, run, track)
    if as_json:
        typer.echo(json.dumps(outcome))
    elif outcome["identical"]:
        typer.echo("identical: every file has the same bytes")
    else:
        word = "agrees" if outcome["agrees"] else "DIFFERS"
        others = ", ".join(outcome["files"])
        typer.echo(
            f"{word}: run-views differ by {outcome['difference']:.1e}; other bytes in {others}"
        )
    if not outcome["agrees"]:
        raise typer.Exit(1)
