"""The command score: one list of alarms or several, against truth that is open or sealed."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.common import (
    Json,
    Overwrite,
    Quiet,
    plain_errors,
    progress,
    tell_written,
    with_witness,
)
from flgpr.cli.show import (
    agreement_json,
    agreement_lines,
    comparison_lines,
    print_scores,
    score_summary,
)
from flgpr.door import MOST_JSON, Folder, parse_json


class Show(StrEnum):
    """What the scores of a sealed truth may tell."""

    curve = "curve"
    targets = "targets"


def score(
    alarms: Annotated[
        list[Path],
        Argument(
            help="Result folder, or an alarm list (CSV) of any detector; several are compared; see --agreement."
        ),
    ],
    truth: Annotated[Path | None, Option(help="CSV of the targets.")] = None,
    objects: Annotated[
        Path | None, Option(help="CSV of rocks, posts and the like, for a result's pictures.")
    ] = None,
    lane: Annotated[
        Path | None, Option(help="TOML or CSV of the lane or lanes; a result folder has its own.")
    ] = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", help="Folder for report and JSON; or the sealed file."),
    ] = None,
    halo: Annotated[
        float | None,
        Option(
            help="Halo radius in metres, for alarm lists (1 m by default); a result has its recipe's."
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
        Show | None,
        Option(
            help="With --seal: scores may tell the curve and counts (default), or also which targets."
        ),
    ] = None,
    sealed: Annotated[
        Path | None, Option(help="Sealed truth to score against, by the rules it was sealed with.")
    ] = None,
    recipe: Annotated[
        list[str] | None,
        Option(help="Recipe that must stand in the register; once per alarm list."),
    ] = None,
    book: Annotated[
        Path | None, Option(help="Register of recipes and openings; a planned truth names its own.")
    ] = None,
    witness: Annotated[
        Path | None,
        Option(
            help="A file elsewhere that must know the lines of the register (--book), or else of the log of looks "
            "(--sealed); told of new ones."
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
            help="Columns of the alarm lists that have other names: x=Rechts,y=Hoch,confidence=Score."
        ),
    ] = None,
    truth_columns: Annotated[str | None, Option(help="The same of the truth.")] = None,
    anchor: Annotated[
        Path | None,
        Option(
            help="TOML that ties the lane to the Earth, for lists and truth by longitude and latitude."
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score a result or an alarm list against truth, open or sealed, or set several side by side."""
    given: dict[str, Any] = {"truth": truth, "objects": objects, "lane": lane, "sealed": sealed}
    given |= {"halo": halo, "far": far, "show": show, "recipe": recipe or None}
    given |= {"columns": columns, "truth-columns": truth_columns, "anchor": anchor}
    with plain_errors(quiet):
        of_looks = witness if sealed is not None and book is None else None
        watched = with_witness(book, None if of_looks else witness)
        if agreement:
            more = {"output": output, "book": book, "seal": seal or None}
            _refuse(
                given | more,
                (),
                "--agreement compares verdicts with one another and prints the table",
            )
            _say_agreement(alarms, quiet, as_json)
            return
        if seal:
            _refuse(given, ("lane", "halo", "show"), "--seal seals a truth with its lane and halo")
            path = _seal(
                alarms, lane, output, {"halo": halo, "show": show and show.value, "book": watched}
            )
            tell_written(quiet, path)
            return
        several = len(alarms) > 1
        home = output or Path("score")
        recipes: list[Any] = recipe or []
        if not several and len(recipes) > 1:
            raise ValueError(
                f"recipe must be given once per alarm list, got {len(recipes)} for 1 list"
            )
        how: dict[str, Any] = (
            {"recipes": recipes} if several else {"recipe": recipes[0] if recipes else None}
        )
        how["book"] = watched
        if sealed is not None:
            _refuse(
                given,
                ("sealed", "recipe"),
                "--sealed scores by the rules that the truth was sealed with",
            )
            tasks.require_seal()
            how["witness"] = of_looks
            if not overwrite and tasks.holds_sealed_score(alarms, sealed, home, recipes, watched):
                if as_json:
                    name = "comparison.json" if several else "roc.json"
                    typer.echo(json.dumps(parse_json(Folder(home).read(name, MOST_JSON))))
                return
            if several:
                pairs = tasks.compare_sealed(alarms, sealed, _passphrase, home, **how)
                _say_comparison(pairs, home, quiet, as_json)
            else:
                _say_blind(
                    tasks.score_sealed(alarms[0], sealed, _passphrase, home, **how),
                    home,
                    quiet,
                    as_json,
                )
            return
        readings = ("columns", "truth-columns", "anchor")
        _refuse(
            given,
            ("truth", "objects", "lane", "halo", "far", "recipe", *readings),
            "--show goes with --seal",
        )
        if truth is None:
            raise ValueError("score needs --truth or --sealed, got neither")
        rules: dict[str, Any] = {
            name: value for name, value in (("halo", halo), ("far", far)) if value is not None
        }
        how["truth_reading"] = tasks.table_reading(truth_columns, anchor)
        reading = tasks.table_reading(columns, anchor)
        if reading is not None:
            how["reading"] = reading
        if several:
            _refuse({"objects": objects}, (), "several lists are compared without pictures")
            told = tasks.compare_alarms(
                alarms, truth, home, lane, overwrite=overwrite, **rules, **how
            )
            _say_comparison(told, home, quiet, as_json)
            return
        _score_one(
            alarms[0],
            truth,
            objects,
            lane,
            output,
            rules | how | {"overwrite": overwrite},
            quiet,
            as_json,
        )


