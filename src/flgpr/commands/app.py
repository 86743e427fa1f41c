"""The command line: every word and the function that it calls."""

from __future__ import annotations

from typing import Annotated

import typer
from typer import Option

import flgpr
from flgpr.cli import runs
from flgpr.cli.benchmark import benchmark_app
from flgpr.cli.calibration import anchor, calibrate_app
from flgpr.cli.design import design
from flgpr.cli.exchange import export, import_app
from flgpr.cli.live import feed, live
from flgpr.cli.picture import image, prepare
from flgpr.cli.scoring import score
from flgpr.cli.simulation import simulate
from flgpr.cli.tools import bench_app, plan_app, recipe_app, reproduce
from flgpr.commands.detect import detect
from flgpr.commands.shell import shell_function
from flgpr.commands.train import train

app = typer.Typer(
    help="Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and scores.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.command()(shell_function(detect))
app.command()(shell_function(train))
app.registered_commands += runs.app.registered_commands
for command in (score, simulate, prepare, image, design, anchor, export, reproduce, live, feed):
    app.command()(command)
for group in (calibrate_app, import_app, recipe_app, plan_app, bench_app, benchmark_app):
    app.add_typer(group)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flgpr {flgpr.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options that stand before every command."""
