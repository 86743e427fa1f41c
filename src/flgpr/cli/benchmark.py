"""Commands of the proving ground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from flgpr.cli.common import Quiet, Scheduler, plain_errors, progress

benchmark_app = typer.Typer(
    name="benchmark",
    help="The proving ground: detectors side by side on the same sealed lanes.",
    no_args_is_help=True,
)
Chosen = Annotated[
    str | None,
    Option(
        help="proving-ground-2 (the default), proving-ground-1, full-wave-1, or the TOML of a ground of your own."
    ),
]
Tier = Annotated[
    str | None, Option(help="prepared, as-found or another tier of the ground; all by default.")
]
Workers = Annotated[int | None, Option(min=1, help="Processes that share the work.")]
Quick = Annotated[
    bool, Option("--quick", help="The quick form, which only shows that all of it runs.")
]


@benchmark_app.command("run")
def run_command(
    entries: Annotated[
        list[str] | None,
        Argument(
            help="Packaged entries, recipes, or folders of alarm lists SPLIT.csv; none takes all packaged ones."
        ),
    ] = None,
    output: Annotated[Path, Option("-o", "--output", help="Folder to work in.")] = Path(
        "proving-ground"
    ),
    quick: Quick = False,
    ground: Chosen = None,
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Make the lanes, train on those of training, freeze, detect on those of test, score; resumes where it stopped."""
    from flgpr import proving_ground, tasks

    with plain_errors(quiet):
        with progress(quiet) as track:
            how = tasks.RunOptions(workers, scheduler, track=track)
            proving_ground.run_benchmark(entries or [], output, quick, how, ground, tier)
        text = proving_ground.write_table([output], output)
    if not quiet:
        typer.echo(text)
        typer.echo(f"page: {(output / 'index.html').resolve()}")


@benchmark_app.command("oracle")
def oracle_command(
    folder: Annotated[Path, Argument(help="Folder of `flgpr benchmark run`.")],
    recipe: Annotated[str, Option(help="Recipe whose images it looks at.")] = "wang2007",
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
) -> None:
    """Tell what a detector would find that knows every mine's echo; opens the truth, which is logged."""
    from flgpr import proving_ground, tasks

    with plain_errors(quiet):
        with progress(quiet) as track:
            proving_ground.run_oracle(
                folder, recipe, tasks.RunOptions(workers, scheduler, track=track), tier
            )
        text = proving_ground.write_table([folder], folder)
    if not quiet:
        typer.echo(text)


@benchmark_app.command("table")
def table_command(
    folders: Annotated[
        list[Path], Argument(help="Folders of `flgpr benchmark run`, of one ground.")
    ],
    output: Annotated[
        Path | None, Option("-o", "--output", help="Folder of the table; default the first.")
    ] = None,
) -> None:
    """Set entries side by side; alarms that were not scored yet are, and the look at the truth is logged."""
    from flgpr import proving_ground

    with plain_errors():
        typer.echo(proving_ground.write_table(folders, output or folders[0]))


@benchmark_app.command("list")
def list_command(
    quick: Quick = False,
    lanes: Annotated[
        Path | None, Option(help="Folder of lanes to compare with those of the authors.")
    ] = None,
    ground: Chosen = None,
) -> None:
    """Name the packaged entries, the lanes and the splits; with a folder of lanes, tell whether they are the same."""
    from flgpr import proving_ground

    with plain_errors():
        for line in proving_ground.listing(quick, lanes, ground):
            typer.echo(line)