def _say_agreement(files: list[Path], quiet: bool, as_json: bool) -> None:
    pairs = tasks.analyst_agreement(files)
    if as_json:
        typer.echo(json.dumps(agreement_json(pairs)))
    elif not quiet:
        typer.echo("\n".join(agreement_lines(pairs)))


def _refuse(given: dict[str, Any], allowed: tuple[str, ...], why: str) -> None:
    """Refuse options that would be dropped."""
    strange = [
        f"--{name}" for name, value in given.items() if value is not None and name not in allowed
    ]
    if strange:
        raise ValueError(f"{why}, got {' and '.join(strange)}")


def _score_one(
    alarms: Path,
    truth: Path,
    objects: Path | None,
    lane: Path | None,
    output: Path | None,
    how: dict[str, Any],
    quiet: bool,
    as_json: bool,
) -> None:
    if lane is None and alarms.suffix == ".csv" and not (alarms.parent / "manifest.json").is_file():
        raise ValueError(
            f"an alarm list needs --lane (x_min, x_max, y_min, y_max), got {alarms} without it"
        )
    with progress(quiet or as_json) as track:
        if lane is not None:
            _refuse({"objects": objects}, (), "an alarm list is scored without pictures")
            home = output or Path("score")
            scored = tasks.score_alarms(alarms, truth, lane, home, **how)
        else:
            _refuse({"halo": how.get("halo")}, (), "a result is scored by the halo of its recipe")
            reading = how.pop("reading", None)
            if reading is not None and reading.columns:
                raise ValueError(
                    "columns are of alarm lists: a result's list has its own; see --truth-columns"
                )
            folder = alarms.parent if alarms.name == "alarms.csv" else alarms
            home = output or tasks.score_home(folder)
            _, scored = tasks.score_result(folder, truth, objects, home, track, **how)
    if as_json:
        typer.echo(json.dumps(score_summary(home, scored)))
    elif not quiet:
        print_scores(scored)
        typer.echo(f"report: {(home / 'report.html').resolve()}")


def _seal(
    truths: list[Path], lane: Path | None, output: Path | None, rules: dict[str, Any]
) -> Path:
    if lane is None or output is None or len(truths) > 1:
        raise ValueError(
            "--seal needs one truth, --lane and --output, got none or several of one of them"
        )
    tasks.require_seal()
    chosen = {name: value for name, value in rules.items() if value is not None}
    return tasks.seal(truths[0], lane, output, _new_passphrase, **chosen)


def _passphrase() -> str:
    return str(typer.prompt("passphrase", hide_input=True, err=True))


def _new_passphrase() -> str:
    """Ask for a passphrase twice; one that is easy to guess is refused before it is typed again."""
    phrase = str(typer.prompt(f"passphrase ({tasks.PASSPHRASE_RULE})", hide_input=True, err=True))
    tasks.check_passphrase(phrase)
    if phrase != typer.prompt("Repeat for confirmation", hide_input=True, err=True):
        raise ValueError(
            "passphrase must be typed twice alike, got two different ones: nothing was sealed"
        )
    return phrase


def _say_blind(told: Any, home: Path, quiet: bool, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(Folder(home).json("roc.json")))
    if quiet or as_json:
        return
    typer.echo(told.points.to_string(index=False, float_format=lambda value: f"{value:.3g}"))
    if told.targets is not None:
        typer.echo(
            told.targets.to_string(
                index=False, na_rep="never", float_format=lambda value: f"{value:.3g}"
            )
        )
    counts = {
        name: f"{value:.6g}" if isinstance(value, float) else value
        for name, value in told.counts.items()
    }
    typer.echo(", ".join(f"{name} {value}" for name, value in counts.items()))
    typer.echo(
        f"look {told.looks} at this truth, different alarm lists so far: {told.lists}; "
        "the seal guards against accidents, not against the holder of the passphrase"
    )
    for name, head in told.heads.items():
        typer.echo(f"{name}: {head['lines']} lines, the last is {head['head']}")
    typer.echo(f"report: {(home / 'report.html').resolve()}")


def _say_comparison(told: Any, home: Path, quiet: bool, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(Folder(home).json("comparison.json")))
    elif not quiet:
        typer.echo("\n".join(comparison_lines(told)))
        typer.echo(f"page: {(home / 'comparison.html').resolve()}")
