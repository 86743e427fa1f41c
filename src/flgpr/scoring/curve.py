"""The ROC table of all conventions, which it names, and the exact intervals of its rates."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy import special
from scipy.interpolate import CubicSpline

from flgpr.types import AnyArray, ArrayLike, BoolArray, Entries, FloatArray, IntArray, floats

_NODES = 400
_SMOOTH = 500.0


def clopper_pearson(
    successes: ArrayLike, trials: ArrayLike, level: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Compute the exact binomial interval of a probability (Clopper & Pearson 1934), equal tails.

    Parameters
    ----------
    successes, trials : array_like
        Counts, broadcast against one another; effective numbers of looks need not be whole.
    level : float
        Level, which the interval covers at least.

    Returns
    -------
    low, high : ndarray
        Bounds of the probability, 0 and 1 without any trial.

    Raises
    ------
    ValueError
        If there are more successes than trials, or the level is not between 0 and 1.

    Examples
    --------
    All of 12 found says little of the thirteenth; none of 50 bounds from above.

    >>> from flgpr.scoring import clopper_pearson
    >>> low, high = clopper_pearson([12, 9, 0], [12, 12, 50])
    >>> low.round(3), high.round(3)
    (array([0.735, 0.428, 0.   ]), array([1.   , 0.945, 0.071]))
    """
    tail = (1 - check_level(level)) / 2
    k, n = np.broadcast_arrays(floats(successes), floats(trials))
    if ((k < 0) | (k > n)).any():
        raise ValueError(
            f"successes must lie between 0 and trials, got {k.min():g}..{k.max():g} of {n.min():g}"
        )
    some = np.where(k > 0, k, 1.0)
    missed = np.where(k < n, n - k, 1.0)
    low = np.where(k > 0, special.betaincinv(some, n - k + 1, tail), 0.0)
    high = np.where(k < n, special.betaincinv(k + 1, missed, 1 - tail), 1.0)
    return low, high


