"""ROC without alarms, of the peaks of an image in boxes: Cosgrove et al. 2004, Sec. IV-B."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from flgpr.model import as_lane, check_truth
from flgpr.scoring.curve import clopper_pearson, count_at, describe, make_curve
from flgpr.scoring.matching import (
    LaneLike,
    Subset,
    check_place,
    positions,
    select_targets,
)
from flgpr.types import ArrayLike, FloatArray, floats


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
    """Compute the ROC of a detector image from its peaks in boxes.

    It is that of Cosgrove et al. 2004, Sec. IV-B. H1 is the peak in the box around every target of
    the subset, H0 the peak in every box of a tiling of the lane that keeps off all known targets.
    Its FAR is the fraction of H0 boxes at or above the threshold over the area of a box. It
    saturates at one per box and is no count of alarms.

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

    Raises
    ------
    ValueError
        If the truth, the lane, the image or a size is not valid, or no H0 box was imaged.
    """
    truth = check_truth(truth)
    scored_lane = as_lane(lane)
    targets = positions(truth)
    check_place(targets, scored_lane, "truth")
    chosen = select_targets(truth, subset)
    clutter_boxes = offset_boxes(targets, scored_lane, box, clearance)
    target_peaks = box_peaks(image, x, y, targets[chosen], box).ravel()
    clutter_peaks = box_peaks(image, x, y, clutter_boxes, box).ravel()
    return peak_roc(target_peaks, clutter_peaks, box**2, level)


def peak_roc(
    target_peaks: ArrayLike, clutter_peaks: ArrayLike, box_area: float, level: float = 0.95
) -> pd.DataFrame:
    """Compute the ROC of peaks under H1 and H0, e.g. pooled over lanes; see :func:`box_roc`.

    Parameters
    ----------
    target_peaks, clutter_peaks : (peak,) array_like
        Peaks under H1 and H0; NaN, of a box that was not imaged, is left out.
    box_area : float
        Area of a box, m².
    level : float
        Level of the Clopper-Pearson intervals, row by row.

    Returns
    -------
    DataFrame
        As of :func:`box_roc`; ``attrs["n_not_imaged"]`` counts the target boxes left out.

    Raises
    ------
    ValueError
        If the area or the level is not valid, or no peak is left under H0.

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
    both = [floats(peaks).ravel() for peaks in (target_peaks, clutter_peaks)]
    h1, h0 = [peaks[~np.isnan(peaks)] for peaks in both]
    if len(h0) == 0:
        raise ValueError("clutter_peaks must hold at least one imaged box, got none")
    thresholds = np.append(np.inf, np.unique(np.concatenate([h1, h0]))[::-1])
    n_detected = count_at(thresholds, h1)
    n_false = count_at(thresholds, h0)
    attrs = {
        **describe("box"),
        "box_area": float(box_area),
        "n_boxes": len(h0),
        "n_not_imaged": both[0].size - h1.size,
    }
    curve = make_curve(thresholds, n_detected, n_false, len(h1), len(h0) * box_area, attrs, level)
    low, high = clopper_pearson(n_false, len(h0), level)
    return curve.assign(far_low=low / box_area, far_high=high / box_area)


def box_peaks(
    image: ArrayLike, x: ArrayLike, y: ArrayLike, centre: ArrayLike, box: float = 1.0
) -> FloatArray:
    """Find the peak of an image in boxes.

    Parameters
    ----------
    image, x, y
        Image and axes, as for :func:`box_roc`.
    centre : (box, 2) array_like
        Centres of the boxes, m.
    box : float
        Side of the boxes, m. A box holds the pixel centres from its lower border up to below its
        upper one.

    Returns
    -------
    (look, box) ndarray
        Highest value in each box; NaN for a box without an imaged pixel.

    Raises
    ------
    ValueError
        If the shapes do not fit, an axis does not rise, or the side is not positive.
    """
    values = floats(image)
    across = floats(x)
    along = floats(y)
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
    points = floats(centre).reshape(-1, 2)
    columns = np.searchsorted(across, points[:, :1] + [-box / 2, box / 2])
    rows = np.searchsorted(along, points[:, 1:] + [-box / 2, box / 2])
    peaks = np.full((len(known), len(points)), -np.inf)
    for number, (row, column) in enumerate(zip(rows, columns, strict=True)):
        patch = known[:, slice(*row), slice(*column)]
        peaks[:, number] = patch.max(axis=(1, 2), initial=-np.inf)
    return np.where(np.isneginf(peaks), np.nan, peaks)


def offset_boxes(
    targets: ArrayLike, lane: LaneLike, box: float = 1.0, clearance: float = 0.0
) -> FloatArray:
    """Tile a lane with boxes that keep off the boxes of all targets.

    Parameters
    ----------
    targets : (target, 2) array_like
        Positions of the targets, m.
    lane
        The lane; the tiling begins at its lower left corner and stays inside.
    box, clearance : float
        Side of the boxes, and gap to the box of any target, m.

    Returns
    -------
    (box, 2) ndarray
        Centres of the boxes, m.

    Raises
    ------
    ValueError
        If the lane or a size is not valid.
    """
    tiled = as_lane(lane)
    if not (math.isfinite(box) and box > 0 and clearance >= 0):
        raise ValueError(
            f"box must be positive and clearance not negative, got {box} m and {clearance} m"
        )
    across, along = [
        low + box * (np.arange(int((high - low) / box + 1e-9)) + 0.5)
        for low, high in ((tiled.x_min, tiled.x_max), (tiled.y_min, tiled.y_max))
    ]
    centres = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    points = floats(targets).reshape(-1, 2)
    apart = np.abs(centres[:, None, :] - points[None, :, :]).max(axis=-1, initial=0.0)
    return centres[(apart >= box + clearance - 1e-9).all(axis=1)]
