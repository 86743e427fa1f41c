"""Template features: largest normalised correlations with mine signatures (flsar2004, Sec. 3.2)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.fft import fft2, ifft2, next_fast_len

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, Lane
from flgpr.types import AnyArray, ArrayLike, FloatArray, floats


def cut_regions(
    image: ArrayLike, grid: Grid, centres: ArrayLike, size: tuple[float, float]
) -> AnyArray:
    """Cut regions out of images by interpolation.

    Parameters
    ----------
    image : (..., y, x) array_like
        Images.
    grid : Grid
        Their pixels.
    centres : (n, 2) array_like
        x, y of the regions' centres, m.
    size : tuple of float
        Width and length of a region, m, which are rounded to an odd number of pixels.

    Returns
    -------
    (n, ..., v, u) ndarray
        Regions, zero beyond the image.
    """
    values = np.asarray(image)
    positions = np.reshape(floats(centres), (-1, 2))
    half_u = round(size[0] / grid.dx) // 2
    half_v = round(size[1] / grid.dy) // 2
    # Rounded, so that a centre on the last row lies on it wherever along the lane the image begins.
    rows = np.round((positions[:, 1] - grid.y_min) / grid.dy, 9)
    columns = np.round((positions[:, 0] - grid.x_min) / grid.dx, 9)
    row = rows[:, None, None] + np.arange(-half_v, half_v + 1)[None, :, None]
    column = columns[:, None, None] + np.arange(-half_u, half_u + 1)[None, None, :]
    row, column = np.broadcast_arrays(row, column)
    return np.moveaxis(np.nan_to_num(bilinear(values, row, column)), -3, 0)


def unit_energy(image: ArrayLike) -> AnyArray:
    """Scale images (..., y, x) to an energy of 1 (flsar2004, par. 19 and 21).

    Images without energy stay zero.
    """
    values = np.asarray(image)
    norm = np.sqrt((np.abs(values) ** 2).sum(axis=(-2, -1), keepdims=True))
    return values / np.where(norm > 0, norm, 1)


def mean_template(chips: ArrayLike, normalize_each: bool = False) -> AnyArray:
    """Average mine signatures into a template of unit energy (flsar2004, par. 19).

    Parameters
    ----------
    chips : (n, ..., y, x) array_like
        Signatures, at least one.
    normalize_each : bool
        Whether every signature counts with unit energy; the text averages the images themselves.

    Returns
    -------
    (..., y, x) ndarray
        Template.

    Raises
    ------
    ValueError
        If there is no signature.
    """
    values = np.asarray(chips)
    if not len(values):
        raise ValueError("chips must hold at least one mine, got none")
    if normalize_each:
        values = unit_energy(values)
    return unit_energy(values.mean(axis=0))


def principal_templates(chips: ArrayLike, count: int = 1) -> tuple[AnyArray, FloatArray]:
    """Compute orthonormal templates, the principal components of images (flsar2004, par. 24).

    The images are not centred: a template is a signature, not a deviation from one.

    Parameters
    ----------
    chips : (n, y, x) array_like
        Images; each counts with unit energy.
    count : int
        Number of templates.

    Returns
    -------
    templates : (count, y, x) ndarray
        From the largest energy on, each of the sign or phase that makes its sum positive.
    share : (component,) ndarray
        Share of the images' energy along every component.

    Raises
    ------
    ValueError
        If there are not as many images or pixels.
    """
    values = unit_energy(chips)
    pixels = values[0].size if len(values) else 0
    if values.ndim != 3 or not 1 <= count <= min(len(values), pixels):
        raise ValueError(
            "count must lie between 1 and the number of images or pixels, "
            f"got {count} for the shape {values.shape}"
        )
    _, singular, basis = np.linalg.svd(values.reshape(len(values), -1), full_matrices=False)
    templates = basis[:count].reshape(count, *values.shape[1:])
    total = templates.sum(axis=(-2, -1), keepdims=True)
    share = singular**2 / (singular**2).sum()
    return templates * _opposite_phase(total), share


def align_phases(chips: ArrayLike) -> AnyArray:
    """Rotate complex images (n, y, x) to the phase of their first principal component."""
    values = np.asarray(chips)
    component = principal_templates(values, 1)[0][0]
    likeness = (values * np.conj(component)).sum(axis=(-2, -1), keepdims=True)
    return values * _opposite_phase(likeness)


def _opposite_phase(values: AnyArray) -> AnyArray:
    """Return the unit factors that make values real and positive; 1 for zero."""
    size = np.abs(values)
    return np.where(size > 0, np.conj(values) / np.where(size > 0, size, 1), 1)


def max_correlation(region: ArrayLike, template: ArrayLike, magnitude: bool = True) -> FloatArray:
    """Compute the largest correlation of regions with a template (flsar2004, par. 22).

    Both are scaled to unit energy over their full extent. Shifts in both directions are not
    circular: what a shifted template covers beyond the region is zero.

    Parameters
    ----------
    region : (..., y, x) array_like
        Regions.
    template : ([k,] v, u) array_like
        Template, or k orthonormal ones, whose correlations are added in power.
    magnitude : bool
        Whether moduli are correlated, on which the paper is silent, or complex values, with the
        modulus of the result.

    Returns
    -------
    (...,) ndarray
        Correlation, between 0 and 1.

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
    templates = np.asarray(template)
    if templates.ndim != 3:
        templates = templates[None]
    if magnitude:
        regions = np.abs(regions)
        if np.iscomplexobj(templates):
            templates = np.abs(templates)
    regions = unit_energy(regions)
    templates = unit_energy(templates)
    shape = [
        next_fast_len(regions.shape[-2] + templates.shape[-2] - 1),
        next_fast_len(regions.shape[-1] + templates.shape[-1] - 1),
    ]
    spectrum = fft2(regions, shape)[..., None, :, :] * np.conj(fft2(templates, shape))
    power = (np.abs(ifft2(spectrum)) ** 2).sum(axis=-3)
    return np.asarray(np.sqrt(power.max(axis=(-2, -1))))


