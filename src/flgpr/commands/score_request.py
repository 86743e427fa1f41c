"""What a score or a comparison is asked for, as one record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
