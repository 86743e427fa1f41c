"""The command line: every command and its function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer import Option
from typer.core import TyperGroup

import flgpr
from flgpr.commands import (
    benchmark,
    calibrate,
    imports,
    live,
    plan,
    recipe,
    submissions,
)
from flgpr.commands.anchor import anchor
from flgpr.commands.demo import demo
from flgpr.commands.design import design
from flgpr.commands.detect import detect
from flgpr.commands.export import export
from flgpr.commands.image import image
from flgpr.commands.info import info
from flgpr.commands.pairs import PairCommand
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
    ("benchmark", "The proving ground: compare detectors on the same sealed lanes."): {
        "run": benchmark.run_benchmark,
        "oracle": benchmark.run_oracle,
        "table": benchmark.benchmark_table,
        "list": benchmark.list_benchmark,
        "make": submissions.make_benchmark,
        "croissant": submissions.describe_benchmark,
        "validate": submissions.validate_submissions,
        "enter": submissions.enter_benchmark,
        "leaderboard": submissions.benchmark_leaderboard,
    },
}
"""Commands of two words, by the first word and its help."""

HELP_PANELS: dict[str, tuple[str, ...]] = {
    "Start": ("demo", "info", "view", "recipe"),
    "Data": ("import", "prepare", "simulate", "calibrate", "anchor", "export"),
    "Detect": ("detect", "train", "image", "replay"),
    "Judge": ("score", "plan"),
    "Live": ("live", "feed"),
    "Research": ("design", "benchmark", "reproduce"),
}
"""First words of commands by the title of the box in which ``flgpr --help`` shows them."""


class OrderedGroup(TyperGroup):
    """The command line, which lists its commands in the order of the boxes."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - the signature of Typer
        """Return the first words of all commands."""
        names: list[str] = []
        for panel_names in HELP_PANELS.values():
            names += panel_names
        return names


def _panel_of(name: str) -> str:
    """Return the title of the box in which the help shows a command."""
    return next(title for title, names in HELP_PANELS.items() if name in names)


app = typer.Typer(
    cls=OrderedGroup,
    help="Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and "
    "scores.",
    epilog="flgpr --install-completion completes commands and options with the Tab key.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for name, function in COMMANDS.items():
    panel = _panel_of(name)
    app.command(name, cls=PairCommand, rich_help_panel=panel)(shell_function(function))
for (group_name, group_help), functions in GROUPS.items():
    group = typer.Typer(name=group_name, help=group_help, no_args_is_help=True)
    for name, function in functions.items():
        group.command(name, cls=PairCommand)(shell_function(function))
    app.add_typer(group, rich_help_panel=_panel_of(group_name))


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
