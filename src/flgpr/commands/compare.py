"""``flgpr compare``: several results or alarm lists against the same truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import (
    Overwrite,
    PathLike,
    ResultsLike,
    lane_option,
    one_or_more,
    output_option,
)
from flgpr.commands.score_options import (
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
    given,
    path_of_list,
    require_lists,
    require_witnessed,
    truth_path,
)
from flgpr.commands.score_request import ScoreRequest, Trial
from flgpr.commands.score_text import answer_json, answer_lines
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.scoring import SideBySide


def _lines(returned: SideBySide, call: Arguments) -> Iterator[Any]:
    """Yield the points of all detectors, their differences, and where the page is."""
    yield from answer_lines(returned, Path(call.output or "score"))


def _as_json(returned: SideBySide, call: Arguments) -> Any:
    """Return the JSON that was written."""
    return answer_json(returned, Path(call.output or "score"), "comparison.json")


@command(
    lines=_lines,
    as_json=_as_json,
    panels={**PANELS, "Register and sealed truth": ("recipe", "book", "witness")},
)
def compare(
    alarms: Annotated[ResultsLike, "Result folders and alarm lists (CSV), two or more."],
    truth: Truth = None,
    lane: Annotated[
        PathLike | None, lane_option("or a CSV of several; results have their own")
    ] = None,
    output: Annotated[PathLike | None, output_option("folder of the page and its JSON")] = None,
    halo: Annotated[
        float | None, "Halo radius in metres; by default that of the results, or 1 m."
    ] = None,
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
    from flgpr.commands.positions import table_reading
    from flgpr.commands.scoring import compare_lists
    from flgpr.commands.trial_card import stated_card

    lists = [path_of_list(entry) for entry in one_or_more(alarms)]
    require_witnessed(witness, book)
    if len(lists) < 2:
        raise ValueError(f"alarms must be two or more to be compared, got {len(lists)}")
    require_lists(lists)

    folder = Path(output or "score")
    vendors = one_or_more(vendor)
    with truth_path(truth, None) as truth_file:
        request = ScoreRequest(
            lists=lists,
            truth=truth_file,
            output=folder,
            lane=lane,
            rules=given({"halo": halo, "far": far}),
            reading=table_reading(columns, anchor, unranked),
            truth_reading=table_reading(truth_columns, anchor),
            trial=Trial(one_or_more(recipe), book, witness),
            card=stated_card(vendors, len(lists), folder, "comparison.json", overwrite),
            overwrite=overwrite,
        )
        return compare_lists(request)
