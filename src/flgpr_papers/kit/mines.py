"""Mixes of mines: the bodies, with their shares, of the metal, plastic and simulant mines."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from fractions import Fraction
from importlib import resources
from typing import Any

from flgpr.types import Entries


@dataclass(frozen=True)
class Mix:
    """Bodies that stand for one kind of mine, in declared shares."""

    name: str  #: of the mix
    kind: str  #: what truth and scores call its mines: "metal", "plastic" or "simulant"
    about: str  #: what the mix stands for
    parts: dict[str, int]  #: weight of each body by its name, a whole number, in the declared order

    def __post_init__(self) -> None:
        are_weights = all(isinstance(weight, int) and weight > 0 for weight in self.parts.values())
        if not self.parts or not are_weights:
            raise ValueError(
                f"mix {self.name}: parts must be whole numbers above 0, at least one, got "
                f"{self.parts}"
            )

    @property
    def shares(self) -> dict[str, Fraction]:
        """Share of each body by its name, exact; they sum to one."""
        total = sum(self.parts.values())
        return {body: Fraction(weight, total) for body, weight in self.parts.items()}


def find_mix(name: str) -> Mix:
    """Return the declared mix of a name.

    Raises
    ------
    ValueError
        If there is no such mix; the message lists those there are.
    """
    if name not in MIXES:
        raise ValueError(f"mix must be one of {', '.join(MIXES)}, got {name!r}")
    return MIXES[name]


def mix_counts(mix: str, count: int) -> dict[str, int]:
    """Return how many of ``count`` mines have each body of a mix, by the largest remainders.

    Equal remainders go to the body that is declared first. Bodies of which there is none are left
    out.

    Parameters
    ----------
    mix : str
        Name of a declared mix.
    count : int
        Number of mines in all.

    Raises
    ------
    ValueError
        If no mix has that name, or ``count`` is negative.
    """
    if count < 0:
        raise ValueError(f"count must not be negative, got {count}")
    quotas = {body: share * count for body, share in find_mix(mix).shares.items()}
    counts = {body: math.floor(quota) for body, quota in quotas.items()}
    by_remainder = sorted(quotas, key=lambda body: counts[body] - quotas[body])
    for body in by_remainder[: count - sum(counts.values())]:
        counts[body] += 1
    return {body: number for body, number in counts.items() if number > 0}


def mix_draws(mix: str, depth: float, count: int, **entries: Any) -> list[Entries]:
    """Return the draws of a scene that put mines of a mix into the lane, a draw per body.

    Parameters
    ----------
    mix : str
        Name of a declared mix.
    depth : float
        Depth of the mines' tops, m.
    count : int
        Number of mines in all.
    **entries
        Further entries of every draw, as of ``flgpr.simulate.scene.scene.TargetDraw``.

    Raises
    ------
    ValueError
        If no mix has that name, or ``count`` is negative.
    """
    kind = find_mix(mix).kind
    return [
        {"kind": kind, "body": body, "depth": depth, "count": number, **entries}
        for body, number in mix_counts(mix, count).items()
    ]


_DECLARED = tomllib.loads(
    (resources.files("flgpr_papers") / "mines.toml").read_text(encoding="utf-8")
)
MIXES: dict[str, Mix] = {name: Mix(name=name, **table) for name, table in _DECLARED.items()}
"""The declared mixes by name."""
