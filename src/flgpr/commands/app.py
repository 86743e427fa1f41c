"""The command line: every command and its function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer import Option

import flgpr
from flgpr.commands import (
    bench,
    benchmark,
    calibrate,
    imports,
    live,
    plan,
    recipe,
)
from flgpr.commands.anchor import anchor
from flgpr.commands.demo import demo
from flgpr.commands.design import design
from flgpr.commands.detect import detect
from flgpr.commands.export import export
from flgpr.commands.image import image
from flgpr.commands.info import info
from flgpr.commands.prepare import prepare
from flgpr.commands.replay import replay
from flgpr.commands.reproduce import reproduce
from flgpr.commands.score import score
from flgpr.commands.shell import shell_function
from flgpr.commands.simulate import simulate_lane
from flgpr.commands.train import train
from flgpr.commands.view import view

COMMANDS: dict[str, Callable[..., Any]] = {
    "view": view,
    "demo": demo,
    "detect": detect,
    "train": train,
    "info": info,
    "replay": replay,
    "score": score,
    "simulate": simulate_lane,
    "prepare": prepare,
    "image": image,
    "design": design,
    "anchor": anchor,
    "export": export,
    "reproduce": reproduce,
    "live": live.live,
    "feed": live.feed,
}
"""Commands of one word."""

GROUPS: dict[tuple[str, str], dict[str, Callable[..., Any]]] = {
    ("calibrate", "Calibrate a run against positions and reflectors."): {
        "clock": calibrate.calibrate_clock,
        "range-bias": calibrate.calibrate_range_bias,
        "joint": calibrate.calibrate_joint,
        "permittivity": calibrate.calibrate_permittivity,
    },
    ("import", "Read other formats into a run."): {
        "fullwave": imports.import_fullwave,
        "gprmax": imports.import_gprmax,
        "mapped": imports.import_mapped,
        "table": imports.import_table,
        "cphd": imports.import_cphd,
        "gpr": imports.import_gpr,
    },
    ("recipe", "Make, show and check recipes."): {
        "list": recipe.list_recipes,
        "show": recipe.show_recipe,
        "for": recipe.recipe_for,
        "check": recipe.check_recipe,
    },
    ("plan", "Plan a test."): {
        "mines": plan.plan_mines,
        "lane": plan.plan_lane,
        "register": plan.register_recipe,
        "check": plan.check_register,
        "survey": plan.survey_plan,
    },
    ("bench", "Measure speed on this machine."): {"imaging": bench.bench_imaging},
    ("benchmark", "The proving ground: compare detectors on the same sealed lanes."): {
        "run": benchmark.run_benchmark,
        "oracle": benchmark.run_oracle,
        "table": benchmark.benchmark_table,
        "list": benchmark.list_benchmark,
    },
}
"""Commands of two words, by the first word and its help."""

app = typer.Typer(
    help="Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and "
    "scores.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
for name, function in COMMANDS.items():
    app.command(name)(shell_function(function))
for (group_name, group_help), functions in GROUPS.items():
    group = typer.Typer(name=group_name, help=group_help, no_args_is_help=True)
    for name, function in functions.items():
        group.command(name)(shell_function(function))
    app.add_typer(group)


def _version(is_asked: bool) -> None:
    """Print the version and end, where that is asked for."""
    if is_asked:
        typer.echo(f"flgpr {flgpr.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Parse the options before a command."""
