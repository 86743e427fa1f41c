"""What flgpr score and flgpr compare can be asked for: options, and one record of them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import (
    ANCHOR,
    OneOrMorePaths,
    PathLike,
    ShellType,
    TruthLike,
    one_or_more,
)

if TYPE_CHECKING:
    from flgpr.commands.entrants import TrialCard
    from flgpr.store.dialects import TableReading
Truth = Annotated[TruthLike | None, "CSV of the targets."]
Far = Annotated[
    float | None,
    "Operating point at which targets count as found, false alarms per m² (0.05).",
]
Sealed = Annotated[
    PathLike | None,
    "Sealed truth to score against, by the rules it was sealed with.",
]
Recipes = Annotated[
    OneOrMorePaths | None,
    "What fixes the detector, which must stand in the register; once per alarm list.",
    ShellType(list[str]),
]
Book = Annotated[
    PathLike | None,
    "Register of detectors and openings; a planned truth names its own.",
]
Witness = Annotated[
    PathLike | None,
    "A file elsewhere that must hold the lines of the register (--book), or else of the "
    "log of looks (--sealed); new lines are added to it.",
]
Columns = Annotated[
    str | None,
    "Columns of the alarm lists that have other names: x=Rechts,y=Hoch,confidence=Score.",
]
TruthColumns = Annotated[str | None, "The same for the truth."]
ListAnchor = Annotated[
    PathLike | None, ANCHOR.option("for lists and truth by longitude and latitude")
]
Vendor = Annotated[
    str | Sequence[str] | None,
    "Whose alarms they are, for the head of every page; once per alarm list. By default "
    "what a comment at the head of the list says: # vendor: NAME.",
    ShellType(list[str]),
]
Unranked = Annotated[
    bool,
    "Take alarm lists without confidences: all alarms of such a list rank equal, and it "
    "has one operating point.",
]
Passphrase = Annotated[Any, "Of a sealed truth: a text, or a function that asks for it."]
PANELS = {
    "Truth and rules": ("truth", "lane", "halo", "far"),
    "Lists of others": ("columns", "truth_columns", "anchor", "vendor", "unranked"),
    "Register and sealed truth": ("recipe", "book", "witness", "sealed"),
}
"""Names of options by the title of the box in which the help shows them."""


@dataclass(frozen=True)
class Trial:
    """What is asked of a trial; without anything a truth is open to all that it names itself."""

    recipes: Sequence[PathLike] = ()  #: that must stand in the register, one for each list
    book: PathLike | None = None  #: register of recipes and openings
    witness: PathLike | None = None  #: file elsewhere that must hold the lines of the register
    passphrase: Any = None  #: of a sealed truth: a text, or a function that asks for it

    def options(self) -> list[str]:
        """Return the names of the options that are given."""
        given = {"`recipe`": self.recipes, "`book`": self.book, "`witness`": self.witness}
        return [name for name, value in given.items() if value]


@dataclass(frozen=True, kw_only=True)
class ScoreRequest:
    """What is scored, against what and by which rules, and where the files go."""

    lists: Sequence[Path]  #: result folders, or alarm lists (CSV) of any detector
    truth: Path  #: targets (CSV), or a sealed truth
    output: Path  #: folder of the report and its JSON
    #: lane or lanes of alarm lists, see :func:`flgpr.commands.scoring.read_lanes`; None for that of the results
    lane: PathLike | None = None
    objects: PathLike | None = None  #: other objects (CSV), for the pictures of a result
    #: fields of :class:`flgpr.scoring.Rules` that are given, such as ``halo`` (m) and ``far`` (m⁻²)
    rules: Mapping[str, Any] = field(default_factory=dict)
    reading: TableReading | None = None  #: columns of the lists
    truth_reading: TableReading | None = None  #: columns of the truth
    trial: Trial = field(default_factory=Trial)  #: register, or passphrase of a sealed truth
    card: TrialCard | None = None  #: what the report states of the trial
    overwrite: bool = True  #: whether another score may be replaced


def score_request(
    asked: Mapping[str, Any], lists: Sequence[Path], truth: Path, output: Path, report: str
) -> ScoreRequest:
    """Return what the arguments of ``flgpr score`` or ``flgpr compare`` ask for.

    Parameters
    ----------
    asked : mapping
        The arguments by name.
    lists, truth, output
        As of :class:`ScoreRequest`.
    report : str
        JSON in the output of a score that is there already.
    """
    from flgpr.commands.entrants import TrialCard, checked_vendors, day_of_score
    from flgpr.commands.positions import table_reading

    anchor = asked["anchor"]
    vendors = [str(name) for name in one_or_more(asked["vendor"])]
    passphrase = asked.get("passphrase")
    return ScoreRequest(
        lists=lists,
        truth=truth,
        output=output,
        lane=asked["lane"],
        objects=asked.get("objects"),
        rules=given({name: asked[name] for name in ("halo", "far")}),
        reading=table_reading(asked["columns"], anchor, asked["unranked"]),
        truth_reading=table_reading(asked["truth_columns"], anchor),
        trial=Trial(one_or_more(asked["recipe"]), asked["book"], asked["witness"], passphrase),
        card=TrialCard(
            checked_vendors(vendors, len(lists)), day_of_score(output, report, asked["overwrite"])
        ),
        overwrite=asked["overwrite"],
    )


class Show(StrEnum):
    """What the scores of a sealed truth may tell."""

    curve = "curve"
    targets = "targets"


def path_of_list(alarms: Any) -> Path:
    """Return the folder of a result, or the path of a file or folder."""
    if isinstance(alarms, str | Path):
        return Path(alarms)
    if not hasattr(alarms, "folder"):
        raise ValueError(
            f"alarms must be a result, or a file or folder of one, got a {type(alarms).__name__}"
        )
    return Path(alarms.folder)


@contextmanager
def truth_path(truth: TruthLike | None, sealed: PathLike | None) -> Iterator[Path]:
    """Yield the file of a truth, open or sealed; a table in memory is written to a temporary one.

    Without any it is a ValueError.
    """
    if sealed is not None:
        yield Path(sealed)
    elif truth is None:
        raise ValueError("`truth` is needed, or `sealed` of `flgpr.score`, got neither")
    elif isinstance(truth, str | Path):
        yield Path(truth)
    else:
        from flgpr.store import write_table

        with tempfile.TemporaryDirectory(prefix="flgpr-") as folder:
            path = Path(folder) / "truth.csv"
            write_table(truth, path)
            yield path


def refuse(names: Iterable[str], why: str) -> None:
    """Refuse options that have no effect here: they are not dropped without a word."""
    refused = [f"`{name}`" for name in names]
    if refused:
        raise ValueError(f"{why}, got {' and '.join(refused)}")


def given(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in options.items() if value is not None}


def require_witnessed(witness: PathLike | None, *registers: PathLike | None) -> None:
    """Refuse a witness where there is neither a register nor a sealed truth with its log."""
    if witness is not None and not any(registers):
        raise ValueError(f"`witness` goes with `book` or `sealed`, got {witness} alone")


def require_lists(lists: Sequence[Path], what: str = "alarm list or result") -> None:
    """Refuse, before anything else is asked for, a list that is not there."""
    for path in lists:
        if not path.exists():
            raise FileNotFoundError(f"{what} not found: {path}")
