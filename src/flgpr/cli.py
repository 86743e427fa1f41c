"""The command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from flgpr import __version__
from flgpr.pipeline import tasks
from flgpr.pipeline.bench import bench_imaging, format_bench
from flgpr.pipeline.progress import Bars, Track, silent
from flgpr.pipeline.recipe import load_recipe, recipe_names, recipe_text

app = typer.Typer(
    help="Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and scores.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
import_app = typer.Typer(help="Read other formats into a run.", no_args_is_help=True)
app.add_typer(import_app, name="import")
bench_app = typer.Typer(help="Measure speed on this machine.", no_args_is_help=True)
app.add_typer(bench_app, name="bench")
recipe_app = typer.Typer(help="Show and check recipes.", no_args_is_help=True)
app.add_typer(recipe_app, name="recipe")

Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of words.")]
Output = Annotated[Path, typer.Option("-o", "--output", help="What to write.")]


@contextmanager
def _plain_errors() -> Iterator[None]:
    """Turn what the user can mend into one line and exit status 2."""
    try:
        yield
    except (ValueError, FileNotFoundError, FileExistsError, PermissionError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from None


@contextmanager
def _progress(quiet: bool) -> Iterator[Track]:
    if quiet:
        yield silent
    else:
        with Bars() as bars:
            yield bars


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flgpr {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options that stand before every command."""


@app.command()
def demo(output: Output = Path("demo-result"), quiet: Quiet = False, as_json: Json = False) -> None:
    """Process the packaged lane: image, detect, score, report."""
    with _plain_errors(), _progress(quiet or as_json) as track:
        result, scored = tasks.demo(output, track)
    if as_json:
        typer.echo(json.dumps(_score_summary(result.folder, scored)))
    elif not quiet:
        _print_scores(scored)
        typer.echo(f"report: {(result.folder / 'report.html').resolve()}")


