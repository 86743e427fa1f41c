"""Thresholds for a false-alarm rate, from ground without targets.

Of every training lane the confidences of alarms at no target are kept, each by a detector that was
trained without that lane. The lane's own threshold for a rate is the confidence that no more of them
exceed than the rate allows. A new lane is as likely as any of them to have the highest threshold, so
that of n + 1 exchangeable lanes the threshold of rank ⌈0.95 (n + 1)⌉ suffices on 95 % of them (split
conformal prediction: Vovk, Gammerman & Shafer, "Algorithmic Learning in a Random World", 2005). With
fewer than 19 lanes there is no such rank; the highest suffices on n / (n + 1) of lanes.

Where what was learnt does not hold, the threshold is the lane's own: as many alarms lie above it as the
rate allows on its area, were none of them a target. So the rate holds whatever lies there, at the cost
of targets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flgpr.method.unlike import FreeGround
from flgpr.types import FloatArray

SHARE = 0.95
"""Share of lanes on which a threshold is to hold."""
MOST_KEPT = 0.5
"""Alarms per m² of a training lane that are kept, the strongest: thresholds for higher rates lack."""
ABOVE = "above_threshold"
"""Column that says whether an alarm lies above the threshold for the rate that was asked for."""


@dataclass(frozen=True)
class RateThreshold:
    """The threshold for a false-alarm rate."""

    rate: float  #: that was asked for, per m²
    #: alarms above it are counted; minus infinity where all are. None where nothing is known
    threshold: float | None
    source: str  #: "training", or "lane"
    share: float = 1.0  #: of lanes on which it holds
    lanes: int = 0  #: training lanes that it comes from
    why_not: str = ""  #: why nothing is known

    def as_json(self, above: int) -> dict[str, Any]:
        """Return it as JSON values, with the number of alarms above it."""
        finite = self.threshold is not None and math.isfinite(self.threshold)
        return {
            "rate": self.rate,
            "threshold": self.threshold if finite else None,
            "source": self.source,
            "share_of_lanes": round(self.share, 4),
            "training_lanes": self.lanes,
            "above": above,
            "notes": [self.words(above)],
        }

    def words(self, above: int) -> str:
        """Return it in words, with the number of alarms above it."""
        wanted = f"{self.rate:g} false alarms per m²"
        if self.threshold is None:
            return f"no threshold for {wanted}: {self.why_not}"
        counted = f"{above} alarm{'s' if above != 1 else ''} above"
        if self.source == "lane":
            return f"{counted} the lane's own threshold for {wanted}, were none of them a target"
        level = "-inf" if math.isinf(self.threshold) else f"{self.threshold:.4g}"
        return (
            f"{counted} {level}, the threshold for {wanted}: it holds on {100 * self.share:.0f} % of "
            f"lanes like the {self.lanes} of training"
        )


def threshold_of_lane(confidence: Sequence[float], area: float, rate: float) -> float:
    """Return the threshold that no more alarms of a lane exceed than a rate allows.

    Parameters
    ----------
    confidence : sequence of float
        Of all of its alarms at no target, descending.
    area : float
        Area of the lane, m².
    rate : float
        False alarms per m².

    Returns
    -------
    float
        Minus infinity if there are no more alarms than allowed.
    """
    # A product such as 0.1 * 30 must not lose an alarm to rounding.
    allowed = math.floor(rate * area * (1 + 1e-12))
    return float(confidence[allowed]) if len(confidence) > allowed else -math.inf


def training_threshold(free: Sequence[FreeGround], rate: float) -> RateThreshold:
    """Return the threshold for a rate by the training lanes."""
    if not free:
        why = (
            "the model keeps no alarms of ground without targets; train it again on 3 lanes or more"
        )
        return RateThreshold(rate, None, "training", why_not=why)
    if rate > MOST_KEPT:
        why = f"the model keeps {MOST_KEPT:g} alarms per m²"
        return RateThreshold(rate, None, "training", why_not=why)
    count = len(free)
    thresholds = sorted(threshold_of_lane(lane.confidence, lane.area, rate) for lane in free)
    rank = math.ceil(SHARE * (count + 1))
    share = rank / (count + 1)
    if rank > count:
        rank = count
        share = count / (count + 1)
    return RateThreshold(rate, thresholds[rank - 1], "training", share, count)


def own_threshold(confidence: FloatArray, area: float, rate: float) -> RateThreshold:
    """Return the threshold for a rate by a lane's own alarms, as if none were a target."""
    ordered = np.sort(confidence)[::-1].tolist()
    return RateThreshold(rate, threshold_of_lane(ordered, area, rate), "lane")


def free_ground(confidence: FloatArray, area: float) -> FreeGround:
    """Return what is kept of the alarms at no target of a training lane."""
    ordered = np.sort(confidence[np.isfinite(confidence)])[::-1]
    return FreeGround(area=area, confidence=ordered[: math.ceil(MOST_KEPT * area) + 1].tolist())
