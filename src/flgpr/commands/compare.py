"""``flgpr compare``: several results or alarm lists against the same truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import LaneOption, OptionalOutput, Overwrite, ResultsLike, one_or_more
from flgpr.commands.score_request import (
    PANELS,
    Book,
    Columns,
    Far,
    ListAnchor,
    Recipes,
    Truth,
    TruthColumns,
    Unranked,
    Vendor,
    Witness,
    path_of_list,
    require_lists,
    require_witnessed,
    score_request,
    truth_path,
)
from flgpr.commands.score_text import comparison_lines
from flgpr.commands.shell import Arguments, command
from flgpr.door import Folder

if TYPE_CHECKING:
    from flgpr.scoring import SideBySide


def comparison_text(returned: SideBySide, call: Arguments) -> Iterator[Any]:
    """Yield the points of all detectors, their differences, the answer, and where the page is."""
    from flgpr.scoring.comparison import side_by_side_in_words

    yield from comparison_lines(returned)
    yield f"{side_by_side_in_words(returned)}."
    yield f"page: {(Path(call.output or 'score') / 'comparison.html').resolve()}"


def comparison_json(_: SideBySide | None, call: Arguments) -> Any:
    """Return the JSON that was written."""
    return Folder(Path(call.output or "score")).json("comparison.json")


@command(
    lines=comparison_text,
    as_json=comparison_json,
    panels={**PANELS, "Register and sealed truth": ("recipe", "book", "witness")},
)
def compare(
    alarms: ResultsLike,
    truth: Truth = None,
    lane: LaneOption = None,
    output: OptionalOutput = None,
    halo: float | None = None,
    far: Far = None,
    recipe: Recipes = None,
    book: Book = None,
    witness: Witness = None,
    columns: Columns = None,
    truth_columns: TruthColumns = None,
    anchor: ListAnchor = None,
    vendor: Vendor = None,
    unranked: Unranked = False,
    overwrite: Overwrite = False,
) -> SideBySide:
    """Compare two results or alarm lists, or more, against the same open truth.

    Parameters
    ----------
    alarms
        Result folders and alarm lists (CSV), two or more.
    halo
        Halo radius in metres; by default that of the results, or 1 m.
    lane
        or a CSV of several; results have their own
    output
        folder of the page and its JSON

    Returns
    -------
    SideBySide
        Points of each list and differences of every two.

    Raises
    ------
    ValueError
        If there are fewer than two lists, options do not go together, an input is not valid, or a
        register does not hold a recipe.
    FileExistsError
        If another comparison is at the output and is not to be overwritten.
    """
    asked = locals()
    from flgpr.commands.scoring import compare_lists

    lists = [path_of_list(entry) for entry in one_or_more(alarms)]
    require_witnessed(witness, book)
    if len(lists) < 2:
        raise ValueError(f"alarms must be two or more to be compared, got {len(lists)}")
    require_lists(lists)
    with truth_path(truth, None) as truth_file:
        folder = Path(output or "score")
        return compare_lists(score_request(asked, lists, truth_file, folder, "comparison.json"))
