"""Template features: the largest normalised correlation of a region with mine signatures (flsar2004, Sec. 3.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.fft import fft2, ifft2, next_fast_len

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, Lane

FloatArray = NDArray[np.float64]


def cut_regions(
    image: ArrayLike, grid: Grid, centres: ArrayLike, size: tuple[float, float]
) -> NDArray[Any]:
    """Cut regions (n, ..., v, u) about places (n, 2), m, out of images (..., y, x) on a grid, with interpolation.

    Width and length of a region, m, are rounded to an odd number of pixels; beyond the image it is zero.
    """
    values = np.asarray(image)
    places = np.reshape(np.asarray(centres, dtype=np.float64), (-1, 2))
    half_u = round(size[0] / grid.dx) // 2
    half_v = round(size[1] / grid.dy) // 2
    # Rounded, so that a place on the last row lies on it wherever along the lane the image begins.
    rows = np.round((places[:, 1] - grid.y_min) / grid.dy, 9)
    columns = np.round((places[:, 0] - grid.x_min) / grid.dx, 9)
    row = (
        rows[:, None, None]
        + np.arange(-half_v, half_v + 1)[None, :, None]
        + np.zeros((1, 1, 2 * half_u + 1))
    )
    column = (
        columns[:, None, None]
        + np.arange(-half_u, half_u + 1)[None, None, :]
        + np.zeros((1, 2 * half_v + 1, 1))
    )
    return np.moveaxis(np.nan_to_num(bilinear(values, row, column)), -3, 0)


def unit_energy(image: ArrayLike) -> NDArray[Any]:
    """Scale images to an inner product of 1 with themselves (par. 19 and 21); without energy they stay zero."""
    values = np.asarray(image)
    norm = np.sqrt((np.abs(values) ** 2).sum(axis=(-2, -1), keepdims=True))
    return values / np.where(norm > 0, norm, 1)


def mean_template(chips: ArrayLike, normalize_each: bool = False) -> NDArray[Any]:
    """Average mine signatures (n, ..., y, x) into a template of unit energy (par. 19).

    With ``normalize_each`` every image counts with unit energy; the text averages the images themselves.
    """
    values = np.asarray(chips)
    if not len(values):
        raise ValueError("chips must hold at least one mine, got none")
    return unit_energy((unit_energy(values) if normalize_each else values).mean(axis=0))


def principal_templates(chips: ArrayLike, count: int = 1) -> tuple[NDArray[Any], FloatArray]:
    """Find orthonormal templates by principal components of images (n, y, x), each at unit energy (par. 24).

    They are not centred: a template is a signature, not a deviation from one. The templates (count, y, x) are of
    falling energy, each of the sign that makes its sum positive; with them comes the share of the images' energy along
    every component.
    """
    values = unit_energy(chips)
    if values.ndim != 3 or not 1 <= count <= min(len(values), values[0].size if len(values) else 0):
        raise ValueError(
            f"count must lie between 1 and the number of images or pixels, got {count} for the shape {values.shape}"
        )
    _, singular, basis = np.linalg.svd(values.reshape(len(values), -1), full_matrices=False)
    templates = basis[:count].reshape(count, *values.shape[1:])
    total = templates.sum(axis=(-2, -1), keepdims=True)
    sign = np.where(
        np.abs(total) > 0, np.conj(total) / np.where(np.abs(total) > 0, np.abs(total), 1), 1
    )
    return templates * sign, singular**2 / (singular**2).sum()


def align_phases(chips: ArrayLike) -> NDArray[Any]:
    """Turn complex images (n, y, x) to one phase: that in which each is most like their first principal component."""
    values = np.asarray(chips)
    component = principal_templates(values, 1)[0][0]
    likeness = (values * np.conj(component)).sum(axis=(-2, -1), keepdims=True)
    size = np.abs(likeness)
    return values * np.where(size > 0, np.conj(likeness) / np.where(size > 0, size, 1), 1)


def max_correlation(region: ArrayLike, template: ArrayLike, magnitude: bool = True) -> FloatArray:
    """Correlate regions (..., y, x) with a template and take the largest over all shifts in both directions (par. 22).

    Both are scaled to unit energy over their whole extent, so that it lies between 0 and 1. Shifts
    are not circular: what a shifted template covers beyond the region is zero. Of k orthonormal
    templates (k, v, u) the correlations are added in power. ``magnitude`` correlates moduli (the
    paper is silent), else complex values, of which the modulus is taken.

    Examples
    --------
    The template is found wherever it lies in the region.

    >>> import numpy as np
    >>> from flgpr.features import max_correlation, mean_template
    >>> template = mean_template([[[1.0, 2.0, 1.0], [2.0, 5.0, 2.0]]])
    >>> region = np.zeros((1, 8, 8))
    >>> region[0, 4:6, 3:6] = template
    >>> max_correlation(region, template).round(3)
    array([1.])
    """
    regions = np.asarray(region)
    templates = np.asarray(template) if np.ndim(template) == 3 else np.asarray(template)[None]
    if magnitude:
        regions = np.abs(regions)
        templates = np.abs(templates) if np.iscomplexobj(templates) else templates
    regions = unit_energy(regions)
    templates = unit_energy(templates)
    shape = [
        next_fast_len(a + b - 1)
        for a, b in zip(regions.shape[-2:], templates.shape[-2:], strict=True)
    ]
    spectrum = fft2(regions, shape)[..., None, :, :] * np.conj(fft2(templates, shape))
    power = (np.abs(ifft2(spectrum)) ** 2).sum(axis=-3)
    return np.asarray(np.sqrt(power.max(axis=(-2, -1))))


def template_features(
    regions: ArrayLike, templates: ArrayLike, magnitude: bool = True
) -> FloatArray:
    """Form feature vectors (n, polarization·range): one largest correlation per polarization and range (par. 22).

    Regions are (n, polarization, range, y, x), templates (polarization, range, [k,] v, u); ``magnitude`` is as in
    :func:`max_correlation`.
    """
    images = np.asarray(regions)
    patterns = np.asarray(templates)
    if images.ndim != 5 or images.shape[1:3] != patterns.shape[:2]:
        raise ValueError(
            "regions (n, polarization, range, y, x) and templates (polarization, range, v, u) must agree, got "
            f"{images.shape} and {patterns.shape}"
        )
    columns = [
        max_correlation(images[:, p, r], patterns[p, r], magnitude)
        for p, r in np.ndindex(*patterns.shape[:2])
    ]
    return np.stack(columns, axis=1)


def clutter_tiles(
    lane: Lane, size: tuple[float, float], mines: ArrayLike, keep_off: float
) -> pd.DataFrame:
    """Tile a lane without overlap and leave out the tiles with a mine: clutter examples not picked by hand.

    As many whole tiles (width and length, m) as fit, centred across the lane, from its beginning on; mines (n, 2) are
    kept off their borders by ``keep_off``, m. It gives x, y of the tiles' centres, m.
    """
    width = lane.x_max - lane.x_min
    length = lane.y_max - lane.y_min
    across = int(width / size[0] + 0.02)
    along = int(length / size[1] + 0.02)
    if across < 1 or along < 1:
        raise ValueError(f"size must fit into the lane of {width:g} m x {length:g} m, got {size}")
    x = lane.x_min + width / 2 + (np.arange(across) - (across - 1) / 2) * size[0]
    y = lane.y_min + (np.arange(along) + 0.5) * size[1]
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = np.reshape(np.asarray(mines, dtype=np.float64), (-1, 2))
    beyond = np.maximum(np.abs(centres[:, None] - places[None]) - np.asarray(size) / 2, 0)
    clear = (np.hypot(beyond[..., 0], beyond[..., 1]) >= keep_off).all(axis=1)
    return pd.DataFrame(centres[clear], columns=["x", "y"])
