"""``flgpr score``: one list of alarms or several, against truth that is open or sealed."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from flgpr.commands.options import (
    OneOrMorePaths,
    Overwrite,
    PathLike,
    Progress,
    ResultsLike,
    ShellType,
    TruthLike,
    anchor_option,
    lane_option,
    one_or_more,
    output_option,
)
from flgpr.commands.score_text import (
    agreement_json,
    agreement_lines,
    blind_lines,
    comparison_lines,
    score_lines,
    score_summary,
)
from flgpr.commands.shell import Arguments, command
from flgpr.door import MOST_JSON, Folder
from flgpr.json_text import parse_json

if TYPE_CHECKING:
    from flgpr.commands.scoring import Scored


class Show(StrEnum):
    """What the scores of a sealed truth may tell."""

    curve = "curve"
    targets = "targets"


def _lines(returned: Any, call: Arguments) -> Iterator[Any]:
    """Yield what is printed of a score, a comparison, a sealed truth or an agreement."""
    from flgpr.commands.scoring import Scored
    from flgpr.scoring import SideBySide
    from flgpr.trials import BlindScore

    if isinstance(returned, Path):  # a truth was sealed
        yield returned
    elif isinstance(returned, Scored):
        yield from score_lines(returned.scores)
        yield f"report: {(returned.folder / 'report.html').resolve()}"
    elif isinstance(returned, SideBySide):
        yield from comparison_lines(returned)
        yield f"page: {(_output_folder(call) / 'comparison.html').resolve()}"
    elif isinstance(returned, BlindScore):
        yield from blind_lines(returned)
        yield f"report: {(_output_folder(call) / 'report.html').resolve()}"
    elif returned is not None:
        yield from agreement_lines(returned)


def _as_json(returned: Any, call: Arguments) -> Any:
    """Return the summary of a score, the agreements, or the JSON that was written."""
    from flgpr.commands.scoring import Scored

    if isinstance(returned, Scored):
        return score_summary(returned.folder, returned.scores)
    if call.agreement:
        return agreement_json(returned)
    name = "comparison.json" if len(call.alarms) > 1 else "roc.json"
    return parse_json(Folder(_output_folder(call)).read(name, MOST_JSON))


def _output_folder(call: Arguments) -> Path:
    """Return the folder of the report."""
    return Path(call.output or "score")


_BEFORE_OPENING = (
    "The passphrase is the one that this truth was sealed with. Nothing is shown while you type. "
    "A right one makes this score a look at the truth, which is counted in its log for good; a "
    "wrong one changes nothing."
)


def _ask_passphrase() -> str:
    """Ask for the passphrase of a sealed truth on the terminal, after its rules."""
    typer.echo(_BEFORE_OPENING, err=True)
    return str(typer.prompt("passphrase", hide_input=True, err=True))


def _ask_new_passphrase() -> str:
    """Ask for a passphrase twice, after its rules; a weak one is refused before it is repeated."""
    from flgpr.trials import PASSPHRASE_RULE, check_passphrase

    typer.echo(f"The passphrase must have {PASSPHRASE_RULE}.", err=True)
    typer.echo("It is asked for twice. Nothing is shown while you type.", err=True)
    phrase = str(typer.prompt("passphrase", hide_input=True, err=True))
    check_passphrase(phrase)
    if phrase != typer.prompt("Repeat for confirmation", hide_input=True, err=True):
        raise ValueError(
            "passphrase must be typed twice alike, got two different ones: nothing was sealed"
        )
    return phrase


def _passphrase(call: Arguments) -> dict[str, Any]:
    """Return the function that asks for the passphrase, where one is needed."""
    return {"passphrase": _ask_new_passphrase if call.seal else _ask_passphrase}


@command(
    lines=_lines,
    as_json=_as_json,
    python_values=_passphrase,
    panels={
        "Truth and rules": ("truth", "objects", "lane", "halo", "far"),
        "Lists of others": ("columns", "truth_columns", "anchor", "vendor", "unranked"),
        "Sealed truth": ("seal", "show", "sealed"),
        "Register": ("recipe", "book", "witness"),
        "Analysts": ("agreement",),
    },
)
def score(
    alarms: Annotated[
        ResultsLike,
        Argument(
            help="Result folder, or an alarm list (CSV) of any detector; several are compared; "
            "see --agreement."
        ),
    ],
    truth: Annotated[TruthLike | None, Option(help="CSV of the targets.")] = None,
    objects: Annotated[
        PathLike | None, Option(help="CSV of rocks, posts and the like, for a result's pictures.")
    ] = None,
    lane: Annotated[
        PathLike | None,
        lane_option("or a CSV of several; a result folder has its own"),
    ] = None,
    output: Annotated[
        PathLike | None,
        output_option("folder of the report and its JSON; or the sealed file"),
    ] = None,
    halo: Annotated[
        float | None,
        Option(
            help="Halo radius in metres, for alarm lists (1 m by default); a result has its "
            "recipe's."
        ),
    ] = None,
    far: Annotated[
        float | None,
        Option(help="Operating point at which targets count as found, false alarms per m² (0.05)."),
    ] = None,
    seal: Annotated[
        bool, Option("--seal", help="Encrypt the truth given as the argument for blind scoring.")
    ] = False,
    show: Annotated[
        str | None,
        Option(
            help="With --seal: what scores show, curve and counts (default) or also which targets "
            "are found."
        ),
        ShellType(Show),
    ] = None,
    sealed: Annotated[
        PathLike | None,
        Option(help="Sealed truth to score against, by the rules it was sealed with."),
    ] = None,
    recipe: Annotated[
        OneOrMorePaths | None,
        Option(help="Recipe that must stand in the register; once per alarm list."),
        ShellType(list[str]),
    ] = None,
    book: Annotated[
        PathLike | None,
        Option(help="Register of recipes and openings; a planned truth names its own."),
    ] = None,
    witness: Annotated[
        PathLike | None,
        Option(
            help="A file elsewhere that must hold the lines of the register (--book), or else of "
            "the "
            "log of looks (--sealed); new lines are added to it."
        ),
    ] = None,
    agreement: Annotated[
        bool,
        Option(
            "--agreement",
            help="Compare verdicts of analysts (JSON of flgpr view) with one another.",
        ),
    ] = False,
    columns: Annotated[
        str | None,
        Option(
            help="Columns of the alarm lists that have other names: "
            "x=Rechts,y=Hoch,confidence=Score."
        ),
    ] = None,
    truth_columns: Annotated[str | None, Option(help="The same for the truth.")] = None,
    anchor: Annotated[
        PathLike | None,
        anchor_option("for lists and truth by longitude and latitude"),
    ] = None,
    vendor: Annotated[
        str | Sequence[str] | None,
        Option(
            help="Whose alarms they are, for the head of every page; once per alarm list. By "
            "default what a comment at the head of the list says: # vendor: NAME."
        ),
        ShellType(list[str]),
    ] = None,
    unranked: Annotated[
        bool,
        Option(
            "--unranked",
            help="Take alarm lists without confidences: all alarms of such a list rank equal, and "
            "it has one operating point.",
        ),
    ] = False,
    overwrite: Overwrite = False,
    *,
    passphrase: Annotated[Any, "Of a sealed truth: a text, or a function that asks for it."] = None,
    track: Progress = None,
) -> Any:
    """Score a result or an alarm list against truth, open or sealed, or compare several lists.

    Returns
    -------
    Scored, SideBySide, BlindScore, pathlib.Path, dict or None
        For a result or a list its scores and the folder of the report; for several lists their
        comparison; for a sealed truth what it lets be known, or None where this score exists
        already; with ``seal`` the sealed file; with ``agreement`` the agreement of every two
        analysts.

    Raises
    ------
    ValueError
        If options do not go together, an input is not valid, or a register does not hold a recipe.
    FileExistsError
        If another score is at the output and is not to be overwritten.
    """
    from flgpr.commands.analysts import analyst_agreement
    from flgpr.commands.positions import table_reading
    from flgpr.commands.registering import with_witness
    from flgpr.commands.trial_card import TrialCard, checked_vendors, day_of_score

    lists = [_path_of(entry) for entry in one_or_more(alarms)]
    if not agreement:
        _require_lists(lists, seal)
    recipes = one_or_more(recipe)
    vendors = [str(name) for name in one_or_more(vendor)]
    # Options that have no effect are refused, not dropped without a word.
    options: dict[str, Any] = {
        "truth": truth,
        "objects": objects,
        "lane": lane,
        "sealed": sealed,
        "halo": halo,
        "far": far,
        "show": show,
        "recipe": recipes or None,
        "columns": columns,
        "truth-columns": truth_columns,
        "anchor": anchor,
        "vendor": vendors or None,
        "unranked": unranked or None,
    }

    if witness is not None and book is None and sealed is None:
        raise ValueError(f"--witness goes with --book or --sealed, got --witness {witness} alone")
    register = None if book is None else with_witness(book, witness)

    if agreement:
        options |= {"output": output, "book": book, "seal": seal or None}
        _refuse(options, (), "--agreement compares verdicts with one another and prints the table")
        return analyst_agreement(lists)

    if seal:
        _refuse(options, ("lane", "halo", "show"), "--seal seals a truth with its lane and halo")
        seal_rules = {"halo": halo, "show": show and str(show), "register": register}
        return _seal_truth(lists, lane, output, passphrase, _without_none(seal_rules))

    if len(lists) == 1 and len(recipes) > 1:
        raise ValueError(f"recipe must be given once per alarm list, got {len(recipes)} for 1 list")

    report = "comparison.json" if len(lists) > 1 else "roc.json"
    score_output = _score_output(lists, output)
    card = TrialCard(
        vendors=checked_vendors(vendors, len(lists)),
        scored_on=day_of_score(score_output, report, overwrite),
    )

    if sealed is not None:
        why = "--sealed scores by the rules that the truth was sealed with"
        _refuse(options, ("sealed", "recipe", "vendor", "unranked"), why)
        # A witness of the register is already part of it; without one it is that of the log.
        trial = {
            "register": register,
            "witness": witness if book is None else None,
            "reading": table_reading(unranked=unranked),
            "card": card,
        }
        folder = Path(output or "score")
        return _score_sealed(lists, sealed, passphrase, folder, recipes, overwrite, trial)

    _refuse({"show": show}, (), "--show goes with --seal")
    if truth is None:
        raise ValueError("score needs --truth or --sealed, got neither")

    reading = table_reading(columns, anchor, unranked)
    rules = _without_none({"halo": halo, "far": far, "reading": reading})
    rules["truth_reading"] = table_reading(truth_columns, anchor)
    rules["register"] = register
    rules["overwrite"] = overwrite
    rules["card"] = card
    if len(lists) > 1:
        _refuse({"objects": objects}, (), "several lists are compared without pictures")
        return _compare(lists, truth, output, lane, recipes, rules)
    rules["recipe"] = recipes[0] if recipes else None
    scored = _score_single(lists[0], truth, objects, lane, output, rules, track)
    # A result in memory may lie in a temporary folder, which lives as long as the result.
    return dataclasses.replace(scored, source=one_or_more(alarms)[0])


def _path_of(alarms: Any) -> Path:
    """Return the folder of a result, or the path of a file or folder."""
    return Path(alarms) if isinstance(alarms, str | Path) else Path(alarms.folder)


@contextmanager
def _truth_file(truth: TruthLike) -> Iterator[Path]:
    """Yield the file of a truth; a table in memory is written to a temporary one."""
    if isinstance(truth, str | Path):
        yield Path(truth)
        return
    from flgpr.store import write_table

    with tempfile.TemporaryDirectory(prefix="flgpr-") as folder:
        path = Path(folder) / "truth.csv"
        write_table(truth, path)
        yield path


def _require_lists(lists: list[Path], seal: bool) -> None:
    """Refuse, before anything else is asked for, an alarm list or a truth that is not there."""
    what = "truth file" if seal else "alarm list or result"
    for path in lists:
        if not path.exists():
            raise FileNotFoundError(f"{what} not found: {path}")


def _score_output(lists: list[Path], output: PathLike | None) -> Path:
    """Return the folder in which a score of these lists is written, or was before."""
    from flgpr.commands.scoring import score_folder
    from flgpr.results.sections import SECTIONS

    if output is not None:
        return Path(output)
    folder = lists[0].parent if lists[0].name == "alarms.csv" else lists[0]
    is_result = any((folder / name).is_file() for name in ("manifest.json", SECTIONS))
    return score_folder(folder) if is_result and len(lists) == 1 else Path("score")


def _compare(
    lists: list[Path],
    truth: TruthLike,
    output: PathLike | None,
    lane: PathLike | None,
    recipes: list[Any],
    rules: dict[str, Any],
) -> Any:
    """Compare several lists against an open truth."""
    from flgpr.commands.scoring import compare_alarms

    folder = Path(output or "score")
    with _truth_file(truth) as truth_path:
        return compare_alarms(lists, truth_path, folder, lane, recipes=recipes, **rules)


def _without_none(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in options.items() if value is not None}


def _refuse(options: Mapping[str, Any], allowed: tuple[str, ...], why: str) -> None:
    """Refuse options that have no effect here."""
    refused = [f"--{name}" for name in _without_none(options) if name not in allowed]
    if refused:
        raise ValueError(f"{why}, got {' and '.join(refused)}")


def _score_single(
    alarms: Path,
    truth: TruthLike,
    objects: PathLike | None,
    lane: PathLike | None,
    output: PathLike | None,
    rules: dict[str, Any],
    track: Any,
) -> Scored:
    """Score a result by its recipe's rules, or an alarm list by the rules of the options."""
    from flgpr.commands.scoring import Scored, score_alarms, score_folder, score_result
    from flgpr.progress import silent

    # The list inside a result is scored with the result, by its recipe's rules.
    is_list = alarms.suffix == ".csv" and not (alarms.parent / "manifest.json").is_file()
    if lane is None and is_list:
        raise ValueError(
            f"an alarm list needs --lane (x_min, x_max, y_min, y_max), got {alarms} without it"
        )
    if lane is not None:
        _refuse({"objects": objects}, (), "an alarm list is scored without pictures")
        folder = Path(output or "score")
        with _truth_file(truth) as truth_path:
            return Scored(folder, score_alarms(alarms, truth_path, lane, folder, **rules))
    _refuse({"halo": rules.get("halo")}, (), "a result is scored by the halo of its recipe")
    reading = rules.pop("reading", None)
    if reading is not None and (reading.columns or reading.unranked):
        name = "columns are" if reading.columns else "unranked is"
        raise ValueError(f"{name} of alarm lists: a result's list has its own; see --truth-columns")
    result_folder = alarms.parent if alarms.name == "alarms.csv" else alarms
    folder = score_folder(result_folder) if output is None else Path(output)
    with _truth_file(truth) as truth_path:
        result, scores = score_result(
            result_folder, truth_path, objects, folder, track or silent, **rules
        )
    return Scored(folder, scores, result)


