"""``flgpr compare``: several results or alarm lists against the same truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

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
    Passphrase,
    Recipes,
    Sealed,
    Truth,
    TruthColumns,
    Unranked,
    Vendor,
    Witness,
    given,
    path_of_list,
    refuse,
    require_lists,
    require_witnessed,
    truth_path,
)
from flgpr.commands.score_request import ScoreRequest, Trial
from flgpr.commands.score_text import answer_json, answer_lines
from flgpr.commands.shell import Arguments, command
from flgpr.commands.trials import needed_trials

if TYPE_CHECKING:
    from flgpr.scoring import SideBySide


def _lines(returned: SideBySide | None, call: Arguments) -> Iterator[Any]:
    """Yield the points of all detectors, their differences, and where the page is."""
    yield from answer_lines(returned, Path(call.output or "score"))


def _as_json(returned: SideBySide | None, call: Arguments) -> Any:
    """Return the JSON that was written."""
    return answer_json(returned, Path(call.output or "score"), "comparison.json")


def _passphrase(_: Arguments) -> dict[str, Any]:
    """Return the function that asks for the passphrase of a sealed truth."""
    return {"passphrase": lambda: needed_trials("`sealed`").ask_passphrase()}


@command(lines=_lines, as_json=_as_json, python_values=_passphrase, panels=PANELS)
def compare(
    alarms: Annotated[
        ResultsLike, Argument(help="Result folders and alarm lists (CSV), two or more.")
    ],
    truth: Truth = None,
    lane: Annotated[
        PathLike | None, lane_option("or a CSV of several; results have their own")
    ] = None,
    output: Annotated[PathLike | None, output_option("folder of the page and its JSON")] = None,
    halo: Annotated[
        float | None, Option(help="Halo radius in metres; by default that of the results, or 1 m.")
    ] = None,
    far: Far = None,
    sealed: Sealed = None,
    recipe: Recipes = None,
    book: Book = None,
    witness: Witness = None,
    columns: Columns = None,
    truth_columns: TruthColumns = None,
    anchor: ListAnchor = None,
    vendor: Vendor = None,
    unranked: Unranked = False,
    overwrite: Overwrite = False,
    *,
    passphrase: Passphrase = None,
) -> SideBySide | None:
    """Compare two results or alarm lists, or more, against the same truth, open or sealed.

    Returns
    -------
    SideBySide or None
        Points of each list and differences of every two; None where this comparison against a
        sealed truth exists already.

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
    require_witnessed(witness, book, sealed)
    if len(lists) < 2:
        raise ValueError(f"alarms must be two or more to be compared, got {len(lists)}")
    if sealed is not None:
        of_open_truth = {
            "truth": truth,
            "lane": lane,
            "halo": halo,
            "far": far,
            "columns": columns,
            "truth_columns": truth_columns,
            "anchor": anchor,
        }
        refuse(of_open_truth, "`sealed` compares by the rules that the truth was sealed with")
    require_lists(lists)

    folder = Path(output or "score")
    vendors = one_or_more(vendor)
    with truth_path(truth, sealed) as truth_file:
        request = ScoreRequest(
            lists=lists,
            truth=truth_file,
            output=folder,
            lane=lane,
            rules=given({"halo": halo, "far": far}),
            reading=table_reading(columns, anchor, unranked),
            truth_reading=table_reading(truth_columns, anchor),
            trial=Trial(one_or_more(recipe), book, witness, passphrase),
            card=stated_card(vendors, len(lists), folder, "comparison.json", overwrite),
            overwrite=overwrite,
        )
        if sealed is not None:
            compared: SideBySide | None = needed_trials("`sealed`").score_sealed(request)
            return compared
        return compare_lists(request)
