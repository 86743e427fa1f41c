"""Binary clutter masks from VV, VH and a second band, and their thresholds (Fuse et al. 2018).

They are described in Sec. 2.2 and 2.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from flgpr.types import AnyArray, Arrays, BoolArray, FloatArray, IntArray, floats

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
    """Return the pixels beside a lane that outshine everything in it.

    Parameters
    ----------
    level : (y, x) ndarray
        Run-view of magnitudes, NaN where no scan sees the pixel.
    inside : (y, x) ndarray of bool
        Pixels of the lane.
    grow : int
        Pixels by which the mask is grown, never into the lane.

    Returns
    -------
    (y, x) ndarray of bool
        Mask.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import roadside_mask
    >>> level = np.array([[1.0, 9.0, 1.0, 5.0, 1.0], [1.0, 1.0, 4.0, 1.0, np.nan]])
    >>> roadside_mask(level, np.array([[False, False, True, True, True]] * 2)).astype(int)
    array([[0, 1, 0, 0, 0],
           [0, 0, 0, 0, 0]])
    """
    known = np.isfinite(level)
    brightest_inside = level[inside & known].max(initial=0.0)
    mask = ~inside & known & (np.where(known, level, 0) > brightest_inside)
    if grow and mask.any():
        mask = ndimage.binary_dilation(mask, iterations=grow) & ~inside
    return np.asarray(mask)


def subregions(distance: ArrayLike, edges: ArrayLike) -> IntArray:
    """Return the sub-region in range of every pixel (Fuse et al. 2018, Sec. 2.2, which takes four).

    Parameters
    ----------
    distance : (...,) array_like
        Range of every pixel, m.
    edges : (region + 1,) array_like
        Rising borders, m; a lower border belongs to its sub-region, the last one too.

    Returns
    -------
    (...,) ndarray of int
        Number of the sub-region, -1 outside all.

    Raises
    ------
    ValueError
        If the borders do not rise or there are fewer than two.

    Examples
    --------
    >>> from flgpr.clutter import subregions
    >>> subregions([4.0, 5.0, 9.9, 10.0, 15.0, 16.0], (5, 7.5, 10, 12.5, 15))
    array([-1,  0,  1,  2,  3, -1])
    """
    borders = floats(edges)
    ranges = floats(distance)
    if borders.ndim != 1 or borders.size < 2 or not (np.diff(borders) > 0).all():
        raise ValueError(f"edges must be at least two rising ranges, got {edges!r}")
    number = np.searchsorted(borders, ranges, side="right") - 1
    number[ranges == borders[-1]] = borders.size - 2
    within = (ranges >= borders[0]) & (ranges <= borders[-1])
    return np.where(within, number, -1).astype(np.int64)


def above(image: ArrayLike, threshold: ArrayLike, region: IntArray) -> BoolArray:
    """Mark the pixels whose magnitude exceeds the threshold of their sub-region.

    This is the binary mask m of Fuse et al. 2018, Sec. 2.2.

    Parameters
    ----------
    image : (y, x) array_like
        Image, complex or magnitude.
    threshold : (region,) array_like
        Least magnitude by sub-region, in units of the image.
    region : (y, x) ndarray of int
        From :func:`subregions`; pixels in no sub-region are never marked.

    Returns
    -------
    (y, x) ndarray of bool
        Mask.

    Raises
    ------
    ValueError
        If the shapes differ, or a sub-region has no threshold of at least 0.
    """
    magnitude = np.abs(np.asarray(image))
    limit = floats(threshold)
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
    """Intersect two binary masks, pixel by pixel or by connected regions.

    The paper compares "each region" and selects "the intersection", which can be read both ways.

    Parameters
    ----------
    shape, other : (y, x) ndarray of bool
        Masks.
    by : {"pixel", "region"}
        Pixels that both hold, or all regions of ``shape`` (of eight neighbours) that share a pixel
        with ``other``.

    Returns
    -------
    (y, x) ndarray of bool
        Mask.

    Raises
    ------
    ValueError
        If the shapes differ or ``by`` is unknown.
    """
    if shape.shape != other.shape:
        raise ValueError(f"masks must have one shape, got {shape.shape} and {other.shape}")
    if by == "pixel":
        return shape & other
    if by != "region":
        raise ValueError(f"by must be pixel or region, got {by!r}")
    label, count = ndimage.label(shape, _NEIGHBOURS)
    shared = np.zeros(count + 1, dtype=bool)
    shared[label[other]] = True
    shared[0] = False  # the background
    return np.asarray(shared[label])


def fundamental_mask(
    vv: ArrayLike,
    vh: ArrayLike,
    thresholds: Thresholds,
    region: IntArray,
    second: ArrayLike | None = None,
    by: Intersection = "pixel",
) -> BoolArray:
    """Return the fundamental mask, VV∩VH ∪ VV∩X (Fuse et al. 2018, Fig. 2a).

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

    Returns
    -------
    (y, x) ndarray of bool
        Mask.

    Raises
    ------
    ValueError
        If there is an image of the second band without thresholds for it.
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
    """Return the extended mask of the roadside (Fuse et al. 2018, Fig. 2b).

    The paper unites (VV_low ∩ VH_low) with VH_low. That union is VH_low, whatever VV_low is, so VV
    does not enter.

    Parameters
    ----------
    vh : (y, x) array_like
        VH image.
    thresholds : Thresholds
        Of them the low threshold of VH.
    region : (y, x) ndarray of int
        From :func:`subregions`.
    across : (y, x) array_like
        Distance of every pixel from the middle of the road, of either sign, m.
    roadside : tuple of float
        Least and greatest distance at which the mask holds, m.

    Returns
    -------
    (y, x) ndarray of bool
        Mask.

    Raises
    ------
    ValueError
        If the roadside is empty.
    """
    least, greatest = roadside
    if not 0 <= least < greatest:
        raise ValueError(f"roadside must have 0 <= least < greatest, got {roadside}")
    distance = np.abs(floats(across))
    at_roadside = (distance >= least) & (distance <= greatest)
    return above(vh, thresholds.low_vh, region) & at_roadside


