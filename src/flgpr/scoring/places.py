"""Errors of the targets' positions: refraction shifts buried ones, and a survey is not exact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model.refraction import apparent_shift
from flgpr.types import ArrayLike, floats


def refraction_shift(
    depth: ArrayLike, permittivity: float, height: float, distance: ArrayLike
) -> Any:
    """Compute how far behind its position a buried object shows in an image of the surface.

    This is :func:`flgpr.model.refraction.apparent_shift` at the angle of incidence from the
    vertical.

    Parameters
    ----------
    depth : array_like
        Depth d below the mean surface, m. Objects on or above the surface (depth 0 or less) do not
        move; NaN stays.
    permittivity : float
        Relative permittivity ε of the soil, at least 1.
    height, distance : float, array_like
        Height of the antennas, and horizontal distance from them to the object, m, positive.

    Returns
    -------
    ndarray
        Shift away from the radar, m.

    Raises
    ------
    ValueError
        If the permittivity is less than 1, or the height or a distance is not positive.

    Examples
    --------
    A mine 10 cm deep in dry sand and in a moist soil, seen from 5 m height at 12 m:

    >>> from flgpr.scoring import refraction_shift
    >>> round(float(refraction_shift(0.10, 3.4, 5.0, 12.0)), 3)  # m
    0.173
    >>> round(float(refraction_shift(0.10, 10.7, 5.0, 12.0)), 3)
    0.34
    """
    distances = floats(distance)
    if not permittivity >= 1:
        raise ValueError(f"permittivity must be at least 1, got {permittivity}")
    if not (height > 0 and (distances > 0).all()):
        raise ValueError(f"height and distance must be positive, got {height} m and {distances} m")
    sine = distances / np.hypot(distances, height)
    below = np.maximum(floats(depth), 0)
    return apparent_shift(below, permittivity, sine)[()]  # a number for a number


@dataclass(frozen=True)
class Refraction:
    """Correction of the truth for the refraction shift."""

    permittivity: float  #: relative permittivity of the soil
    height: float = 5.0  #: height of the antennas, m
    distance: float = 12.0  #: distance ahead of the radar at which the run-view sees its ground, m
    radar_x: float = 0.0  #: cross-track position of the radar in the lane frame, m

    def __post_init__(self) -> None:
        if not math.isfinite(self.radar_x):
            raise ValueError(f"radar_x must be finite, got {self.radar_x}")
        refraction_shift(0.0, self.permittivity, self.height, self.distance)

    def move(self, truth: pd.DataFrame) -> pd.DataFrame:
        """Return a truth table with its buried targets where they show in the image.

        They move along the line from the radar. A target of unknown depth stays.

        Parameters
        ----------
        truth : DataFrame
            Truth table, lane frame.

        Returns
        -------
        DataFrame
            The table with moved x and y, m.
        """
        lateral = truth["x"].to_numpy() - self.radar_x
        ground_range = np.hypot(lateral, self.distance)
        depth = truth["depth"].to_numpy()
        shift = refraction_shift(depth, self.permittivity, self.height, ground_range)
        shift = np.nan_to_num(shift)
        return truth.assign(
            x=truth["x"] + shift * lateral / ground_range,
            y=truth["y"] + shift * self.distance / ground_range,
        )


@dataclass(frozen=True)
class SurveyShare:
    """Share of the halo that the survey error takes."""

    sigma: float  #: standard deviation of a surveyed position per axis, m
    halo: float  #: halo radius, m
    share: float  #: ``sigma`` over ``halo``
    #: radius around a surveyed position that holds the true one 95 times in 100, m
    radius_95: float
    lost: float  #: probability that an alarm exactly on the true position falls outside the halo


def survey_share(sigma: float, halo: float = 1.0) -> SurveyShare:
    """Compute how much of the halo a survey error takes.

    The error is normal and equal in both axes.

    Parameters
    ----------
    sigma : float
        Standard deviation of the surveyed positions per axis, m.
    halo : float
        Halo radius, m.

    Returns
    -------
    SurveyShare
        Share, radius and lost probability.

    Raises
    ------
    ValueError
        If the deviation is negative or the radius is not positive.

    Examples
    --------
    >>> from flgpr.scoring import survey_share
    >>> share = survey_share(0.1, halo=0.5)
    >>> f"{share.radius_95:.3f} m, lost {share.lost:.1e}"
    '0.245 m, lost 3.7e-06'
    """
    if not (math.isfinite(sigma) and sigma >= 0):
        raise ValueError(f"survey_error must not be negative, got {sigma}")
    if not halo > 0:
        raise ValueError(f"halo must be positive, got {halo}")
    # The distance of the true position is Rayleigh distributed.
    lost = math.exp(-(halo**2) / (2 * sigma**2)) if sigma > 0 else 0.0
    radius_95 = sigma * math.sqrt(-2 * math.log(0.05))
    return SurveyShare(float(sigma), float(halo), sigma / halo, radius_95, lost)


def jitter(truth: pd.DataFrame, sigma: float, seed: int | np.random.Generator = 0) -> pd.DataFrame:
    """Draw another survey of the same targets.

    Parameters
    ----------
    truth : DataFrame
        Truth table.
    sigma : float
        Standard deviation of the normal errors per axis, m.
    seed : int or Generator
        Seed of the draw.

    Returns
    -------
    DataFrame
        The truth table with moved x and y, m.
    """
    rng = np.random.default_rng(seed)
    step = rng.normal(0.0, sigma, size=(len(truth), 2))
    return truth.assign(x=truth["x"] + step[:, 0], y=truth["y"] + step[:, 1])
