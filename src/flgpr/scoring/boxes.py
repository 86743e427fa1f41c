"""ROC without a lane: of peaks in boxes (Cosgrove et al. 2004, Sec. IV-B), of examples (flsar2004, par. 45 and 52)."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from flgpr.model import as_lane, check_truth
from flgpr.scoring.curve import clopper_pearson, count_at, describe, make_curve
from flgpr.scoring.matching import LaneLike, Subset, check_place, positions, select_targets

FloatArray = NDArray[np.float64]


def box_roc(
    image: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    truth: pd.DataFrame,
    lane: LaneLike,
    box: float = 1.0,
    subset: Subset = None,
    *,
    clearance: float = 0.0,
    level: float = 0.95,
) -> pd.DataFrame:
    """Compute the ROC of a detector image from its peaks in boxes (Cosgrove et al. 2004, Sec. IV-B).

    H1 is the peak in the box around every target of the subset, H0 the peak in every box of a
    tiling of the lane that keeps off all known targets. Its FAR is the fraction of H0 boxes at or
    above the threshold over the area of a box. It saturates at one per box and is no count of
    alarms.

    Parameters
    ----------
    image : (y, x) or (look, y, x) array_like
        Detector output, higher means more like a mine; NaN where nothing was imaged. Looks of the
        same mine count as distinct samples, as in the paper.
    x, y : (x,), (y,) array_like
        Pixel centres in the lane frame, m, rising.
    truth, lane, subset
        As for :func:`flgpr.scoring.roc`; one lane.
    box, clearance : float
        Side of the boxes, and gap between H0 boxes and the box of any target, m.
    level : float
        Level of the Clopper-Pearson intervals, row by row.

    Returns
    -------
    DataFrame
        As of :func:`flgpr.scoring.roc`; ``n_targets`` is the number of H1 peaks, ``n_false`` that
        of H0 boxes at or above the threshold, ``area`` that of all H0 boxes.
    """
    truth = check_truth(truth)
    one = as_lane(lane)
    at = positions(truth)
    check_place(at, one, "truth")
    chosen = select_targets(truth, subset)
    peaks = box_peaks(image, x, y, at[chosen], box).ravel()
    clutter = box_peaks(image, x, y, offset_boxes(at, one, box, clearance), box).ravel()
    return peak_roc(peaks, clutter, box**2, level)


def peak_roc(
    target_peaks: ArrayLike, clutter_peaks: ArrayLike, box_area: float, level: float = 0.95
) -> pd.DataFrame:
    """Compute the ROC of peaks under H1 and H0, e.g. pooled over lanes; see :func:`box_roc`.

    Peaks that are NaN, of boxes that were not imaged, are left out; at least one must be left under
    H0. The area of a box is in m².

    Examples
    --------
    >>> from flgpr.scoring import peak_roc
    >>> curve = peak_roc([3.0, 5.0], [1.0, 2.0, 3.5, 0.5], box_area=1.0)
    >>> curve[["threshold", "pd", "far"]]
       threshold   pd   far
    0        inf  0.0  0.00
    1        5.0  0.5  0.00
    2        3.5  0.5  0.25
    3        3.0  1.0  0.25
    4        2.0  1.0  0.50
    5        1.0  1.0  0.75
    6        0.5  1.0  1.00
    """
    if not (math.isfinite(box_area) and box_area > 0):
        raise ValueError(f"box_area must be positive, got {box_area}")
    at, off = (
        np.asarray(peaks, dtype=np.float64).ravel() for peaks in (target_peaks, clutter_peaks)
    )
    unseen = int(np.isnan(at).sum())
    at = at[~np.isnan(at)]
    off = off[~np.isnan(off)]
    if len(off) == 0:
        raise ValueError("clutter_peaks must hold at least one imaged box, got none")
    thresholds = np.append(np.inf, np.unique(np.concatenate([at, off]))[::-1])
    n_false = count_at(thresholds, off)
    attrs = {
        **describe("box"),
        "box_area": float(box_area),
        "n_boxes": len(off),
        "n_not_imaged": unseen,
    }
    curve = make_curve(
        thresholds, count_at(thresholds, at), n_false, len(at), len(off) * box_area, attrs, level
    )
    low, high = clopper_pearson(n_false, len(off), level)
    return curve.assign(far_low=low / box_area, far_high=high / box_area)


def box_peaks(
    image: ArrayLike, x: ArrayLike, y: ArrayLike, centre: ArrayLike, box: float = 1.0
) -> FloatArray:
    """Find the peak of an image in boxes, as (look, box); NaN for a box without an imaged pixel.

    A box of side ``box`` about a ``centre`` (box, 2), m, holds the pixel centres from its lower border up to below its
    upper. Image and axes are as for :func:`box_roc`.
    """
    values = np.asarray(image, dtype=np.float64)
    across = np.asarray(x, dtype=np.float64)
    along = np.asarray(y, dtype=np.float64)
    if values.ndim not in (2, 3) or values.shape[-2:] != (along.size, across.size):
        raise ValueError(
            f"image must have the shape ([look,] {along.size}, {across.size}), got {values.shape}"
        )
    if (np.diff(across) <= 0).any() or (np.diff(along) <= 0).any():
        raise ValueError("x and y must rise strictly")
    if not (math.isfinite(box) and box > 0):
        raise ValueError(f"box must be positive, got {box}")
    values = values.reshape(-1, along.size, across.size)
    known = np.where(np.isnan(values), -np.inf, values)
    points = np.asarray(centre, dtype=np.float64).reshape(-1, 2)
    left, right = (np.searchsorted(across, points[:, 0] + half) for half in (-box / 2, box / 2))
    low, high = (np.searchsorted(along, points[:, 1] + half) for half in (-box / 2, box / 2))
    peaks = np.full((len(known), len(points)), -np.inf)
    for number in range(len(points)):
        patch = known[:, low[number] : high[number], left[number] : right[number]]
        if patch.size:
            peaks[:, number] = patch.max(axis=(1, 2))
    return np.where(np.isneginf(peaks), np.nan, peaks)


def offset_boxes(
    targets: ArrayLike, lane: LaneLike, box: float = 1.0, clearance: float = 0.0
) -> FloatArray:
    """Tile a lane with boxes from its lower left corner and keep those off the boxes of all targets.

    Targets (target, 2), the side of a box and the clearance to a target's box are in m, and so are the centres (box, 2)
    it gives; only boxes wholly inside the lane are made.
    """
    one = as_lane(lane)
    if not (math.isfinite(box) and box > 0 and clearance >= 0):
        raise ValueError(
            f"box must be positive and clearance not negative, got {box} m and {clearance} m"
        )
    columns = int((one.x_max - one.x_min) / box + 1e-9)
    rows = int((one.y_max - one.y_min) / box + 1e-9)
    x, y = np.meshgrid(
        one.x_min + box * (np.arange(columns) + 0.5), one.y_min + box * (np.arange(rows) + 0.5)
    )
    centres = np.stack([x.ravel(), y.ravel()], axis=1)
    points = np.asarray(targets, dtype=np.float64).reshape(-1, 2)
    apart = np.abs(centres[:, None, :] - points[None, :, :]).max(axis=-1, initial=0.0)
    return centres[(apart >= box + clearance - 1e-9).all(axis=1)]


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
    scores = np.asarray(score, dtype=np.float64)
    mine = np.asarray(is_target)
    if scores.ndim != 1 or mine.shape != scores.shape:
        raise ValueError(
            f"score and is_target must be of one length, got shapes {scores.shape} and {mine.shape}"
        )
    if not np.isin(mine, (0, 1)).all():
        raise ValueError(f"is_target must hold truth values, got {np.unique(mine)[:4]}")
    if not np.isfinite(scores).all():
        raise ValueError(
            f"score must be finite, got {int((~np.isfinite(scores)).sum())} values that are not"
        )
    mine = mine.astype(bool)
    found = int(mine.sum())
    total = found if n_targets is None else int(n_targets)
    if total < found:
        raise ValueError(f"n_targets must be at least the {found} target examples, got {n_targets}")
    if repeats < 1 or (len(scores) - found) % repeats:
        raise ValueError(
            f"repeats must divide the {len(scores) - found} clutter examples, got {repeats}"
        )
    if not (math.isfinite(area) and area > 0):
        raise ValueError(f"area must be positive, got {area}")
    thresholds = np.append(np.inf, np.unique(scores)[::-1])
    n_false = count_at(thresholds, scores[~mine])
    attrs = {
        **describe("examples"),
        "n_examples": len(scores),
        "n_prescreened": found,
        "repeats": int(repeats),
    }
    counted = n_false if repeats == 1 else n_false / repeats
    return make_curve(
        thresholds, count_at(thresholds, scores[mine]), counted, total, area, attrs, level
    )
