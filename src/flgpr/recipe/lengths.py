"""Lengths of a recipe that follow the height of the antennas.

Resolution across and along grows with the height, and so does what surrounds a mine in an image.
Two recipes are known: that of the paper's array, 5 m high, and C_HH for antennas 1.5 m high, the
packaged recipe ``miniature``. A length of the first becomes that of the second on a straight line.

Sub-bands of a recipe that follow from the tones of a run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from flgpr.recipe.radar_setup import Band
from flgpr.types import FloatArray

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


_GAP = 20  # usual steps without a tone that divide two bands
_OVERLAP = 1 / 6  # share of a sub-band that the next one has, too
# Nested sub-bands: all, its lower and its upper part. They are those of `miniature`, 0.45 to 1.05,
# 0.9 to 1.5 and 0.45 to 1.5 GHz, for other tones.
_NESTED_RATIO = 10 / 3  # of the highest to the lowest tone at most
_NESTED_HIGHEST = 1.5e9  # Hz; above it rough ground and stones outshine what is buried
_NESTED_PART = 4 / 7  # of all, of the lower and of the upper part
ALL, LOWER, UPPER = "F0", "F1", "F2"
"""Names of nested sub-bands."""


def pieces_of(tones: FloatArray) -> list[FloatArray]:
    """Return the tones, Hz, in the pieces that gaps make of them; lone tones are no piece.

    Raises
    ------
    ValueError
        If no two tones are neighbours.
    """
    steps = np.diff(tones)
    pieces = []
    if steps.size:
        gaps = np.flatnonzero(steps > _GAP * np.median(steps))
        pieces = [piece for piece in np.split(tones, gaps + 1) if piece.size > 1]
    if not pieces:
        raise ValueError(
            f"run.frequency must hold neighbouring tones, which make a band, got {tones.size} tone"
        )
    return pieces


def divide(tones: FloatArray, least: float) -> dict[str, Band]:
    """Divide a band, or what gaps make of it, into equal sub-bands that overlap.

    They are as many as are at least so many Hz wide.
    """
    pieces = pieces_of(tones)
    subbands: list[Band] = []
    for piece in pieces:
        low = float(piece[0])
        bandwidth = float(np.ptp(piece))
        count = max(int((bandwidth / least - _OVERLAP) / (1 - _OVERLAP)), 1)
        width = bandwidth / (count - (count - 1) * _OVERLAP)
        for number in range(count):
            start = low + number * width * (1 - _OVERLAP)
            subbands.append((start, start + width))
    bands = {}
    if pieces[0].size == tones.size and len(subbands) > 1:
        bands[ALL] = (float(tones[0]), float(tones[-1]))
    for number, subband in enumerate(subbands, 1):
        bands[f"F{number}"] = subband
    return bands


def divisions_like(
    tones: FloatArray, model: Mapping[str, Band], least: float
) -> Iterator[dict[str, Band]]:
    """Yield sub-bands for a model's method, the better ones first.

    They are the lowest tones together, with their lower and their upper part; at last all of them
    alone. A band that begins below 1.5 GHz ends there, unless it would be narrower than ``least``.
    None but the last is narrower than ``least``. Sub-bands side by side, as ``fused`` has them,
    were given up: docs/evidence/fused-fitted.md.

    Parameters
    ----------
    tones : (frequency,) ndarray
        Tones of the run, Hz.
    model : mapping of str to pair of float
        The model's sub-bands, Hz: none of the run's begins below them.
    least : float
        Least width of a sub-band, Hz.
    """
    lowest = min(low for low, _ in model.values())
    piece = pieces_of(tones)[0]
    low = float(piece[0])
    if piece[-1] > lowest:
        low = max(low, lowest)
    high = min(low * _NESTED_RATIO, float(piece[-1]))
    if low < _NESTED_HIGHEST:
        high = min(high, max(_NESTED_HIGHEST, low + least))
    if np.count_nonzero((piece >= low) & (piece <= high)) < 2:
        low, high = float(piece[0]), float(piece[-1])
    part = _NESTED_PART * (high - low)
    if part >= least:
        yield {ALL: (low, high), LOWER: (low, low + part), UPPER: (high - part, high)}
    yield {ALL: (low, high)}