def poisson_interval(
    count: ArrayLike, exposure: ArrayLike = 1.0, level: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Compute the exact Poisson interval of a rate (Garwood 1936), equal tails.

    Parameters
    ----------
    count : array_like
        Numbers of events; a mean of repeated counts need not be whole.
    exposure : array_like
        What the events are counted over, e.g. an area, m².
    level : float
        Level, which the interval covers at least.

    Returns
    -------
    low, high : ndarray
        Bounds of the rate, per unit of exposure.

    Raises
    ------
    ValueError
        If a count is negative, an exposure is not positive, or the level is not between 0 and 1.

    Examples
    --------
    No false alarm on 300 m², and three:

    >>> from flgpr.scoring import poisson_interval
    >>> low, high = poisson_interval([0, 3], 300.0)
    >>> low.round(4), high.round(4)  # per m²
    (array([0.    , 0.0021]), array([0.0123, 0.0292]))
    """
    tail = (1 - check_level(level)) / 2
    counts = floats(count)
    exposures = floats(exposure)
    if (counts < 0).any():
        raise ValueError(f"count must not be negative, got {counts.min():g}")
    if not (exposures > 0).all():
        raise ValueError(f"exposure must be positive, got {exposures.min():g}")
    # A curve of many rows holds the same count again and again: invert each once.
    n, inverse = np.unique(counts, return_inverse=True)
    low = _gamma_quantile(n, tail)[inverse].reshape(counts.shape)
    high = _gamma_quantile(n + 1, 1 - tail)[inverse].reshape(counts.shape)
    return low / exposures, high / exposures


def _gamma_quantile(shape: FloatArray, probability: float) -> FloatArray:
    """Invert the regularised incomplete gamma function for rising shapes; 0 for the shape 0."""
    if len(shape) <= 4 * _NODES or shape[0] < _SMOOTH:
        small = shape[: max(4 * _NODES, int(np.searchsorted(shape, _SMOOTH)))]
        is_positive = small > 0
        inverse = special.gammaincinv(np.where(is_positive, small, 1), probability)
        exact = np.where(is_positive, inverse, 0.0)
        rest = shape[len(small) :]
        if len(rest) == 0:
            return exact
        return np.append(exact, _gamma_quantile(rest, probability))
    # The standardised quantile varies slowly with the shape: a spline through nodes agrees to 1e-12
    # and takes no time.
    nodes = np.geomspace(shape[0], shape[-1], _NODES)
    standardised = (special.gammaincinv(nodes, probability) - nodes) / np.sqrt(nodes)
    spline = CubicSpline(np.log(nodes), standardised)
    return shape + np.sqrt(shape) * spline(np.log(shape))


def check_level(level: float) -> float:
    """Return a level of intervals, which must lie between 0 and 1."""
    if not 0 < level < 1:
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    return level


@dataclass(frozen=True)
class Convention:
    """How a ROC counts."""

    name: str  #: its name, found in ``curve.attrs["convention"]``
    source: str  #: the paper it follows
    far: str  #: what its FAR is
    #: whether FAR is a number of alarms over an area; then curves convert by exchanging the area
    counts: bool


CONVENTIONS = {
    convention.name: convention
    for convention in (
        Convention(
            "lane",
            "Wang et al. 2007, rules 1-6",
            "false alarms over the lane's area outside the halos",
            True,
        ),
        Convention(
            "frames", "Fuse et al. 2018, Fig. 9", "false alarms over the area of all frames", True
        ),
        Convention(
            "examples",
            "flsar2004, par. 45",
            "clutter examples called mines over the searched area",
            True,
        ),
        Convention(
            "box",
            "Cosgrove et al. 2004, Sec. IV-B",
            "fraction of clutter boxes over the area of a box",
            False,
        ),
    )
}
CURVE_COLUMNS = (
    "threshold",
    "pd",
    "far",
    "n_detected",
    "n_false",
    "pd_low",
    "pd_high",
    "far_low",
    "far_high",
    "n_targets",
    "area",
)


def count_at(thresholds: FloatArray, scores: FloatArray) -> IntArray:
    """Count the scores at or above each threshold; a score of -inf never counts."""
    ordered = np.sort(scores)
    return len(ordered) - np.searchsorted(ordered, thresholds, side="left")


def make_curve(
    thresholds: FloatArray,
    n_detected: AnyArray,
    n_false: AnyArray,
    n_targets: int,
    area: float,
    attrs: Mapping[Any, Any],
    level: float = 0.95,
) -> pd.DataFrame:
    """Return a ROC table of false alarms over an area, m².

    The thresholds fall from +inf. Without targets Pd is NaN.
    """
    if not (math.isfinite(area) and area > 0):
        raise ValueError(
            f"area must be positive, got {area:g} m²: the halos leave no room for false alarms"
        )
    pd_low, pd_high = clopper_pearson(n_detected, n_targets, level)
    far_low, far_high = poisson_interval(n_false, area, level)
    rows = len(thresholds)
    curve = pd.DataFrame(
        {
            "threshold": thresholds,
            "pd": n_detected / n_targets if n_targets else np.full(rows, np.nan),
            "far": n_false / area,
            "n_detected": n_detected,
            "n_false": n_false,
            "pd_low": pd_low,
            "pd_high": pd_high,
            "far_low": far_low,
            "far_high": far_high,
            "n_targets": np.full(rows, n_targets),
            "area": np.full(rows, float(area)),
        },
        columns=list(CURVE_COLUMNS),
    )
    curve.attrs = {
        **dict(attrs),
        "n_targets": int(n_targets),
        "area": float(area),
        "level": float(level),
    }
    return curve


def example_roc(
    score: ArrayLike,
    is_target: ArrayLike,
    area: float,
    *,
    n_targets: int | None = None,
    repeats: int = 1,
    level: float = 0.95,
) -> pd.DataFrame:
    """Compute the ROC of held-out scores of examples, false alarms over the area that was searched.

    Every example that passed the prescreener counts by itself, whether or not another shows the
    same mine.

    Parameters
    ----------
    score : (example,) array_like
        Held-out score of each example, e.g. leave-one-out.
    is_target : (example,) array_like of bool
        Whether it shows a target.
    area : float
        Area that was searched to find the examples, m².
    n_targets : int, optional
        Number of target examples with those that a prescreener lost; by default none was lost.
    repeats : int
        How often each clutter example occurs, e.g. once for each held-out mine with a one-class
        detector (flsar2004, par. 52); the false alarms are divided by it.
    level : float
        Level of the exact intervals of each row.

    Returns
    -------
    DataFrame
        As of :func:`flgpr.scoring.roc`.

    Raises
    ------
    ValueError
        If shapes differ, a score is not finite, ``n_targets`` is less than the target examples, or
        ``repeats`` does not divide the number of clutter examples.

    Examples
    --------
    >>> from flgpr.scoring import example_roc
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> curve[["threshold", "pd", "far"]].round(3)
       threshold     pd   far
    0        inf  0.000  0.00
    1        4.0  0.333  0.00
    2        3.0  0.333  0.02
    3        2.0  0.667  0.02
    4        1.0  1.000  0.02
    """
    scores, is_target_example = _checked_examples(score, is_target)
    n_prescreened = int(is_target_example.sum())
    n_clutter = len(scores) - n_prescreened
    total = n_prescreened if n_targets is None else int(n_targets)
    if total < n_prescreened:
        raise ValueError(
            f"n_targets must be at least the {n_prescreened} target examples, got {n_targets}"
        )
    if repeats < 1 or n_clutter % repeats:
        raise ValueError(f"repeats must divide the {n_clutter} clutter examples, got {repeats}")
    if not (math.isfinite(area) and area > 0):
        raise ValueError(f"area must be positive, got {area}")

    thresholds = np.append(np.inf, np.unique(scores)[::-1])
    n_detected = count_at(thresholds, scores[is_target_example])
    n_false = count_at(thresholds, scores[~is_target_example])
    attrs = {
        **describe("examples"),
        "n_examples": len(scores),
        "n_prescreened": n_prescreened,
        "repeats": int(repeats),
    }
    counted = n_false if repeats == 1 else n_false / repeats
    return make_curve(thresholds, n_detected, counted, total, area, attrs, level)


def _checked_examples(score: ArrayLike, is_target: ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Return scores and labels of examples as arrays (example,), which must fit together."""
    scores = floats(score)
    labels = np.asarray(is_target)
    if scores.ndim != 1 or labels.shape != scores.shape:
        raise ValueError(
            "score and is_target must be of one length, "
            f"got shapes {scores.shape} and {labels.shape}"
        )
    if not np.isin(labels, (0, 1)).all():
        raise ValueError(f"is_target must hold truth values, got {np.unique(labels)[:4]}")
    if not np.isfinite(scores).all():
        raise ValueError(
            f"score must be finite, got {int((~np.isfinite(scores)).sum())} values that are not"
        )
    return scores, labels.astype(bool)


def pd_at(curve: pd.DataFrame, far: Any) -> Any:
    """Return the highest Pd of a curve that is reached without exceeding a false alarm rate.

    Parameters
    ----------
    curve : DataFrame
        ROC table.
    far : float or (point,) array_like
        Allowed false alarm rates, per m².

    Returns
    -------
    float or (point,) ndarray
        Pd at each rate.

    Raises
    ------
    ValueError
        If a rate is negative.

    Examples
    --------
    >>> from flgpr.scoring import example_roc, pd_at
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> pd_at(curve, [0.0, 0.019, 0.02])
    array([0.33333333, 0.33333333, 1.        ])
    """
    row = operating_row(curve, far)
    detected = curve["pd"].to_numpy()[row]
    return float(detected) if np.ndim(detected) == 0 else detected


def operating_row(curve: pd.DataFrame, far: Any) -> Any:
    """Find the row of a curve with the lowest threshold that does not exceed a false alarm rate.

    Parameters
    ----------
    curve : DataFrame
        ROC table.
    far : float or (point,) array_like
        Allowed false alarm rates, per m².

    Returns
    -------
    int or (point,) ndarray of int
        Row number for each rate.

    Raises
    ------
    ValueError
        If a rate is negative.
    """
    allowed = floats(far)
    if not (allowed >= 0).all():
        raise ValueError(f"far must not be negative, got {far}")
    return np.searchsorted(curve["far"].to_numpy(), allowed, side="right") - 1


def pd_mean(curve: pd.DataFrame, far_max: float = 0.1) -> float:
    """Compute PD_mean, the average of Pd over FAR from 0 to ``far_max``.

    It is that of Wang et al. 2007, Sec. II-F. Between operating points the curve is a staircase,
    the Pd that a threshold does reach.

    Parameters
    ----------
    curve : DataFrame
        ROC table.
    far_max : float
        End of the averaging, per m². A curve that ends before it keeps its last Pd; unless that is
        1, a warning says so.

    Returns
    -------
    float
        PD_mean; NaN for a curve without targets.

    Raises
    ------
    ValueError
        If ``far_max`` is not positive.

    Examples
    --------
    >>> from flgpr.scoring import example_roc, pd_mean
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> round(pd_mean(curve, far_max=0.1), 4)  # a third up to 0.02 per m², all beyond
    0.8667
    """
    last = curve.iloc[-1]
    if last["far"] < far_max and last["pd"] < 1:
        warnings.warn(
            f"curve ends at {last['far']:.3g} false alarms per m²: from there to far_max of "
            f"{far_max:g} its last Pd, {last['pd']:.3g}, is taken",
            stacklevel=2,
        )
    return held_pd_mean(curve, far_max)


def held_pd_mean(curve: pd.DataFrame, far_max: float = 0.1) -> float:
    """Compute PD_mean as :func:`pd_mean` does, for pages that show where the curve ends."""
    if not (math.isfinite(far_max) and far_max > 0):
        raise ValueError(f"far_max must be positive, got {far_max}")
    detected = curve["pd"].to_numpy()
    far = curve["far"].to_numpy()
    if np.isnan(detected).any():
        return math.nan
    edges = np.minimum(np.append(far, np.inf), far_max)
    return float((detected * np.diff(edges)).sum() / far_max)


def pd_mean_by_chance(curve: pd.DataFrame, far_max: float) -> float:
    """Compute the average of the column ``chance`` of a curve, as :func:`pd_mean` does for Pd."""
    return held_pd_mean(curve.assign(pd=curve["chance"]), far_max)


def with_area(
    curve: pd.DataFrame, area: float, convention: Literal["lane", "frames", "examples"]
) -> pd.DataFrame:
    """Return a curve whose FAR refers to the area of another convention.

    Parameters
    ----------
    curve : DataFrame
        ROC table.
    area : float
        Area of the other convention, m².
    convention : {"lane", "frames", "examples"}
        The other convention.

    Returns
    -------
    DataFrame
        ROC table of the same counts.

    Raises
    ------
    ValueError
        If one of the conventions does not count false alarms over an area. A fraction of boxes
        holds no such count, so that the conversion has no meaning.
    """
    old = str(curve.attrs.get("convention", "unknown"))
    for name in (old, convention):
        if name not in CONVENTIONS or not CONVENTIONS[name].counts:
            raise ValueError(
                "convention must count false alarms over an area to be converted, "
                f"got {old!r} to {convention!r}: a fraction of boxes is no number of alarms"
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


def describe(convention: str) -> Entries:
    """Return the entries of a table's ``attrs`` that describe a convention."""
    chosen = CONVENTIONS[convention]
    return {"convention": chosen.name, "source": chosen.source, "far_is": chosen.far}
