"""Binary clutter masks from VV, VH and a second band, and their thresholds (Fuse et al. 2018, Sec. 2.2 and 2.4)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Intersection = Literal["pixel", "region"]

ROADSIDE = (4.0, 10.0)
"""Distance from the middle of the road within which the extended mask holds, m (Sec. 2.4)."""
_NEIGHBOURS = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class Thresholds:
    """Magnitudes that a pixel must exceed, one per sub-region."""

    #: vv, vh: (region,) of the fundamental mask
    vv: FloatArray
    vh: FloatArray
    low_vh: FloatArray  #: (region,) of the extended mask
    second: FloatArray | None = None  #: (region,) of the second band; None for a single-band radar


def roadside_mask(level: NDArray[np.floating], inside: BoolArray, grow: int = 0) -> BoolArray:
    """Find the ground beside a lane that outshines everything in it, as a mask (y, x).

    ``level`` is a run-view of magnitudes, NaN where nothing was seen, and ``inside`` the pixels of
    the lane; the mask is grown by ``grow`` pixels, never into the lane.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import roadside_mask
    >>> level = np.array([[1.0, 9.0, 1.0, 5.0, 1.0], [1.0, 1.0, 4.0, 1.0, np.nan]])
    >>> roadside_mask(level, np.array([[False, False, True, True, True]] * 2)).astype(int)
    array([[0, 1, 0, 0, 0],
           [0, 0, 0, 0, 0]])
    """
    seen = np.isfinite(level)
    mask = ~inside & seen & (np.where(seen, level, 0) > level[inside & seen].max(initial=0.0))
    if grow and mask.any():
        mask = ndimage.binary_dilation(mask, iterations=grow) & ~inside
    return np.asarray(mask)


def subregions(distance: ArrayLike, edges: ArrayLike) -> IntArray:
    """Tell the sub-region in range of pixels (Fuse et al. 2018, Sec. 2.2, which takes four), -1 outside all.

    ``distance`` is the range of every pixel and ``edges`` are the borders, m, rising; a lower
    border is within, the last one too.

    Examples
    --------
    >>> from flgpr.clutter import subregions
    >>> subregions([4.0, 5.0, 9.9, 10.0, 15.0, 16.0], (5, 7.5, 10, 12.5, 15))
    array([-1,  0,  1,  2,  3, -1])
    """
    borders = np.asarray(edges, dtype=np.float64)
    ahead = np.asarray(distance, dtype=np.float64)
    if borders.ndim != 1 or borders.size < 2 or not (np.diff(borders) > 0).all():
        raise ValueError(f"edges must be at least two rising ranges, got {edges!r}")
    number = np.searchsorted(borders, ahead, side="right") - 1
    number[ahead == borders[-1]] = borders.size - 2
    return np.where((ahead >= borders[0]) & (ahead <= borders[-1]), number, -1).astype(np.int64)


def above(image: ArrayLike, threshold: ArrayLike, region: IntArray) -> BoolArray:
    """Mark the pixels (y, x) whose magnitude exceeds their sub-region's threshold: the binary mask m (Sec. 2.2).

    Of pixels in no sub-region, see :func:`subregions`, none is marked.
    """
    magnitude = np.abs(np.asarray(image))
    limit = np.asarray(threshold, dtype=np.float64)
    if magnitude.shape != region.shape:
        raise ValueError(
            f"image must have the shape of region, {region.shape}, got {magnitude.shape}"
        )
    if limit.ndim != 1 or limit.size <= region.max(initial=-1) or not (limit >= 0).all():
        raise ValueError(
            f"threshold must hold one number of at least 0 per sub-region, got {threshold!r}"
        )
    return np.asarray((region >= 0) & (magnitude > limit[np.maximum(region, 0)]))


def intersect(shape: BoolArray, other: BoolArray, by: Intersection = "pixel") -> BoolArray:
    """Intersect two binary masks (y, x): the pixels that both hold, or whole regions of ``shape`` (eight neighbours).

    The paper compares "each region" and selects "the intersection", which can be read both ways: with "region", a
    connected region stays whole if it shares a pixel with ``other``.
    """
    if shape.shape != other.shape:
        raise ValueError(f"masks must have one shape, got {shape.shape} and {other.shape}")
    if by == "pixel":
        return shape & other
    if by != "region":
        raise ValueError(f"by must be pixel or region, got {by!r}")
    label, count = ndimage.label(shape, _NEIGHBOURS)
    chosen = np.zeros(count + 1, dtype=bool)
    chosen[label[other]] = True
    chosen[0] = False
    return np.asarray(chosen[label])


def fundamental_mask(
    vv: ArrayLike,
    vh: ArrayLike,
    thresholds: Thresholds,
    region: IntArray,
    second: ArrayLike | None = None,
    by: Intersection = "pixel",
) -> BoolArray:
    """Make the fundamental mask, VV∩VH ∪ VV∩X (Fuse et al. 2018, Fig. 2a).

    Parameters
    ----------
    vv, vh : (y, x) array_like
        Images of the band that is cleaned.
    thresholds : Thresholds
        From a calibration lane.
    region : (y, x) ndarray of int
        From :func:`subregions`.
    second : (y, x) array_like, optional
        Image of the second band on the same pixels. Without it the mask is VV∩VH alone.
    by : {"pixel", "region"}
        As for :func:`intersect`.
    """
    shape = above(vv, thresholds.vv, region)
    mask = intersect(shape, above(vh, thresholds.vh, region), by)
    if second is None:
        return mask
    if thresholds.second is None:
        raise ValueError("thresholds must hold those of the second band to use its image, got none")
    return mask | intersect(shape, above(second, thresholds.second, region), by)


def extended_mask(
    vh: ArrayLike,
    thresholds: Thresholds,
    region: IntArray,
    across: ArrayLike,
    roadside: tuple[float, float] = ROADSIDE,
) -> BoolArray:
    """Make the extended mask of the roadside (Fuse et al. 2018, Fig. 2b) from a VH image (y, x) and its low threshold.

    The paper unites (VV_low ∩ VH_low) with VH_low. That union is VH_low, whatever VV_low is, so VV does not enter. It
    holds where a pixel's distance ``across`` from the middle of the road, m, of either sign, lies in ``roadside``.
    """
    least, greatest = roadside
    if not 0 <= least < greatest:
        raise ValueError(f"roadside must have 0 <= least < greatest, got {roadside}")
    away = np.abs(np.asarray(across, dtype=np.float64))
    return above(vh, thresholds.low_vh, region) & (away >= least) & (away <= greatest)


def roadside_level(
    image: ArrayLike, region: IntArray, roadside: BoolArray, regions: int
) -> FloatArray:
    """Average the magnitude of an image (y, x) at the roadside, sub-region by sub-region; NaN where there is none.

    Of the VH image of the frame under test it is the threshold of the extended mask as the paper has it: "the average
    value of the roadside clutter in a frame in test lane" (Fuse et al. 2018, Sec. 2.4). No target's place enters.
    """
    magnitude = np.abs(np.asarray(image))
    level = np.full(regions, np.nan)
    for number in range(regions):
        beside = roadside & (region == number)
        if beside.any():
            level[number] = magnitude[beside].mean()
    return level


def mixed_mask(
    vv: ArrayLike,
    vh: ArrayLike,
    thresholds: Thresholds,
    region: IntArray,
    across: ArrayLike,
    second: ArrayLike | None = None,
    by: Intersection = "pixel",
    roadside: tuple[float, float] = ROADSIDE,
) -> BoolArray:
    """Unite the fundamental and the extended mask (Fuse et al. 2018, Fig. 6).

    See :func:`fundamental_mask` and :func:`extended_mask` for the parameters.
    """
    return fundamental_mask(vv, vh, thresholds, region, second, by) | extended_mask(
        vh, thresholds, region, across, roadside
    )


class ThresholdCalibration:
    """Find thresholds on a calibration lane, "as low as possible without compromising the target signal response".

    A target's response is what lies in its halo within ``response_db`` of its peak in VV. Per sub-region, the
    thresholds of VH and of the second band are the largest that any target's response reaches there, so that no mask
    holds it. That of VV is the smallest peak of any target: what is weaker cannot be mistaken for one. The low
    threshold of VH is the mean magnitude at the roadside, mean over frames, of the calibration lane; the paper takes
    it from a frame of the lane under test, see :func:`roadside_level`.
    """

    def __init__(self, regions: int, response_db: float = 6.0) -> None:
        if regions < 1 or not response_db > 0:
            raise ValueError(
                f"regions and response_db must be positive, got {regions} and {response_db}"
            )
        self.regions = regions
        self.response_db = response_db
        self.targets = np.zeros(regions, np.int64)
        self._vv = np.full(regions, np.inf)
        self._vh = np.zeros(regions)
        self._second = np.zeros(regions)
        self._has_second = False
        self._roadside: list[FloatArray] = []

    def add(
        self,
        vv: ArrayLike,
        vh: ArrayLike,
        region: IntArray,
        halos: Iterable[BoolArray],
        roadside: BoolArray,
        second: ArrayLike | None = None,
    ) -> None:
        """Take in one frame: images (y, x) in VV, VH and perhaps of the second band.

        ``region`` is from :func:`subregions`; ``halos`` are the pixels about each target in view, ``roadside`` those
        beside the lane.
        """
        strong = np.abs(np.asarray(vv))
        cross = np.abs(np.asarray(vh))
        other = None if second is None else np.abs(np.asarray(second))
        self._has_second |= other is not None
        for halo in halos:
            inside = halo & (region >= 0)
            if not inside.any():
                continue
            peak = np.unravel_index(int(np.where(inside, strong, -1.0).argmax()), strong.shape)
            where = int(region[peak])
            top = float(strong[peak])
            response = inside & (strong >= top * 10 ** (-self.response_db / 20))
            self.targets[where] += 1
            self._vv[where] = min(self._vv[where], top)
            self._vh[where] = max(self._vh[where], float(cross[response].max()))
            if other is not None:
                self._second[where] = max(self._second[where], float(other[response].max()))
        self._roadside.append(roadside_level(cross, region, roadside, self.regions))

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what was gathered, to be taken in by another."""
        levels = np.asarray(self._roadside).reshape(-1, self.regions)
        kept = {
            "targets": self.targets,
            "vv": self._vv,
            "vh": self._vh,
            "second": self._second,
            "roadside": levels,
        }
        return kept | {"has_second": np.array(self._has_second)}

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other frames or lanes."""
        self.targets = self.targets + state["targets"]
        self._vv = np.minimum(self._vv, state["vv"])
        self._vh, self._second = (
            np.maximum(self._vh, state["vh"]),
            np.maximum(self._second, state["second"]),
        )
        self._has_second |= bool(state["has_second"])
        self._roadside += list(state["roadside"])

    def result(self) -> Thresholds:
        """Compute the thresholds of every sub-region; each must have shown a target and roadside."""
        if (self.targets == 0).any():
            raise ValueError(
                f"every sub-region must have shown a target, got {self.targets.tolist()} looks"
            )
        levels = np.asarray(self._roadside)
        if np.isnan(levels).all(axis=0).any():
            raise ValueError("every sub-region must have shown roadside, got one without")
        second = self._second.copy() if self._has_second else None
        return Thresholds(self._vv.copy(), self._vh.copy(), np.nanmean(levels, axis=0), second)
