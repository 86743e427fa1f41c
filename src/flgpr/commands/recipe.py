"""``flgpr recipe``: make, show and check recipes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import OptionalOutput, PathLike, RunArgument, ShellType
from flgpr.commands.shell import Arguments, RawText, command

if TYPE_CHECKING:
    from flgpr.recipe.schema import Recipe
    from flgpr.recipe.suggest import Suggestions

RecipeArgument = Annotated[PathLike, "Packaged recipe or TOML file.", ShellType(str)]


@command(
    lines=lambda recipes, _: [f"{name:18} {text}" for name, text in recipes.items()], quiet=False
)
def list_recipes() -> dict[str, str]:
    """Name the packaged recipes.

    Returns
    -------
    dict
        Description of each recipe by its name.
    """
    import tomllib

    from flgpr.recipe.schema import recipe_names, recipe_text

    descriptions = {}
    for name in recipe_names():
        descriptions[name] = tomllib.loads(recipe_text(name))["description"]
    return descriptions


def _text_lines(text: str, call: Arguments) -> Iterator[str | Path]:
    """Yield the file of a recipe, or its text as it is where it has no file."""
    yield vars(call).get("output") or RawText(text)


@command(lines=_text_lines, quiet=False)
def show_recipe(name: RecipeArgument) -> str:
    """Print a recipe.

    Returns
    -------
    str
        Its TOML.
    """
    from flgpr.recipe.schema import recipe_text

    return recipe_text(name)


@command(lines=_text_lines)
def recipe_for(
    run: RunArgument,
    output: OptionalOutput = None,
    like: Annotated[PathLike | None, ShellType(str)] = None,
) -> str:
    """Make a recipe for a run's band, polarizations and array.

    Comments in it state where each figure comes from. With --like what belongs to the array comes
    from the run, and all else from another recipe.

    Parameters
    ----------
    like
        Recipe whose method it has, such as fused; by default parts of wang2007.
    output
        TOML file; else it is printed

    Returns
    -------
    str
        TOML of the recipe, see :func:`flgpr.recipe.make.fit_recipe`.

    Raises
    ------
    ValueError
        If no recipe can be made for the run, or the other one cannot be fitted to an array.
    FileExistsError
        If another file is at the output.
    """
    from flgpr.recipe.make import recipe_for as write_recipe

    return write_recipe(run, output, like=like)


def _suggestion_lines(suggestions: Suggestions, call: Arguments) -> Iterator[Any]:
    """Yield the answer, a row for every recipe, and what the figures are."""
    from rich.table import Table

    from flgpr.recipe.suggest import evidence

    tracks = evidence()["tracks"]
    yield suggestions.answer.replace("RUN", str(call.run))
    yield ""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="")
    for heading in ("recipe", "", *tracks, "training", "what the run lacks"):
        table.add_column(heading, justify="right" if heading in tracks else "left")
    for one in suggestions.ranked:
        counts = [str(one.found.get(name, "·")) for name in tracks]
        learns = "needed" if one.learns else "none"
        table.add_row(one.recipe, one.verdict, *counts, learns, "; ".join(one.why))
    yield table
    yield ""
    for name, track in tracks.items():
        yield (
            f"{name}: mines found of {track['of']} at {track['far']:g} false alarms per m², on "
            f"{track['lanes']}"
        )
    yield "p: against made, which ranks by the contrast C_HH"


@command(
    lines=_suggestion_lines,
    as_json=True,
    quiet=False,
)
def suggest_recipe(run: RunArgument) -> Suggestions:
    """Rank the recipes that fit a run by what they found elsewhere, and say what it lacks for others.

    Returns
    -------
    Suggestions
        ``answer``, one sentence, and ``ranked``, the recipes.

    Raises
    ------
    ValueError
        If the run cannot be read, or has no complete scan.
    """
    from flgpr.recipe.suggest import suggest
    from flgpr.store import open_run

    return suggest(open_run(run))


@command(lines=lambda recipe, call: [f"{call.name}: good ({recipe.description})"], quiet=False)
def check_recipe(name: RecipeArgument) -> Recipe:
    """Check a recipe; a fault is reported with its line and rule.

    Returns
    -------
    Recipe
        The recipe.

    Raises
    ------
    ValueError
        If the recipe breaks a rule; the message names the line and the rule.
    """
    from flgpr.recipe.schema import load_recipe

    return load_recipe(name)
