"""Commands on recipes, test plans and speed, and the papers run again."""

from __future__ import annotations

import json
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.common import (
    Json,
    Output,
    Quiet,
    Scheduler,
    plain_errors,
    progress,
    tell_written,
    with_witness,
)

PAPERS = ("cosgrove2004", "flsar2004", "fuse2018", "wang2007")

recipe_app = typer.Typer(name="recipe", help="Make, show and check recipes.", no_args_is_help=True)
bench_app = typer.Typer(name="bench", help="Measure speed on this machine.", no_args_is_help=True)
plan_app = typer.Typer(name="plan", help="Plan a test.", no_args_is_help=True)


@bench_app.command("imaging")
def bench_imaging_command(
    peers: Annotated[
        bool, Option("--peers", help="Measure the installed peers beside it.")
    ] = False,
    rounds: Annotated[int, Option(help="Rounds; medians are reported.", min=1)] = 7,
    device: Annotated[str, Option(help="cpu or cuda.")] = "cpu",
) -> None:
    """Time the imaging operator on one scan of sri-array."""
    with plain_errors():
        typer.echo(tasks.format_bench(tasks.bench_imaging(peers, rounds, device)))


@recipe_app.command("list")
def recipe_list() -> None:
    """Name the packaged recipes."""
    for name in tasks.recipe_names():
        typer.echo(f"{name:18} {tomllib.loads(tasks.recipe_text(name))['description']}")


@recipe_app.command("show")
def recipe_show(name: Annotated[str, Argument(help="Packaged recipe or TOML file.")]) -> None:
    """Print a recipe."""
    with plain_errors():
        typer.echo(tasks.recipe_text(name), nl=False)


