"""The command line: every command and its function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from typing import Annotated, Any

import typer
from typer import Option
from typer.core import TyperCommand, TyperGroup

import flgpr
from flgpr.commands import (
    calibrate,
    imports,
    live,
    recipe,
)
from flgpr.commands.agree import agree
from flgpr.commands.anchor import anchor
from flgpr.commands.check import check
from flgpr.commands.compare import compare
from flgpr.commands.demo import demo
from flgpr.commands.design import design
from flgpr.commands.detect import detect
from flgpr.commands.export import export
from flgpr.commands.image import image
from flgpr.commands.info import info
from flgpr.commands.messages import say
from flgpr.commands.open import open_files
from flgpr.commands.prepare import prepare
from flgpr.commands.replay import replay
from flgpr.commands.score import score
from flgpr.commands.shell import Offer, shell_function
from flgpr.commands.simulate import simulate_lane
from flgpr.commands.train import train
from flgpr.commands.view import view


class PairCommand(TyperCommand):
    """A command whose options of several numbers also take them as one word with commas."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words behind the command."""
        several = [parameter for parameter in self.params if parameter.nargs > 1]
        counts = {name: parameter.nargs for parameter in several for name in parameter.opts}
        return super().parse_args(ctx, split_numbers(args, counts))


def split_numbers(arguments: Sequence[str], counts: Mapping[str, int]) -> list[str]:
    """Return the words of a command with numbers that are joined by commas as a word each.

    Parameters
    ----------
    arguments : sequence of str
        Words as they were typed.
    counts : mapping of str to int
        Number of values of each option that takes several.

    Returns
    -------
    list of str
        The words. Those that are no such numbers, or not so many, are left as they are.
    """
    split: list[str] = []
    option = ""  # the option whose values are next
    for number, word in enumerate(arguments):
        if word == "--":  # all that follows are arguments
            return [*split, *arguments[number:]]
        name, equals, joined = word.partition("=")
        if equals and name in counts and _has_numbers(joined, counts[name]):
            split += [name, *joined.split(",")]
        elif option and _has_numbers(word, counts[option]):
            split += word.split(",")
        else:
            split.append(word)
        option = word if word in counts else ""
    return split


def _has_numbers(word: str, count: int) -> bool:
    """Return whether a word is so many numbers with commas between them."""
    numbers = word.split(",")
    try:
        for number in numbers:
            float(number)
    except ValueError:
        return False
    return len(numbers) == count


COMMANDS: dict[str, Callable[..., Any]] = {
    "view": view,
    "demo": demo,
    "detect": detect,
    "train": train,
    "open": open_files,
    "info": info,
    "check": check,
    "replay": replay,
    "score": score,
    "compare": compare,
    "agree": agree,
    "simulate": simulate_lane,
    "prepare": prepare,
    "image": image,
    "design": design,
    "anchor": anchor,
    "export": export,
    "live": live.live,
    "feed": live.feed,
    "calibrate clock": calibrate.calibrate_clock,
    "calibrate range-bias": calibrate.calibrate_range_bias,
    "calibrate joint": calibrate.calibrate_joint,
    "calibrate permittivity": calibrate.calibrate_permittivity,
    "calibrate poses": calibrate.calibrate_poses,
    "import fullwave": imports.import_fullwave,
    "import mapped": imports.import_mapped,
    "import table": imports.import_table,
    "recipe list": recipe.list_recipes,
    "recipe show": recipe.show_recipe,
    "recipe for": recipe.recipe_for,
    "recipe check": recipe.check_recipe,
    "recipe suggest": recipe.suggest_recipe,
}
"""Every command by its words."""

HELP_PANELS: dict[str, dict[str, str]] = {
    "Start": {
        "demo": "",
        "open": "",
        "info": "",
        "check": "",
        "view": "",
        "recipe": "Suggest, make, show and check recipes.",
    },
    "Data": {
        "import": "Read other formats into a run.",
        "prepare": "",
        "simulate": "",
        "calibrate": "Calibrate a run against positions and reflectors.",
        "anchor": "",
        "export": "",
    },
    "Detect": {"detect": "", "train": "", "image": "", "replay": ""},
    "Judge": {"score": "", "compare": "", "agree": ""},
    "Live": {"live": "", "feed": ""},
    "Research": {
        "design": "",
    },
}
"""First words by the title of the box in which ``flgpr --help`` shows them.

Each with its help where a second word follows.
"""


class OrderedGroup(TyperGroup):
    """The command line, which lists its commands in the order of the boxes."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - the signature of Typer
        """Return the first words of all commands."""
        return [first for first_words in HELP_PANELS.values() for first in first_words]


app = typer.Typer(
    cls=OrderedGroup,
    help="Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and "
    "scores.",
    epilog="flgpr --install-completion completes commands and options with the Tab key.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _take_in_other_packages() -> None:
    """Add the commands of other packages.

    An entry point of the group "flgpr.commands" names an :class:`~flgpr.commands.shell.Offer`. A
    command whose words another one has is left out, so that no package replaces a command of this
    one; it is told at every start.
    """
    for offer in entry_points(group="flgpr.commands"):
        offered: Offer = offer.load()
        for words, function in offered.commands.items():
            if COMMANDS.setdefault(words, function) is not function:
                LEFT_OUT.append(f"flgpr {words} of {offer.value} is left out: there is one already")
        for title, first_words in offered.panels.items():
            HELP_PANELS.setdefault(title, {}).update(first_words)


def _fill(program: typer.Typer) -> None:
    """Add every command to the program, those of two words to the group of the first."""
    groups: dict[str, typer.Typer] = {}
    for title, first_words in HELP_PANELS.items():
        for first, help_text in first_words.items():
            if first in COMMANDS:
                function = shell_function(COMMANDS[first])
                program.command(first, cls=PairCommand, rich_help_panel=title)(function)
                continue
            groups[first] = typer.Typer(name=first, help=help_text, no_args_is_help=True)
            program.add_typer(groups[first], rich_help_panel=title)
    for words, function in COMMANDS.items():
        first, _, second = words.partition(" ")
        if second:
            groups[first].command(second, cls=PairCommand)(shell_function(function))


LEFT_OUT: list[str] = []
"""Commands of other packages that are left out, and why."""

_take_in_other_packages()
_fill(app)


def _version(is_asked: bool) -> None:
    """Print the version and end, where that is asked for."""
    if is_asked:
        say(f"flgpr {flgpr.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[  # noqa: ARG001
        bool, Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Parse the options before a command, and tell what of other packages is left out."""
    for line in LEFT_OUT:
        say(f"note: {line}", err=True)
