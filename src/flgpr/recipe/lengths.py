"""Lengths of a recipe that follow the height of the antennas.

Resolution across and along grows with the height, and so does what surrounds a mine in an image.
Two recipes are known: that of the paper's array, 5 m high, and C_HH for antennas 1.5 m high, the
packaged recipe ``miniature``. A length of the first becomes that of the second on a straight line.
"""

from __future__ import annotations

from typing import NamedTuple

PAPERS_HEIGHT = 5.0
"""Height of the array of Wang et al. 2007, m."""
LOW = 1.5
"""Height of the array of ``miniature``, m."""
_LEAST_HEIGHT = 0.5  # below it windows do not shrink: a mine stays 0.3 m wide


class _AtLow(NamedTuple):
    """A length for antennas 1.5 m high."""

    length: float  #: m
    shrinks: bool  #: whether it is shorter for lower antennas yet
    step: float  #: to which it is rounded, m


_AT_LOW = {
    "radius": _AtLow(0.375, True, 0.025),  # of an alarm
    "clear": _AtLow(0.6, True, 0.05),  # about a target, where no clutter is learnt
    "guard": _AtLow(0.4, True, 0.05),  # mean of the half widths of the contrast's guard
    "outer": _AtLow(0.65, True, 0.05),  # half of the contrast's patch
    "patch": _AtLow(1.3, False, 0.05),
    "mean": _AtLow(1.25, False, 0.05),  # must stay longer than the median
}


def length_at(height: float, entry: str, own: float, own_height: float) -> float:
    """Return a length of a recipe for antennas of another height, m.

    Above its own height, and below 0.5 m or 1.5 m, the length stays as it is there.

    Parameters
    ----------
    height : float
        Height of the antennas, m.
    entry : str
        Which length: "radius", "clear", "guard", "outer", "patch" or "mean".
    own : float
        The length at its own height, m.
    own_height : float
        The height of the array that it was chosen for, m.

    Examples
    --------
    >>> from flgpr.recipe.lengths import length_at
    >>> [length_at(height, "radius", 0.5, 5.0) for height in (0.8, 1.5, 3.0, 5.0, 9.0)]
    [0.35, 0.375, 0.425, 0.5, 0.5]
    """
    low = _AT_LOW[entry]
    if own_height <= LOW:
        return own
    lowest = _LEAST_HEIGHT if low.shrinks else LOW
    used = min(max(height, lowest), own_height)
    if used == own_height:
        return own
    length = low.length + (own - low.length) * (used - LOW) / (own_height - LOW)
    return round(round(length / low.step) * low.step, 3)


def reason_for(entry: str, own: float, own_height: float) -> str:
    """Return the rule of a length that follows the height, in words."""
    low = _AT_LOW[entry]
    return (
        f"{low.length:g} m for antennas {LOW:g} m high, {own:g} m for {own_height:g} m, a straight "
        "line between"
    )
