"""Sub-bands of a recipe that follow from the tones of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.recipe.radar_setup import Band
from flgpr.types import FloatArray

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


def widest_piece(tones: FloatArray) -> float:
    """Return the width of the widest piece of a band, Hz."""
    return max(float(np.ptp(piece)) for piece in pieces_of(tones))


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
    low, high = _low_end(tones, lowest, least)
    part = _NESTED_PART * (high - low)
    if part >= least:
        yield {ALL: (low, high), LOWER: (low, low + part), UPPER: (high - part, high)}
    yield {ALL: (low, high)}


def _low_end(tones: FloatArray, lowest: float, least: float) -> Band:
    """Return the lower end of a band, from ``lowest`` on, ``least`` wide where it can be, Hz."""
    piece = pieces_of(tones)[0]
    low = float(piece[0])
    if piece[-1] > lowest:
        low = max(low, lowest)
    high = min(low * _NESTED_RATIO, float(piece[-1]))
    if low < _NESTED_HIGHEST:
        high = min(high, max(_NESTED_HIGHEST, low + least))
    if np.count_nonzero((piece >= low) & (piece <= high)) < 2:
        low, high = float(piece[0]), float(piece[-1])
    return low, high


def least_width(cell: float) -> float:
    """Return the bandwidth whose range cell under a Hann window is so long, Hz.

    The cell is the main lobe to half its height in amplitude, c/B.
    """
    return SPEED_OF_LIGHT / cell
