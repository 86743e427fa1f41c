"""What an error of the survey does to a score."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class SurveyShare:
    """How much of the halo the survey error takes."""

    sigma: float  #: standard deviation of a surveyed position per axis, m
    halo: float  #: halo radius, m
    share: float  #: ``sigma`` over ``halo``
    radius_95: float  #: radius around a surveyed position that holds the true one 95 times in 100, m
    lost: float  #: probability that an alarm exactly on the true position falls outside the halo


def survey_share(sigma: float, halo: float = 1.0) -> SurveyShare:
    """Tell how much of the halo (radius, m) a survey error takes: normal, of deviation sigma (m), equal in both axes.

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
    lost = math.exp(-(halo**2) / (2 * sigma**2)) if sigma > 0 else 0.0
    return SurveyShare(float(sigma), float(halo), sigma / halo, sigma * math.sqrt(-2 * math.log(0.05)), lost)


def jitter(truth: pd.DataFrame, sigma: float, seed: int | np.random.Generator = 0) -> pd.DataFrame:
    """Draw another survey of the same targets: truth with x and y moved by normal errors of deviation sigma, m."""
    rng = np.random.default_rng(seed)
    step = rng.normal(0.0, sigma, size=(len(truth), 2))
    return truth.assign(x=truth["x"] + step[:, 0], y=truth["y"] + step[:, 1])
