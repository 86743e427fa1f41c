"""The permittivity of the ground below a line, by the focus of hyperbolas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from flgpr.calibrate.clock import sharpness
from flgpr.types import ComplexArray, floats

_LEAST_CONTRAST = 1.3  # times the median of all trials; assumed


@dataclass(frozen=True)
class GroundFit:
    """Permittivity of the ground below a line, by focus."""

    permittivity: float
    contrast: float  #: sharpness there over the median of all trials
    trials: pd.DataFrame  #: permittivity, sharpness
    place: float = math.nan  #: m along the line, of the brightest point that is focused
    delay: float = math.nan  #: its delay, s
    doubt: str = ""  #: why the answer may be that of no hyperbola; empty if there is none


def estimate_permittivity(
    image: Callable[[float], ComplexArray],
    trials: Sequence[float],
    track: Callable[[Any, str, int], Iterable[float]],
) -> GroundFit:
    """Find the permittivity at which an image is sharpest.

    Parameters
    ----------
    image : callable
        Returns the image of the same ground for a permittivity, such as
        :class:`flgpr.imaging.LineSection`.
    trials : sequence of float
        Permittivities to try, at least three that increase.
    track : callable
        Passes the trials through and shows progress.

    Returns
    -------
    GroundFit
        The permittivity, between trials by a parabola over its logarithm.

    Raises
    ------
    ValueError
        If the sharpest image lies at the edge of the trials or does not stand out (1.3 times the
        median of the trials).
    """
    values = floats(trials)
    if values.size < 3 or (np.diff(values) <= 0).any():
        raise ValueError(f"trials must be three or more that increase, got {values.size}")
    sharp = np.empty(values.size)
    for number, value in enumerate(track(values, "permittivities tried", values.size)):
        sharp[number] = sharpness(image(float(value)))
    best = int(sharp.argmax())
    contrast = float(sharp.max() / np.median(sharp))
    if best in (0, values.size - 1):
        raise ValueError(
            "permittivity lies at or beyond the edge of what was tried, "
            f"{values[0]:g} to {values[-1]:g}"
        )
    if contrast < _LEAST_CONTRAST:
        raise ValueError(
            f"no permittivity stands out: the sharpest is {contrast:.2f} times the median, "
            f"{_LEAST_CONTRAST:g} are needed"
        )
    # The top of the parabola a·x² + b·x + c in x = ln ε through the best trial and its neighbours.
    neighbours = slice(best - 1, best + 2)
    curve = np.polyfit(np.log(values[neighbours]), sharp[neighbours], 2)
    top = -curve[1] / (2 * curve[0])
    table = pd.DataFrame({"permittivity": values, "sharpness": sharp})
    return GroundFit(float(np.exp(top)), contrast, table)
