"""Findings on Wang et al. 2007 about sub-bands and polarizations at the prescreener."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match
from flgpr_papers.kit.findings import Finding, Interval, parts_larger, together
from flgpr_papers.wang2007.analysis import (
    MINES,
    SUBBANDS,
    LaneResult,
    clutter_levels,
    prescreened,
)
from flgpr_papers.wang2007.comparisons import PAPER_MINES, pd_mean_gap, share_finding

FloatArray = NDArray[np.float64]
Channels = Mapping[tuple[str, str], Match]
"""Alarms of the prescreener by polarization and sub-band."""
POLARIZATIONS = ("HH", "VV", "HV")


def prescreener_findings(
    results: Sequence[LaneResult], recipe: Recipe, draws: int
) -> list[Finding]:
    """Judge what the paper says of the prescreener's channel (Sec. II-C and Fig. 9).

    Parameters
    ----------
    results : sequence of LaneResult
        The calibration lanes, with their run-views over the full range.
    recipe : Recipe
        Recipe of the study.
    draws : int
        Number of bootstrap draws.
    """
    channels = {}
    for polarization in POLARIZATIONS:
        for subband in ("F0", *SUBBANDS):
            alarms = prescreened(results, polarization, subband, recipe)
            channels[polarization, subband] = alarms
    full_range = prescreened(results, "HH", "wide", recipe)
    return [
        *_channel_findings(channels, draws),
        *_clutter_findings(results),
        *_band_order_findings(channels, draws),
        share_finding(
            "HH F1 reaches 100 % at FAR <= 0.15 per m²",
            channels["HH", "F1"],
            MINES,
            0.15,
            1.0,
            PAPER_MINES,
        ),
        parts_larger(
            "The narrow F1 beats the wide F0 at the prescreener (the paper's thesis)",
            "F1 chosen over F0",
            {"F1 - F0": pd_mean_gap(channels["HH", "F1"], channels["HH", "F0"], draws)},
        ),
        parts_larger(
            "Y_max = 16 m beats the full range",
            "better detection with Y_max = 16 m",
            {"16 m - 26 m": pd_mean_gap(channels["HH", "F1"], full_range, draws)},
        ),
    ]


def _channel_findings(channels: Channels, draws: int) -> list[Finding]:
    """Judge that sub-band F1 and polarization HH are best."""
    best = channels["HH", "F1"]
    over_subbands = {}
    for subband in SUBBANDS[1:]:
        gap = pd_mean_gap(best, channels["HH", subband], draws, parts=3)
        over_subbands[f"F1 - {subband}"] = gap
    over_polarizations = {}
    for polarization in ("VV", "HV"):
        gap = pd_mean_gap(best, channels[polarization, "F1"], draws, parts=2)
        over_polarizations[f"HH - {polarization}"] = gap
    return [
        parts_larger(
            "The lowest sub-band F1 is best for the prescreener (HH)",
            "F1 > F2, F3, F4 (Fig. 9)",
            over_subbands,
            note="PD_mean of actual mines; simulants and alarms outside the lane are left out.",
        ),
        parts_larger(
            "In F1 the polarization HH is best for the prescreener",
            "HH and F1 perform best (II-C, Fig. 9)",
            over_polarizations,
        ),
    ]


def _band_order_findings(channels: Channels, draws: int) -> list[Finding]:
    """Judge that Pd falls from each sub-band to the next, in every polarization."""
    findings = []
    for polarization in POLARIZATIONS:
        steps = {}
        for lower, higher in pairwise(SUBBANDS):
            gap = pd_mean_gap(
                channels[polarization, lower], channels[polarization, higher], draws, parts=3
            )
            steps[f"{lower} - {higher}"] = gap
        claim = f"Pd falls from F1 to F4 in {polarization}"
        findings.append(parts_larger(claim, "each lower (Fig. 9)", steps))
    return findings


def _clutter_findings(results: Sequence[LaneResult]) -> list[Finding]:
    """Judge that F1 has the least clutter (Fig. 8), by stretches of 10 m of lane as the sample."""
    levels = clutter_levels(results)
    intervals = {}
    for polarization in ("VV", "HH"):
        for subband in ("F0", *SUBBANDS[1:]):
            gap = levels[f"{polarization} {subband}"] - levels[f"{polarization} F1"]
            name = f"{polarization} {subband} - F1"
            intervals[name] = _mean_of_stretches(gap.dropna().to_numpy(), 8)
    return [
        parts_larger(
            "Sub-band F1 has the lowest level of clutter, in VV and HH",
            "appears so, in general (Fig. 8)",
            intervals,
            note="99 % quantile of the run-view away from targets over its median, dB, "
            "by stretches of 10 m.",
        )
    ]


def _mean_of_stretches(values: FloatArray, parts: int) -> Interval:
    """Return the mean over stretches of lane with Student's interval.

    It is one of ``parts`` intervals that hold all together.
    """
    mean = float(values.mean()) if values.size else float("nan")
    if values.size < 2 or np.ptp(values) == 0:
        return mean, -np.inf, np.inf
    error = float(values.std(ddof=1) / np.sqrt(values.size))
    half = float(stdtrit(values.size - 1, (1 + together(parts)) / 2)) * error
    return mean, mean - half, mean + half
