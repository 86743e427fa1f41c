"""Which lane a stored run is searched in."""

from __future__ import annotations

from pathlib import Path

from flgpr.chain.recipe import Recipe
from flgpr.model import Lane
from flgpr.store import read_lane
from flgpr.store.tables import lane_file_of

PathLike = str | Path


def choose_lane(
    run: PathLike, given: PathLike | Lane | None, recipe: Recipe | None
) -> tuple[Lane | None, str]:
    """Return the lane that a run is searched in, and where its borders come from.

    A lane that is given comes first, then the recipe's, then ``NAME-lane.toml`` beside the run.
    Without any the lane is None and its source "": the ground that the run sees is searched.

    Parameters
    ----------
    run : path
        Run store.
    given : path or Lane, optional
        Lane that is given, or its file.
    recipe : Recipe, optional
        Recipe whose lane comes before that beside the run; None for one that was made for the run.

    Raises
    ------
    ValueError
        If a file is no lane; the error names it.
    """
    if isinstance(given, Lane):
        return given, "as given"
    if given is not None:
        return read_lane(given), f"{Path(given).name}, as given"
    if recipe is not None and recipe.lane is not None:
        return None, ""
    beside = lane_file_of(run)
    if beside.is_file():
        return read_lane(beside), f"{beside.name} beside the run"
    return None, ""