@recipe_app.command("for")
def recipe_for(
    run: Annotated[Path, Argument(help="Run store.")],
    output: Annotated[
        Path | None, Option("-o", "--output", help="TOML file to write; else it is printed.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Make a recipe for a run's band, polarizations and array; comments say where each figure comes from."""
    with plain_errors(quiet):
        text = tasks.recipe_for(run, output)
    if output is None:
        typer.echo(text, nl=False)
    else:
        tell_written(quiet, output)


@recipe_app.command("check")
def recipe_check(name: Annotated[str, Argument(help="Packaged recipe or TOML file.")]) -> None:
    """Check a recipe; a fault is told with its line and rule."""
    with plain_errors():
        recipe = tasks.load_recipe(name)
    typer.echo(f"{name}: good ({recipe.description})")


@plan_app.command("mines")
def plan_mines_command(
    pd_claim: Annotated[float, Option("--pd", help="Probability of detection to be shown.")] = 0.9,
    far: Annotated[float, Option(help="False alarms per m² to be shown.")] = 0.01,
    confidence: Annotated[float, Option(help="Confidence of each claim.")] = 0.95,
    true_pd: Annotated[float | None, Option(help="Pd the detector is believed to have.")] = None,
    true_far: Annotated[float | None, Option(help="FAR it is believed to have.")] = None,
) -> None:
    """Tell how many mines and how much ground it takes to show a performance."""
    with plain_errors():
        _, lines = tasks.plan_mines(pd_claim, far, confidence, true_pd=true_pd, true_far=true_far)
    for line in lines:
        typer.echo(line)


@plan_app.command("lane")
def plan_lane_command(
    lane: Annotated[Path, Argument(help="TOML or CSV of the lane or lanes.")],
    targets: Annotated[Path, Argument(help="CSV with kind, depth (m) and count.")],
    output: Output,
    seed: Annotated[
        int | None,
        Option(
            help="Seed to draw a plan again; who can guess it knows the plan. By default drawn, and told."
        ),
    ] = None,
    spacing: Annotated[float, Option(help="Least distance between targets, m.")] = 3.0,
    edge: Annotated[float, Option(help="Least distance to the lane's border, m.")] = 0.5,
    recipe: Annotated[
        str | None, Option(help="Recipe whose hash is registered with the plan.")
    ] = None,
    book: Annotated[Path | None, Option(help="Register; beside the plan by default.")] = None,
    anchor: Annotated[
        Path | None, Option(help="TOML that ties the lane to the Earth; GeoPackage and GPX.")
    ] = None,
    halo: Annotated[float, Option(help="Halo radius that scores must use, m.")] = 1.0,
    far: Annotated[
        float, Option(help="Operating point that scores must use, false alarms per m².")
    ] = 0.05,
    quiet: Quiet = False,
) -> None:
    """Draw an emplacement plan, with the crew's page and sheet, and register it with the rules of its scoring."""
    with plain_errors(quiet):
        drawn: dict[str, float] = {"spacing": spacing, "edge": edge, "halo": halo, "far": far}
        plan, line = tasks.plan_lane(
            lane, targets, seed, output, recipe=recipe, book=book, anchor=anchor, **drawn
        )
    files = tasks.plan_files(output, anchor is not None)
    tell_written(quiet, *files.values())
    if not quiet:
        drawn_by = (
            "of a seed that was not kept"
            if plan.attrs["seed"] is None
            else f"seed {plan.attrs['seed']}"
        )
        typer.echo(f"{len(plan)} targets, {drawn_by}; registered {line['time']}")
        typer.echo(
            "keep these files and the seed from whoever runs a detector; the register is for all to read"
        )


@plan_app.command("register")
def plan_register_command(
    recipe: Annotated[str, Argument(help="Packaged recipe, or any file that fixes a detector.")],
    book: Annotated[Path, Option(help="Register of the plan.")],
    model: Annotated[
        Path | None, Option(help="Model that the recipe is run with, of `flgpr train`.")
    ] = None,
    witness: Annotated[
        Path | None,
        Option(help="A file elsewhere that must know the register's lines; told of new ones."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Register a recipe before the truth is opened; scores then ask for it."""
    with plain_errors(quiet):
        line = tasks.register_recipe(recipe, with_witness(book, witness), model)
    if not quiet:
        typer.echo(
            f"{recipe} is line {line['number']} of {book}, {line['recipe'][:12]}..., {line['time']}"
        )


@plan_app.command("check")
def plan_check_command(
    book: Annotated[Path, Argument(help="Register.")],
    report: Annotated[
        list[Path] | None,
        Option(
            help="Report of a score with this register (roc.json or its folder); several may be."
        ),
    ] = None,
    witness: Annotated[
        Path | None, Option(help="A file elsewhere that must know the register's lines.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a register line by line, and that nothing of it is missing that a witness or a report knows."""
    with plain_errors():
        lines, heads = tasks.check_register(with_witness(book, witness), report or [])
    told = {"lines": len(lines), "head": lines[-1]["hash"] if lines else ""}
    if as_json:
        typer.echo(
            json.dumps(told | {"reports": {str(name): head for name, head in heads.items()}})
        )
        return
    for line in lines:
        typer.echo(f"  {line['number']:4d}  {line['time']}  {json.dumps(line.get('event', ''))}")
    typer.echo(
        f"{book}: {told['lines']} lines, each fits the one before; the last is {told['head']}"
    )
    for name, head in heads.items():
        typer.echo(f"{name} knows {head['lines']} of them")
    if not heads and witness is None:
        typer.echo("whether lines are missing at the end shows only beside --report or --witness")


@plan_app.command("survey")
def plan_survey_command(
    plan: Annotated[Path, Argument(help="Plan that was emplaced.")],
    sheet: Annotated[Path, Argument(help="Its sheet, filled in by the crew.")],
    output: Output,
    book: Annotated[Path | None, Option(help="Register; the plan names its own.")] = None,
    within: Annotated[
        float, Option(help="Largest difference from the plan that is believed, m.")
    ] = 1.0,
    quiet: Quiet = False,
) -> None:
    """Read what was emplaced, write it as truth and register it in place of the plan."""
    with plain_errors(quiet):
        truth, line = tasks.survey_plan(plan, sheet, output, book, within)
    tell_written(quiet, output)
    if not quiet:
        typer.echo(
            f"{len(truth)} targets, {line['moved']} of them moved by at most {line['largest_offset']:.3f} m; "
            f"{line['left_out']} not emplaced and left out; registered {line['time']}"
        )


def reproduce(
    paper: Annotated[
        str,
        Argument(
            help=f"One of {', '.join(PAPERS)}, all, worlds: a map of what decides, or reasons: "
            "experiments on why statements do not hold."
        ),
    ],
    output: Annotated[Path | None, Option("-o", "--output", help="Folder to work in.")] = None,
    quick: Annotated[
        bool, Option("--quick", help="A small version that only shows that all of it runs.")
    ] = False,
    part: Annotated[
        list[str] | None,
        Option(
            help="Of worlds: detection, ablation, geometry or statements, or figures of what is there; of reasons: a "
            "paper. Several may be."
        ),
    ] = None,
    workers: Annotated[
        int | None, Option(min=1, help="Processes, of all a paper each, of worlds a world.")
    ] = None,
    scheduler: Scheduler = None,
    world: Annotated[
        str,
        Option(
            help="Lanes of the studies: own, prepared as each paper says, or as-found, roads as found."
        ),
    ] = "own",
    quiet: Quiet = False,
) -> None:
    """Run a paper's experiment again on simulated lanes and write its page; goes on where it was stopped."""
    with plain_errors(quiet), progress(quiet) as track:
        if paper not in (*PAPERS, "all", "worlds", "reasons"):
            raise ValueError(
                f"paper must be one of {', '.join(PAPERS)}, all, worlds or reasons, got {paper!r}"
            )
        of_all = "reproduced" if paper in ("all", "reasons") else f"{paper}-result"
        folder = output or Path(of_all)
        papers = import_module(
            "flgpr_papers"
        )  # the studies rest on everything else, and nothing rests on them
        if paper == "worlds" and world != "own":
            raise ValueError(f"worlds has worlds of its own: world must be left out, got {world!r}")
        if part and paper not in ("worlds", "reasons"):
            raise ValueError(
                f"part must be left out for {paper}: only worlds and reasons have parts"
            )
        if paper == "worlds":
            how = tasks.RunOptions(workers, scheduler, track=track)
            page = papers.map_worlds(folder, *([part] if part else []), quick=quick, how=how)
        elif paper == "reasons":
            page = papers.explain(folder, part or (), quick, world, track)
        else:
            page = papers.reproduce(paper, folder, quick, track, workers or 1, world)
    if not quiet:
        word = "table" if paper == "reasons" else "page"
        typer.echo(f"{word}: {page.resolve()}")