def roadside_level(
    image: ArrayLike, region: IntArray, roadside: BoolArray, regions: int
) -> FloatArray:
    """Compute the mean magnitude of an image at the roadside, by sub-region.

    Of the VH image of the frame under test it is the threshold of the extended mask as the paper
    has it: "the average value of the roadside clutter in a frame in test lane" (Fuse et al. 2018,
    Sec. 2.4). No target's position enters.

    Parameters
    ----------
    image : (y, x) array_like
        Image, complex or magnitude.
    region : (y, x) ndarray of int
        From :func:`subregions`.
    roadside : (y, x) ndarray of bool
        Pixels beside the lane.
    regions : int
        Number of sub-regions.

    Returns
    -------
    (region,) ndarray
        Level in units of the image, NaN where no pixel is at the roadside.
    """
    magnitude = np.abs(np.asarray(image))
    level = np.full(regions, np.nan)
    for number in range(regions):
        pixels = roadside & (region == number)
        if pixels.any():
            level[number] = magnitude[pixels].mean()
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
    """Return the union of the fundamental and the extended mask (Fuse et al. 2018, Fig. 6).

    See :func:`fundamental_mask` and :func:`extended_mask` for the parameters.
    """
    fundamental = fundamental_mask(vv, vh, thresholds, region, second, by)
    return fundamental | extended_mask(vh, thresholds, region, across, roadside)


class ThresholdCalibration:
    """Estimate thresholds on a calibration lane (Fuse et al. 2018, Sec. 2.4).

    They are to be "as low as possible without compromising the target signal response". A target's
    response is what lies in its halo within ``response_db`` of its peak in VV. Per sub-region, the
    thresholds of VH and of the second band are the largest that any target's response reaches
    there, so that no mask holds it. That of VV is the smallest peak of any target: what is weaker
    cannot be mistaken for one. The low threshold of VH is the mean magnitude at the roadside, mean
    over frames, of the calibration lane; the paper takes it from a frame of the lane under test,
    see :func:`roadside_level`.

    Parameters
    ----------
    regions : int
        Number of sub-regions.
    response_db : float
        How far below its peak a target's response reaches, dB.

    Raises
    ------
    ValueError
        If one of them is not positive.
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
        """Add one frame.

        Parameters
        ----------
        vv, vh : (y, x) array_like
            Images of the frame.
        region : (y, x) ndarray of int
            From :func:`subregions`.
        halos : iterable of (y, x) ndarray of bool
            Pixels about each target in view.
        roadside : (y, x) ndarray of bool
            Pixels beside the lane.
        second : (y, x) array_like, optional
            Image of the second band.
        """
        vv_level = np.abs(np.asarray(vv))
        vh_level = np.abs(np.asarray(vh))
        second_level = None if second is None else np.abs(np.asarray(second))
        self._has_second |= second_level is not None
        for halo in halos:
            inside = halo & (region >= 0)
            if not inside.any():
                continue
            brightest = int(np.where(inside, vv_level, -1.0).argmax())
            pixel = np.unravel_index(brightest, vv_level.shape)
            number = int(region[pixel])
            peak = float(vv_level[pixel])
            response = inside & (vv_level >= peak * 10 ** (-self.response_db / 20))
            self.targets[number] += 1
            self._vv[number] = min(self._vv[number], peak)
            self._vh[number] = max(self._vh[number], float(vh_level[response].max()))
            if second_level is not None:
                largest = float(second_level[response].max())
                self._second[number] = max(self._second[number], largest)
        self._roadside.append(roadside_level(vh_level, region, roadside, self.regions))

    def state(self) -> Arrays:
        """Return the statistics of all frames so far, as arrays for :meth:`merge`."""
        levels = np.asarray(self._roadside).reshape(-1, self.regions)
        return {
            "targets": self.targets,
            "vv": self._vv,
            "vh": self._vh,
            "second": self._second,
            "roadside": levels,
            "has_second": np.array(self._has_second),
        }

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the statistics (:meth:`state`) of other frames or lanes."""
        self.targets = self.targets + state["targets"]
        self._vv = np.minimum(self._vv, state["vv"])
        self._vh = np.maximum(self._vh, state["vh"])
        self._second = np.maximum(self._second, state["second"])
        self._has_second |= bool(state["has_second"])
        self._roadside += list(state["roadside"])

    def result(self) -> Thresholds:
        """Return the thresholds; every sub-region must have shown a target and roadside."""
        if (self.targets == 0).any():
            raise ValueError(
                f"every sub-region must have shown a target, got {self.targets.tolist()} looks"
            )
        levels = np.asarray(self._roadside)
        if np.isnan(levels).all(axis=0).any():
            raise ValueError("every sub-region must have shown roadside, got one without")
        second = self._second.copy() if self._has_second else None
        return Thresholds(self._vv.copy(), self._vh.copy(), np.nanmean(levels, axis=0), second)
