"""Which alarms stand out from the others of their lane, told without truth.

A detector ranks; somebody has to say how far down the list to go. Three answers are taken, the first
that there is: the threshold for the false-alarm rate that was asked for, the confidence from which on a
trained detector decides for a mine, and else the tail of the lane's own alarms.

The tail: nearly all alarms are clutter. The excess of the strongest of many alike values over a high
level is exponential (Pickands, "Statistical inference using extreme order statistics", Annals of
Statistics 3, 1975, with a shape of zero), and the spacings of such values in order are independent (Rényi,
"On the theory of order statistics", 1953), so that the scale of the tail is had from alarms that are too
many to be mines, whatever lies above them. An alarm stands out where that tail lets expect at most one as
strong on the lane. A lane with few alarms has no tail. The rule is unproven: nothing was learnt, and a
rock stands out as well as a mine.

Thresholds for a false-alarm rate, from ground without targets.

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

import numpy as np
import pandas as pd

from flgpr.method.model import Detector
from flgpr.method.unlike import FreeGround
from flgpr.model import Lane
from flgpr.types import Entries, FloatArray

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

    def as_json(self, above: int) -> Entries:
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


EXPECTED = 1.0
"""Alarms of clutter as strong as those that stand out, expected of a lane."""
DENSEST = 0.1
"""Mines per m² that a road holds at most: the tail is kept clear of so many, and more are a doubt."""
FEWEST = 8
"""Alarms that the scale of a tail must rest on."""


@dataclass(frozen=True)
class StandingOut:
    """The alarms that stand out from the others of their lane."""

    count: int
    weak: int  #: the others
    border: float | None  #: confidence from which on alarms stand out; None where nobody can say
    source: str  #: "rate", "model", "tail", or "" where nobody can say
    density: float  #: of those that stand out, per m²
    is_seen: bool = True  #: whether any scan saw the ground
    beside: int = 0  #: alarms beside the ground that stand out, too

    def sentences(self) -> list[str]:
        """Return the answer and how it was found, then what is advised."""
        if not self.is_seen:
            return [
                "no answer: no scan sees the lane; look at its borders, and at the run's positions"
            ]
        if not self.source:
            few = f"{_places(self.weak)}, too few to say which of them stand out"
            return [few if self.weak else "no place was raised"]
        others = f"{self.weak} {'is' if self.weak == 1 else 'are'} weak"
        if self.beside:
            others += f", {self.beside} {_stand(self.beside)} out beside the lane"
        return [
            f"{_places(self.count)} {_stand(self.count)} out, {others}",
            _HOW[self.source],
            *self._advice(),
        ]

    def _advice(self) -> list[str]:
        """Return what to do next."""
        if self.density > DENSEST:
            return [
                f"{self.density:.2g} places per m² are more than a road holds: look for what is wrong "
                "with the run (`flgpr info`), or search with another recipe"
            ]
        if self.source == "tail":
            return ["lanes with truth give probabilities in place of this rule: `flgpr train`"]
        return []

    def as_json(self) -> Entries:
        """Return it as JSON values."""
        return {
            "count": self.count,
            "weak": self.weak,
            "border": self.border,
            "source": self.source,
            "notes": self.sentences(),
        }


_HOW = {
    "rate": "above the threshold for the false-alarm rate",
    "model": "by the confidence from which on the model decides for a mine",
    "tail": "at most one place of this lane's clutter is expected to be as strong; the rule is unproven",
}
"""How it was found, by source."""


def _stand(count: int) -> str:
    return "stand" if count > 1 else "stands"


def _places(count: int) -> str:
    return f"{count or 'no'} place{'s' if count > 1 else ''}"


def tail_threshold(confidence: FloatArray, area: float) -> float | None:
    r"""Return the confidence beyond which at most one alarm of a lane's clutter is expected.

    Parameters
    ----------
    confidence : (alarm,) ndarray
        Confidences of all alarms of a lane, in any order.
    area : float
        Area of the lane, m².

    Returns
    -------
    float or None
        The threshold; None where too few alarms are left to tell the tail from.

    Notes
    -----
    With the alarms in descending order, :math:`c_0 ≥ c_1 ≥ …`, the first :math:`k = ⌈ρ A⌉` may be
    mines, :math:`ρ` of ``DENSEST``. The mean of the normalized spacings from :math:`k` to the median
    :math:`m`, :math:`s = (k (c_k - c_m) + \sum_{i=k}^{m-1} (c_i - c_m)) / (m - k)`, is the scale, and
    :math:`(k + 1)\,e^{-(c - c_k) / s}` alarms are expected beyond :math:`c`.
    """
    ordered = np.sort(confidence[np.isfinite(confidence)])[::-1]
    first = math.ceil(DENSEST * area)
    last = max(len(ordered) // 2, first + FEWEST)
    if last >= len(ordered):
        return None
    excess = ordered[:last] - ordered[last]
    scale = (first * excess[first] + excess[first:].sum()) / (last - first)
    return float(ordered[first] + scale * math.log((first + 1) / EXPECTED))


def bright_beside(alarms: pd.DataFrame, lane: Lane) -> list[str]:
    """Return what a ranking by contrast hides where things beside the lane outshine all in it."""
    inside = lane.contains(alarms["x"].to_numpy(), alarms["y"].to_numpy())
    strongest = alarms["magnitude"][inside].max()
    count = int((alarms["magnitude"][~inside] > strongest).sum())
    if not count:
        return []
    return [
        f"brighter than all in the lane, beside it: {count}; the contrast misses mines within 3 m "
        'of such things, confidence = "magnitude" fewer'
    ]


def what_stands_out(
    alarms: pd.DataFrame, ground: Lane | None, detector: Detector | None = None
) -> StandingOut:
    """Return which alarms of a detection stand out.

    Parameters
    ----------
    alarms : DataFrame
        Its alarms, with ``confidence``, and whether each lies above the threshold for the
        false-alarm rate where one was asked for.
    ground : Lane, optional
        Ground that was searched and seen; alarms beside it are counted apart. None if no scan saw
        any.
    detector : Detector, optional
        The trained detector that the confidences come from.

    Returns
    -------
    StandingOut
        Those on the ground.
    """
    if ground is None:
        return StandingOut(0, 0, None, "", 0.0, is_seen=False)
    inside = alarms[ground.contains(alarms["x"], alarms["y"])]
    confidence = inside["confidence"].to_numpy(float)
    everywhere = alarms["confidence"].to_numpy(float)
    border: float | None
    if ABOVE in alarms:
        source = "rate"
        border = float(
            min(
                everywhere[alarms[ABOVE] == 1],
                default=float(np.nextafter(everywhere.max(initial=0.0), np.inf)),
            )
        )
    elif detector is not None:
        source, border = "model", detector.border
    else:
        source, border = "tail", tail_threshold(confidence, ground.area)
    if border is None:
        return StandingOut(0, len(inside), None, "", 0.0)
    count = int((confidence >= border).sum())
    beside = int((everywhere >= border).sum()) - count
    weak = len(inside) - count
    return StandingOut(count, weak, border, source, count / ground.area, beside=beside)