def template_features(
    regions: ArrayLike, templates: ArrayLike, magnitude: bool = True
) -> FloatArray:
    """Return the largest correlation per polarization and range as features (flsar2004, par. 22).

    Parameters
    ----------
    regions : (n, polarization, range, y, x) array_like
        Regions.
    templates : (polarization, range, [k,] v, u) array_like
        Templates.
    magnitude : bool
        As for :func:`max_correlation`.

    Returns
    -------
    (n, polarization·range) ndarray
        Features.

    Raises
    ------
    ValueError
        If polarizations or ranges differ.
    """
    images = np.asarray(regions)
    patterns = np.asarray(templates)
    if images.ndim != 5 or images.shape[1:3] != patterns.shape[:2]:
        raise ValueError(
            "regions (n, polarization, range, y, x) and templates (polarization, range, v, u) "
            f"must agree, got {images.shape} and {patterns.shape}"
        )
    columns = []
    for p, r in np.ndindex(*patterns.shape[:2]):
        columns.append(max_correlation(images[:, p, r], patterns[p, r], magnitude))
    return np.stack(columns, axis=1)


def clutter_tiles(
    lane: Lane, size: tuple[float, float], mines: ArrayLike, keep_off: float
) -> pd.DataFrame:
    """Return the centres of tiles of a lane without a mine: clutter examples not picked by hand.

    The tiles do not overlap; as many as fit are centred across the lane, from its beginning on.

    Parameters
    ----------
    lane : Lane
        The lane.
    size : tuple of float
        Width and length of a tile, m.
    mines : (n, 2) array_like
        x, y of mines, m.
    keep_off : float
        Least distance of a mine from a tile's border, m.

    Returns
    -------
    DataFrame
        x, y of the tiles' centres, m.

    Raises
    ------
    ValueError
        If no tile fits into the lane.
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
    positions = np.reshape(floats(mines), (-1, 2))
    beyond = np.maximum(np.abs(centres[:, None] - positions[None]) - np.asarray(size) / 2, 0)
    clear = (np.hypot(beyond[..., 0], beyond[..., 1]) >= keep_off).all(axis=1)
    return pd.DataFrame(centres[clear], columns=["x", "y"])
