"""What a score or a comparison is asked for, as one record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import one_or_more
from flgpr.commands.score_options import given

if TYPE_CHECKING:
    from flgpr.commands.trial_card import TrialCard
    from flgpr.store.dialects import TableReading

PathLike = str | Path


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
    from flgpr.commands.positions import table_reading
    from flgpr.commands.trial_card import TrialCard, checked_vendors, day_of_score

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
