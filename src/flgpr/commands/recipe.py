"""``flgpr recipe``: make, show and check recipes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flgpr.commands.options import PathLike, RunArgument, ShellType, output_option
from flgpr.commands.shell import Arguments, RawText, command

if TYPE_CHECKING:
    from flgpr.recipe.schema import Recipe

RecipeArgument = Annotated[PathLike, Argument(help="Packaged recipe or TOML file."), ShellType(str)]


def _list_lines(descriptions: dict[str, str], _: Arguments) -> Iterator[str]:
    """Yield a line for each recipe."""
    for name, description in descriptions.items():
        yield f"{name:18} {description}"


@command(lines=_list_lines, quiet=False)
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


def _text_lines(text: str, _: Arguments) -> Iterator[str]:
    """Yield the TOML of a recipe as it is."""
    yield RawText(text)


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


def _recipe_lines(text: str, call: Arguments) -> Iterator[str | Path]:
    """Yield the file of a recipe, or its text where it has no file."""
    if call.output is None:
        yield RawText(text)
    else:
        yield call.output


@command(lines=_recipe_lines)
def recipe_for(
    run: RunArgument,
    output: Annotated[PathLike | None, output_option("TOML file; else it is printed")] = None,
    like: Annotated[
        PathLike | None,
        Option(help="Recipe whose method it has, such as fused; by default parts of wang2007."),
        ShellType(str),
    ] = None,
) -> str:
    """Make a recipe for a run's band, polarizations and array.

    Comments in it state where each figure comes from. With --like what belongs to the array comes
    from the run, and all else from another recipe.

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


def _good_lines(recipe: Recipe, call: Arguments) -> Iterator[str]:
    """Yield that a recipe is good, and its description."""
    yield f"{call.name}: good ({recipe.description})"


@command(lines=_good_lines, quiet=False)
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
