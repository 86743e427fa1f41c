"""The ROC table: one type for all conventions, each named in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.scoring.intervals import clopper_pearson, poisson_interval
from flgpr.scoring.matching import one_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Convention:
    """How a ROC counts."""

    name: str  #: its name, found in ``curve.attrs["convention"]``
    source: str  #: the paper it follows
    far: str  #: what its FAR is
    counts: bool  #: whether FAR is a number of alarms over an area; then curves convert by exchanging the area


CONVENTIONS = {
    convention.name: convention
    for convention in (
        Convention("lane", "Wang et al. 2007, rules 1-6", "false alarms over the lane's area outside the halos", True),
        Convention("frames", "Fuse et al. 2018, Fig. 9", "false alarms over the area of all frames", True),
        Convention("examples", "flsar2004, par. 45", "clutter examples called mines over the searched area", True),
        Convention("box", "Cosgrove et al. 2004, Sec. IV-B", "fraction of clutter boxes over the area of a box", False),
    )
}
CURVE_COLUMNS = (
    "threshold", "pd", "far", "n_detected", "n_false", "pd_low", "pd_high", "far_low", "far_high", "n_targets", "area",
)  # fmt: skip


def count_at(thresholds: FloatArray, scores: FloatArray) -> NDArray[np.int64]:
    """Count the scores at or above each threshold; a score of -inf never counts."""
    ordered = np.sort(scores)
    return len(ordered) - np.searchsorted(ordered, thresholds, side="left")


def make_curve(
    thresholds: FloatArray,
    n_detected: NDArray[Any],
    n_false: NDArray[Any],
    n_targets: int,
    area: float,
    attrs: Mapping[Any, Any],
    level: float = 0.95,
) -> pd.DataFrame:
    """Assemble a ROC table of false alarms over an area, m²; thresholds fall from +inf; without targets Pd is NaN."""
    if not (math.isfinite(area) and area > 0):
        raise ValueError(f"area must be positive, got {area:g} m²: the halos leave no room for false alarms")
    pd_low, pd_high = clopper_pearson(n_detected, n_targets, level)
    far_low, far_high = poisson_interval(n_false, area, level)
    found = n_detected / n_targets if n_targets else np.full(len(thresholds), np.nan)
    columns = (
        thresholds, found, n_false / area, n_detected, n_false, pd_low, pd_high, far_low, far_high,
        np.full(len(thresholds), n_targets), np.full(len(thresholds), float(area)),
    )  # fmt: skip
    curve = pd.DataFrame(dict(zip(CURVE_COLUMNS, columns, strict=True)))
    curve.attrs = {**dict(attrs), "n_targets": int(n_targets), "area": float(area), "level": float(level)}
    return curve


def pd_at(curve: pd.DataFrame, far: Any) -> Any:
    """Read Pd off a curve: the highest that is reached without exceeding a FAR or several, per m².

    Examples
    --------
    >>> from flgpr.scoring import example_roc, pd_at
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> pd_at(curve, [0.0, 0.019, 0.02])
    array([0.33333333, 0.33333333, 1.        ])
    """
    row = operating_row(curve, far)
    found = curve["pd"].to_numpy()[row]
    return float(found) if np.ndim(found) == 0 else found


def operating_row(curve: pd.DataFrame, far: Any) -> Any:
    """Find the row of a curve at an allowed FAR, per m², or several: the lowest threshold that does not exceed it."""
    allowed = np.asarray(far, dtype=np.float64)
    if not (allowed >= 0).all():
        raise ValueError(f"far must not be negative, got {far}")
    return np.searchsorted(curve["far"].to_numpy(), allowed, side="right") - 1


def pd_mean(curve: pd.DataFrame, far_max: float = 0.1, interpolation: Literal["step", "linear"] = "step") -> float:
    """Average Pd over FAR from 0 to ``far_max`` (Wang et al. 2007, Sec. II-F); NaN for a curve without targets.

    Parameters
    ----------
    curve : DataFrame
        ROC table.
    far_max : float
        End of the averaging, per m². A curve that ends before it keeps its last Pd.
    interpolation : {"step", "linear"}
        Between operating points the curve is a staircase, the Pd that a threshold does reach, or it is joined by
        straight lines, which needs a detector that decides by lot.

    Examples
    --------
    >>> from flgpr.scoring import example_roc, pd_mean
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> round(pd_mean(curve, far_max=0.1), 4)  # a third up to 0.02 per m², all beyond
    0.8667
    """
    one_of("interpolation", interpolation, ("step", "linear"))
    if not (math.isfinite(far_max) and far_max > 0):
        raise ValueError(f"far_max must be positive, got {far_max}")
    found, far = curve["pd"].to_numpy(), curve["far"].to_numpy()
    if np.isnan(found).any():
        return math.nan
    if interpolation == "step":
        edges = np.minimum(np.append(far, np.inf), far_max)
        return float((found * np.diff(edges)).sum() / far_max)
    inside = far <= far_max
    # Left of the last point within the limit the line leads on to the first point beyond it.
    end = np.interp(far_max, _strictly(far), found)
    f, p = np.append(far[inside], far_max), np.append(found[inside], end)
    return float(np.trapezoid(p, f) / far_max)


def pd_mean_by_chance(curve: pd.DataFrame, far_max: float) -> float:
    """Average the column ``chance`` of a curve as :func:`pd_mean` does Pd."""
    return pd_mean(curve.assign(pd=curve["chance"]), far_max)


def _strictly(far: FloatArray) -> FloatArray:
    """Break ties upwards, so that interpolation at a vertical step yields its top."""
    tied = np.append(far[1:] == far[:-1], False)
    return np.where(tied, np.nextafter(far, -np.inf), far)


def with_area(curve: pd.DataFrame, area: float, convention: Literal["lane", "frames", "examples"]) -> pd.DataFrame:
    """Express the FAR of a curve over another area, m², which is that of another convention.

    Either convention must count false alarms over an area: a fraction of boxes holds no such count, so that the
    conversion has no meaning and is a ValueError.
    """
    old = str(curve.attrs.get("convention", "unknown"))
    for name in (old, convention):
        if name not in CONVENTIONS or not CONVENTIONS[name].counts:
            raise ValueError(
                f"convention must count false alarms over an area to be converted, got {old!r} to {convention!r}: "
                "a fraction of boxes is no number of alarms"
            )
    return make_curve(
        curve["threshold"].to_numpy(),
        curve["n_detected"].to_numpy(),
        curve["n_false"].to_numpy(),
        int(curve.attrs["n_targets"]),
        area,
        {**curve.attrs, **describe(convention), "area_rule": "given"},
        float(curve.attrs["level"]),
    )


def describe(convention: str) -> dict[str, Any]:
    """Describe a convention in words that go with the table, in its ``attrs``."""
    known = CONVENTIONS[convention]
    return {"convention": known.name, "source": known.source, "far_is": known.far}
