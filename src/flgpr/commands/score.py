"""``flgpr score``: a result or an alarm list of any detector, against truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from flgpr.commands.agree import agree, agreement_json, agreement_lines
from flgpr.commands.compare import compare, comparison_json, comparison_text
from flgpr.commands.options import (
    LaneOption,
    OptionalOutput,
    Overwrite,
    PathLike,
    Progress,
    ResultsLike,
    ShellType,
    one_or_more,
)
from flgpr.commands.score_request import (
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
    path_of_list,
    refuse,
    require_lists,
    require_witnessed,
    score_request,
    truth_path,
)
from flgpr.commands.score_text import score_lines, score_summary
from flgpr.commands.shell import Arguments, ErrorStreamText, command, options_given
from flgpr.commands.trials import needed_trials
from flgpr.door import Folder

_OF_AGREEMENT = {"alarms", "agreement", "overwrite"}
_OF_SEAL = {"alarms", "seal", "lane", "output", "halo", "show", "book", "witness", "overwrite"}
_NOT_SEALED = {
    "truth",
    "objects",
    "far",
    "columns",
    "truth_columns",
    "anchor",
    "lane",
    "halo",
    "show",
}
_WITHOUT_PICTURES = "several lists are compared without pictures"


def _lines(returned: Any, call: Arguments) -> Iterator[Any]:
    """Yield what is printed of a score, and how an earlier spelling is written now."""
    if call.seal:
        yield returned
        yield ErrorStreamText("`flgpr score --seal` is `flgpr seal` now")
    elif call.agreement:
        yield from agreement_lines(returned)
        yield ErrorStreamText("`flgpr score --agreement` is `flgpr agree` now")
    elif len(call.alarms) > 1:
        yield from comparison_text(returned, call)
        yield ErrorStreamText("`flgpr score` of several lists is `flgpr compare` now")
    elif returned is not None:  # else this very score of a sealed truth is there
        folder = Path(call.output or "score")
        if call.sealed is None:
            folder = returned.folder
            yield from score_lines(returned.scores)
        else:
            yield from needed_trials("`sealed`").lines(returned)
        yield f"report: {(folder / 'report.html').resolve()}"


def _as_json(returned: Any, call: Arguments) -> Any:
    """Return the summary of a score, the agreements, or the JSON that was written."""
    if call.agreement:
        return agreement_json(returned)
    if len(call.alarms) > 1:
        return comparison_json(returned, call)
    if call.sealed is None and not call.seal:
        return score_summary(returned)
    return Folder(Path(call.output or "score")).json("roc.json")


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
    alarms: ResultsLike,
    truth: Truth = None,
    objects: PathLike | None = None,
    lane: LaneOption = None,
    output: OptionalOutput = None,
    halo: float | None = None,
    far: Far = None,
    seal: bool = False,
    show: Annotated[str | None, ShellType(Show)] = None,
    sealed: Sealed = None,
    recipe: Recipes = None,
    book: Book = None,
    witness: Witness = None,
    agreement: bool = False,
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

    Parameters
    ----------
    alarms
        Result folder, or an alarm list (CSV) of any detector.
    objects
        CSV of rocks, posts and the like, for a result's pictures.
    halo
        Halo radius in metres, for alarm lists (1 m by default); a result has its recipe's.
    seal
        The same as flgpr seal.
    show
        With --seal: see flgpr seal.
    agreement
        The same as flgpr agree.
    lane
        or a CSV of several; a result folder has its own
    output
        folder of the report and its JSON

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
    asked = locals()
    from flgpr.commands.scoring import score_one, score_output
    from flgpr.progress import silent

    lists = [path_of_list(entry) for entry in one_or_more(alarms)]
    options = options_given(score, asked)
    require_witnessed(witness, book, sealed)
    if agreement:
        why = "`agreement` compares verdicts with one another and prints the table"
        refuse((name for name in options if name not in _OF_AGREEMENT), why)
        return agree(lists)
    if seal:
        why = "`seal` seals a truth with its lane and halo"
        refuse((name for name in options if name not in _OF_SEAL), why)
        require_lists(lists, "truth file")
        if lane is None or output is None or len(lists) > 1:
            raise ValueError(
                "`seal` needs one truth, `lane` and `output`, got none or several of one of them"
            )
        seal_truth = needed_trials("`seal`").seal
        return seal_truth(lists[0], lane, output, halo, show, book, witness, passphrase=passphrase)
    if sealed is not None:
        why = "`sealed` scores by the rules that the truth was sealed with"
        refuse((name for name in options if name in _NOT_SEALED), why)
    refuse((name for name in options if name == "show"), "`show` goes with `seal`")
    require_lists(lists)

    if len(lists) > 1:
        if sealed is not None:
            raise ValueError(
                "`sealed` scores one list, and `flgpr trial verdict` judges several, "
                f"got {len(lists)} lists"
            )
        refuse((name for name in options if name == "objects"), _WITHOUT_PICTURES)
        names = [one.name for one in compare.__dict__["command"].parameters]
        return compare(**{name: asked[name] for name in names})
    folder = score_output(lists, lane, output if sealed is None else output or "score")
    with truth_path(truth, sealed) as truth_file:
        request = score_request(asked, lists, truth_file, folder, "roc.json")
        if sealed is not None:
            return needed_trials("`sealed`").score_sealed(request)
        scored = score_one(request, track or silent)
    # A result in memory may lie in a temporary folder, which lives as long as the result.
    return dataclasses.replace(scored, source=one_or_more(alarms)[0])