def _score_sealed(
    lists: list[Path],
    sealed: PathLike,
    passphrase: Any,
    folder: Path,
    recipes: list[Any],
    overwrite: bool,
    trial: dict[str, Any],
) -> Any:
    """Score a list or compare several against a sealed truth; None where this score is there."""
    from flgpr.commands.sealed_scoring import (
        compare_sealed,
        holds_sealed_score,
        require_seal,
        score_sealed,
    )

    require_seal()
    if not overwrite and holds_sealed_score(lists, sealed, folder, recipes, trial["register"]):
        return None
    if len(lists) > 1:
        return compare_sealed(lists, sealed, passphrase, folder, recipes=recipes, **trial)
    recipe = recipes[0] if recipes else None
    return score_sealed(lists[0], sealed, passphrase, folder, recipe=recipe, **trial)


def _seal_truth(
    truths: list[Path],
    lane: PathLike | None,
    output: PathLike | None,
    passphrase: Any,
    rules: dict[str, Any],
) -> Path:
    """Seal a truth with its lane and rules."""
    from flgpr.commands.sealed_scoring import require_seal, seal_truth_file

    if lane is None or output is None or len(truths) > 1:
        raise ValueError(
            "--seal needs one truth, --lane and --output, got none or several of one of them"
        )
    require_seal()
    return seal_truth_file(truths[0], lane, output, passphrase, **rules)
