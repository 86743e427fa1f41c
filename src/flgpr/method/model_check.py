"""What the check of a trained model on simulated lanes found, as a file beside the model.

It is no part of the model, so that a model is the same whether it was checked or not.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from flgpr.door import Folder
from flgpr.model.printable import printable
from flgpr.store import write_whole

CHECK_FILE = "check.json"
"""File of a model's folder that holds what the check found."""
_REASON = "not_checked"  # entry of the file in place of all others
_BY_CHANCE = 0.05  # largest p of a difference that is more than chance


@dataclass(frozen=True)
class Check:
    """What a recipe and the contrast find on the same simulated lanes."""

    lanes: int
    mines: int
    far: float  #: false alarms per m² that either may have
    found: int  #: mines that the recipe finds
    by_contrast: int  #: mines that the contrast finds
    only_recipe: int  #: mines that the recipe alone finds
    only_contrast: int  #: mines that the contrast alone finds
    p: float  #: of McNemar's exact test

    def sentences(self) -> list[str]:
        """Return what the check found, in words, and what to do where it is bad."""
        told = [
            f"on {self.lanes} simulated lanes of your array this recipe finds {self.found} of "
            f"{self.mines} mines, the contrast {self.by_contrast} of {self.mines}, at {self.far:g} "
            f"false alarms per m² (alone {self.only_recipe} and {self.only_contrast}, "
            f"p = {self.p:.2g})"
        ]
        if self.found >= self.by_contrast:
            return told
        if self.p > _BY_CHANCE:
            told.append(
                "the contrast finds more, but chance gives such a difference; more lanes to train "
                "on, of soils like yours, may help"
            )
        else:
            told.append(
                "the contrast finds more than chance explains: do not use this model. Detect "
                "without one (`flgpr detect RUN` ranks by contrast), or fit the recipe anew "
                "(`flgpr recipe for RUN --like fused`) and train on more lanes"
            )
        return told


def write_check(model: Path, found: Check | str) -> None:
    """Write what a check found, or why there was none, beside the model that was checked."""
    entries = {_REASON: found} if isinstance(found, str) else asdict(found)
    write_whole(model / CHECK_FILE, json.dumps(entries, indent=1) + "\n")


def check_sentences(model: Path) -> list[str]:
    """Return what the check of a model found, in words; empty if it was not checked.

    Raises
    ------
    ValueError
        If the file of the check is not one that flgpr wrote.
    """
    folder = Folder(model)
    if not folder.has(CHECK_FILE):
        return []
    try:
        entries = folder.json(CHECK_FILE)
        if list(entries) == [_REASON]:
            return [f"not checked on simulated lanes: {printable(str(entries[_REASON]))}"]
        check = Check(**entries)
        if not all(isinstance(value, int | float) for value in asdict(check).values()):
            raise ValueError("an entry that is no number")
        return check.sentences()
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{model / CHECK_FILE} must be what `flgpr.train` wrote, got {error}"
        ) from None
