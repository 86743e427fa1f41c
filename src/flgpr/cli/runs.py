"""Commands on runs and results: demo, detect, train, info, replay, view."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from flgpr import tasks, viewer
from flgpr.cli.common import (
    Json,
    Output,
    Overwrite,
    Quiet,
    plain_errors,
    progress,
)
from flgpr.cli.show import info_lines, model_lines, print_scores, score_summary

if TYPE_CHECKING:
    pass

app = typer.Typer()
With = Annotated[
    list[str] | None,
    Option(
        "--with",
        help="NAME=RUN: a run taken together with it, such as a second band; once per name and run.",
    ),
]


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
