"""Registers and sealed truths, which a package beside the instrument keeps.

That package names its object by an entry point of the group "flgpr.trials". Without it lists are
scored against open truths alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.commands.entrants import Entrant
    from flgpr.commands.options import PathLike
    from flgpr.commands.score_request import ScoreRequest

Borders = Mapping[str, Mapping[str, float]]
"""Borders of lanes, m, by their names."""
REGISTER_COLUMN = "book"
"""Column of a planned truth that names its register."""


class Trials(Protocol):
    """What the package of trials does for ``flgpr score`` and ``flgpr compare``."""

    def open_truth(
        self,
        request: ScoreRequest,
        entrants: Sequence[Entrant],
        lanes: Borders,
        rules: Mapping[str, float],
    ) -> tuple[pd.DataFrame, list[dict[str, Any]]]:
        """Open a truth, once its register holds the recipes of all lists; enter the opening.

        Returned are the targets, and for each list the notes of its report.
        """

    def score_sealed(self, request: ScoreRequest) -> Any:
        """Score an alarm list against a sealed truth."""

    def lines(self, blind: Any) -> Iterable[str]:
        """Return what is printed of a score against a sealed truth."""

    def seal(
        self,
        truth: PathLike,
        lane: PathLike,
        output: PathLike,
        halo: float | None = None,
        show: str | None = None,
        book: PathLike | None = None,
        witness: PathLike | None = None,
        *,
        passphrase: Any = None,
    ) -> Path:
        """Seal a truth; the earlier spelling of ``flgpr seal`` asks for it."""

    def ask_passphrase(self) -> str:
        """Ask for the passphrase of a sealed truth."""

    def ask_new_passphrase(self) -> str:
        """Ask for the passphrase that a truth is sealed with."""


def installed_trials() -> Trials | None:
    """Return the package of trials; None where none is installed."""
    for entry in entry_points(group="flgpr.trials"):
        package: Trials = entry.load()
        return package
    return None


def needed_trials(what: str) -> Trials:
    """Return the package of trials; where it is missing, what needs it is a ValueError."""
    package = installed_trials()
    if package is None:
        raise ValueError(f"the package flgpr_trials is needed for {what}, and is not installed")
    return package
