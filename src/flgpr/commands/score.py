"""``flgpr score``: a result or an alarm list of any detector, against truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from flgpr.commands.agree import agree, agreement_json, agreement_lines
from flgpr.commands.options import (
    Overwrite,
    PathLike,
    Progress,
    ResultsLike,
    ShellType,
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
    Show,
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
from flgpr.commands.shell import Arguments, ErrorStreamText, command
from flgpr.commands.trials import needed_trials


def _lines(returned: Any, call: Arguments) -> Iterator[Any]:
    """Yield what is printed of a score, and how an earlier spelling is written now."""
    if call.seal:
        yield returned
        yield ErrorStreamText("`flgpr score --seal` is `flgpr seal` now")
    elif call.agreement:
        yield from agreement_lines(returned)
        yield ErrorStreamText("`flgpr score --agreement` is `flgpr agree` now")
    else:
        yield from answer_lines(returned, Path(call.output or "score"))
        if len(call.alarms) > 1:
            yield ErrorStreamText("`flgpr score` of several lists is `flgpr compare` now")


def _as_json(returned: Any, call: Arguments) -> Any:
    """Return the summary of a score, the agreements, or the JSON that was written."""
    if call.agreement:
        return agreement_json(returned)
    report = "comparison.json" if len(call.alarms) > 1 else "roc.json"
    return answer_json(returned, Path(call.output or "score"), report)


def _passphrase(call: Arguments) -> dict[str, Any]:
    """Return the function that asks for the passphrase, where one is needed."""

    def ask() -> str:
        trials = needed_trials("`sealed`")
        return trials.ask_new_passphrase() if call.seal else trials.ask_passphrase()

    return {"passphrase": ask}


@command(
    lines=_lines,
    as_json=_as_json,
    python_values=_passphrase,
    panels={**PANELS, "Earlier spellings": ("seal", "show", "agreement")},
)
def score(
    alarms: Annotated[
        ResultsLike,
        "Result folder, or an alarm list (CSV) of any detector.",
    ],
    truth: Truth = None,
    objects: Annotated[
        PathLike | None, "CSV of rocks, posts and the like, for a result's pictures."
    ] = None,
    lane: Annotated[
        PathLike | None,
        lane_option("or a CSV of several; a result folder has its own"),
    ] = None,
    output: Annotated[
        PathLike | None,
        output_option("folder of the report and its JSON"),
    ] = None,
    halo: Annotated[
        float | None,
        "Halo radius in metres, for alarm lists (1 m by default); a result has its recipe's.",
    ] = None,
    far: Far = None,
    seal: Annotated[bool, "The same as flgpr seal."] = False,
    show: Annotated[str | None, "With --seal: see flgpr seal.", ShellType(Show)] = None,
    sealed: Sealed = None,
    recipe: Recipes = None,
    book: Book = None,
    witness: Witness = None,
    agreement: Annotated[bool, "The same as flgpr agree."] = False,
    columns: Columns = None,
    truth_columns: TruthColumns = None,
    anchor: ListAnchor = None,
    vendor: Vendor = None,
    unranked: Unranked = False,
    overwrite: Overwrite = False,
    *,
    passphrase: Passphrase = None,
    track: Progress = None,
) -> Any:
    """Score a result or an alarm list against truth, open or sealed.

    Returns
    -------
    Scored, BlindScore, SideBySide, pathlib.Path, dict or None
        For a result or a list its scores and the folder of the report; for a sealed truth what it
        lets be known, or None where this score exists already. Earlier spellings return what
        :func:`flgpr.commands.compare.compare`, :func:`flgpr.trials.seal` and
        :func:`flgpr.commands.agree.agree` do.

    Raises
    ------
    ValueError
        If options do not go together, an input is not valid, or a register does not hold a recipe.
    FileExistsError
        If another score is at the output and is not to be overwritten.
    """
    from flgpr.commands.positions import table_reading
    from flgpr.commands.scoring import compare_lists, score_one, score_output
    from flgpr.commands.trial_card import stated_card
    from flgpr.progress import silent

    lists = [path_of_list(entry) for entry in one_or_more(alarms)]
    of_open_truth = {
        "truth": truth,
        "objects": objects,
        "far": far,
        "columns": columns,
        "truth_columns": truth_columns,
        "anchor": anchor,
    }
    of_lists = {
        "sealed": sealed,
        "recipe": recipe or None,
        "vendor": vendor or None,
        "unranked": unranked or None,
    }
    ground = {"lane": lane, "halo": halo, "show": show}
    require_witnessed(witness, book, sealed)
    if agreement:
        others = {"output": output, "book": book, "seal": seal or None}
        why = "`agreement` compares verdicts with one another and prints the table"
        refuse(of_open_truth | of_lists | ground | others, why)
        return agree(lists)
    if seal:
        refuse(of_open_truth | of_lists, "`seal` seals a truth with its lane and halo")
        require_lists(lists, "truth file")
        if lane is None or output is None or len(lists) > 1:
            raise ValueError(
                "`seal` needs one truth, `lane` and `output`, got none or several of one of them"
            )
        seal_truth = needed_trials("`seal`").seal
        return seal_truth(lists[0], lane, output, halo, show, book, witness, passphrase=passphrase)
    if sealed is not None:
        why = "`sealed` scores by the rules that the truth was sealed with"
        refuse(of_open_truth | ground, why)
    refuse({"show": show}, "`show` goes with `seal`")
    require_lists(lists)

    several = len(lists) > 1
    if several and sealed is not None:
        raise ValueError(
            "`sealed` scores one list, and `flgpr trial verdict` judges several, "
            f"got {len(lists)} lists"
        )
    folder = score_output(lists, lane, output if sealed is None else output or "score")
    report = "comparison.json" if several else "roc.json"
    with truth_path(truth, sealed) as truth_file:
        request = ScoreRequest(
            lists=lists,
            truth=truth_file,
            output=folder,
            lane=lane,
            objects=objects,
            rules=given({"halo": halo, "far": far}),
            reading=table_reading(columns, anchor, unranked),
            truth_reading=table_reading(truth_columns, anchor),
            trial=Trial(one_or_more(recipe), book, witness, passphrase),
            card=stated_card(one_or_more(vendor), len(lists), folder, report, overwrite),
            overwrite=overwrite,
        )
        if sealed is not None:
            return needed_trials("`sealed`").score_sealed(request)
        if several:
            refuse({"objects": objects}, "several lists are compared without pictures")
            return compare_lists(request)
        scored = score_one(request, track or silent)
    # A result in memory may lie in a temporary folder, which lives as long as the result.
    return dataclasses.replace(scored, source=one_or_more(alarms)[0])