@app.command()
def detect(
    run: Annotated[Path, typer.Argument(help="Run store.")],
    output: Output,
    recipe: Annotated[str, typer.Option(help="Packaged recipe or TOML file.")] = "demo",
    lane: Annotated[Path | None, typer.Option(help="TOML with x_min, x_max, y_min, y_max in metres.")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Raise alarms on a run; truth is not needed and not read."""
    with _plain_errors(), _progress(quiet or as_json) as track:
        result = tasks.detect_run(run, recipe, output, lane, track)
    main, masked = result.detections[0], result.manifest["run"]["masked_scans"]
    if as_json:
        summary = {"alarms": len(main.alarms), "masked_scans": masked, "result": str(result.folder)}
        typer.echo(json.dumps(summary))
    elif not quiet:
        if masked:
            typer.echo(
                f"{len(masked)} of {result.manifest['run']['scans']} scans left out for missing sweeps: {masked}"
            )
        typer.echo(f"{len(main.alarms)} alarms; report: {(result.folder / 'report.html').resolve()}")


@app.command()
def score(
    result: Annotated[Path, typer.Argument(help="Result folder, or the alarms.csv in it.")],
    truth: Annotated[Path, typer.Option(help="CSV of the targets.")],
    objects: Annotated[Path | None, typer.Option(help="CSV of rocks, posts and the like, for the pictures.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for roc.json and report.html.")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score a result against truth."""
    folder = result.parent if result.name == "alarms.csv" else result
    with _plain_errors(), _progress(quiet or as_json) as track:
        _, scored = tasks.score_result(folder, truth, objects, output, track)
    if as_json:
        typer.echo(json.dumps(_score_summary(output or folder, scored)))
    elif not quiet:
        _print_scores(scored)
        typer.echo(f"report: {((output or folder) / 'report.html').resolve()}")


@app.command()
def info(
    run: Annotated[Path, typer.Argument(help="Run store.")],
    recipe: Annotated[str | None, typer.Option(help="Recipe whose images and lane decide what is covered.")] = None,
    plot: Annotated[Path | None, typer.Option(help="PNG to write: plan, coverage and side view.")] = None,
    as_json: Json = False,
) -> None:
    """Tell what a run holds, in plain words and units."""
    with _plain_errors():
        told = tasks.run_info(run, recipe, plot)
    if as_json:
        typer.echo(json.dumps(told))
        return
    for line in _info_lines(told):
        typer.echo(line)
    if plot is not None:
        typer.echo(f"plot: {plot.resolve()}")


@app.command()
def replay(
    result: Annotated[Path, typer.Argument(help="Result folder.")],
    run: Annotated[Path | None, typer.Option(help="Run store, if it is no longer where the result says.")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run a result's recipe again and compare; exit status 1 if it does not agree."""
    with _plain_errors(), _progress(quiet or as_json) as track:
        outcome = tasks.replay(result, run, track)
    if as_json:
        typer.echo(json.dumps(outcome))
    elif outcome["identical"]:
        typer.echo("identical: every file has the same bytes")
    else:
        word = "agrees" if outcome["agrees"] else "DIFFERS"
        typer.echo(
            f"{word}: run-views differ by {outcome['difference']:.1e}; other bytes in {', '.join(outcome['files'])}"
        )
    if not outcome["agrees"]:
        raise typer.Exit(1)


@bench_app.command("imaging")
def bench_imaging_command(
    peers: Annotated[bool, typer.Option("--peers", help="Measure the installed peers beside it.")] = False,
    rounds: Annotated[int, typer.Option(help="Rounds; medians are reported.", min=1)] = 7,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
) -> None:
    """Time the imaging operator on one scan of sri-array."""
    with _plain_errors():
        typer.echo(format_bench(bench_imaging(peers, rounds, device)))


@recipe_app.command("list")
def recipe_list() -> None:
    """Name the packaged recipes."""
    for name in recipe_names():
        typer.echo(f"{name:12} {load_recipe(name).description}")


@recipe_app.command("show")
def recipe_show(name: Annotated[str, typer.Argument(help="Packaged recipe or TOML file.")]) -> None:
    """Print a recipe."""
    with _plain_errors():
        typer.echo(recipe_text(name), nl=False)


@recipe_app.command("check")
def recipe_check(name: Annotated[str, typer.Argument(help="Packaged recipe or TOML file.")]) -> None:
    """Check a recipe; a fault is told with its line and rule."""
    with _plain_errors():
        recipe = load_recipe(name)
    typer.echo(f"{name}: good ({recipe.description})")


@app.command()
def simulate(
    scene: Annotated[Path, typer.Argument(help="Scene (TOML).")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Run store to make.")] = None,
    sensor: Annotated[str, typer.Option(help="Sensor preset or TOML file.")] = "sri-array",
    seed: Annotated[int, typer.Option(help="The same seed gives the same lane, bit for bit.")] = 1,
    errors: Annotated[bool, typer.Option("--errors/--no-errors", help="Whether the sensor's errors are added.")] = True,
    preview: Annotated[Path | None, typer.Option(help="PNG of the scene to write.")] = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a lane with truth; with --preview alone only draw it."""
    with _plain_errors(), _progress(quiet) as track:
        if output is None and preview is None:
            raise ValueError("simulate needs --output or --preview, got neither")
        written = tasks.simulate_lane(scene, sensor, seed, output, preview, errors, track)
    if not quiet:
        for path in written:
            typer.echo(f"wrote {path}")


@import_app.command("fullwave")
def import_fullwave(
    archive: Annotated[Path, typer.Argument(help="NumPy archive (.npz) of a full-wave lane.")],
    output: Output,
    quiet: Quiet = False,
) -> None:
    """Import a full-wave lane; truth and objects are written beside the run if the archive tells."""
    with _plain_errors():
        written = tasks.import_fullwave_lane(archive, output)
    if not quiet:
        for path in written:
            typer.echo(f"wrote {path}")


def _score_summary(folder: Path, scored: list[Any]) -> dict[str, Any]:
    last = scored[0].curve.iloc[-1]
    return {
        "result": str(folder),
        "targets": int(last["n_targets"]),
        "found": int(last["n_detected"]),
        "false_alarms": int(last["n_false"]),
        "area_m2": float(last["area"]),
        "outcomes": json.loads(tasks.outcome_table(scored).to_json(orient="records")),
    }


def _print_scores(scored: list[Any]) -> None:
    table = Table(title="What became of each target")
    for name in ("target", "outcome", "rank", "false above", "off by"):
        table.add_column(name, justify="left" if name in ("target", "outcome") else "right", no_wrap=True)
    for one in scored:
        table.add_section()
        table.add_row(f"[bold]{one.detection.name}[/bold]")
        for row in one.outcomes.to_dict("records"):
            target = f"  {row['target_id']}: {row['kind']}, {100 * row['depth']:.1f} cm deep"
            found = [str(row["rank"]), str(row["n_false"]), f"{row['distance']:.2f} m"] if row["detected"] else []
            table.add_row(target, "found" if row["detected"] else "missed", *found)
    Console().print(table)
    last = scored[0].curve.iloc[-1]
    if not last["n_targets"]:
        typer.echo(f"main: no targets, {last['n_false']:.0f} false alarms on {last['area']:.2f} m²")
        return
    typer.echo(
        f"main: {last['n_detected']:.0f} of {last['n_targets']:.0f} targets found (Pd {last['pd']:.2f}, 95 % interval "
        f"{last['pd_low']:.2f} to {last['pd_high']:.2f}), {last['n_false']:.0f} false alarms on {last['area']:.2f} m² "
        f"(FAR {last['far']:.2f} per m², {last['far_low']:.2f} to {last['far_high']:.2f})"
    )


def _info_lines(told: dict[str, Any]) -> list[str]:
    low, high = (value / 1e9 for value in told["frequency_hz"])
    spacing = told["scan_spacing_m"]
    between = f", {spacing[0]:.2f} to {spacing[1]:.2f} m between scans" if spacing else ""
    missing = f"{told['missing_sweeps']} missing" if told["missing_sweeps"] else "none missing"
    masked = f"; scans left out for it: {told['masked_scans']}" if told["masked_scans"] else ""
    even = "evenly spaced" if told["uniform_tones"] else f"uneven, up to {told['largest_step_hz'] / 1e6:.3g} MHz apart"
    lines = [
        f"{told['title']}" + (f" ({told['source']})" if told["source"] else ""),
        f"  scans          {told['scans']} over {told['travelled_m']:.2f} m of travel{between}",
        f"  sweeps         {told['pairs']} pairs x {', '.join(told['polarizations'])}: {missing}{masked}",
        f"  tones          {told['tones']} from {low:.4g} to {high:.4g} GHz, {even}",
    ]
    if told["unambiguous_path_m"]:
        lines.append(
            f"  range          resolution {told['range_resolution_m']:.3f} m, path unambiguous to "
            f"{told['unambiguous_path_m']:.1f} m"
        )
    heights = [pose[2] for pose in told["pose"]]
    lines += [
        f"  array          {len(told['tx_m'])} transmitter and {len(told['rx_m'])} receiver positions, "
        f"{min(heights):.2f} to {max(heights):.2f} m above the ground",
        f"  coverage       x {told['lane']['x'][0]:.1f} to {told['lane']['x'][1]:.1f} m, "
        f"y {told['lane']['y'][0]:.1f} to {told['lane']['y'][1]:.1f} m: {told['looks']['mean']:.1f} looks on average, "
        f"at most {told['looks']['most']}, {100 * told['looks']['unseen_share']:.0f} % never seen",
        "",
        *_coverage_map(told),
    ]
    return lines


def _coverage_map(told: dict[str, Any]) -> list[str]:
    """Draw looks as a map of characters, down-track upwards, at most 24 lines."""
    rows, most = told["looks_map"], max(told["looks"]["most"], 1)
    stride = max(1, len(rows) // 24)
    shades = " ░▒▓█"
    low, high = told["lane"]["y"]
    drawn = []
    for index in range(0, len(rows), stride):
        y = low + (high - low) * index / max(len(rows) - 1, 1)
        cells = "".join(shades[-(-count * (len(shades) - 1) // most)] * 2 for count in rows[index])
        drawn.append(f"  y {y:7.1f} m  {cells}")
    return [*drawn[::-1], f"  {'':11}looks: blank 0 … {shades[-1]} {most}"]
