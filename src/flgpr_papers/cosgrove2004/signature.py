"""Measures of the premises of Cosgrove et al. 2004 on images, before any detector runs.

They are the double hump (Sec. III-B), the correlation of polarizations (III-C), mines that are
readily visible (Fig. 2), no cross-range structure (III-B), and clutter that may be modelled as
complex Gaussian once it is whitened (II-A).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.signal import find_peaks

from flgpr.clutter import ClutterWhitener
from flgpr.kernels.widths import half_power
from flgpr.model import Lane
from flgpr.scoring import box_peaks, offset_boxes
from flgpr.stages.forms import samples_at
from flgpr.types import AnyArray, ArrayLike, ComplexArray, Entries, FloatArray, floats
from flgpr_papers.cosgrove2004.images import WIDE_MINES, Look
from flgpr_papers.cosgrove2004.recipe import StudyRecipe

_ACROSS = 1.0  # m, half length of the cut across a mine


def hump_count(magnitude: ArrayLike, prominence: float) -> int:
    """Return the number of local maxima of a cut that stand out.

    Parameters
    ----------
    magnitude : (n,) array_like
        The cut.
    prominence : float
        Share of the cut's largest value by which a maximum has to stand out.
    """
    level = floats(magnitude)
    peaks, _ = find_peaks(level, prominence=prominence * level.max())
    return len(peaks)


def polarization_correlation(cut: ArrayLike) -> float:
    """Return the correlation of HH and VV along a cut, from 0 to 1.

    It is ``|Σ h v*| / sqrt(Σ|h|² Σ|v|²)``.

    Parameters
    ----------
    cut : (2 n,) array_like
        HH, then VV.
    """
    hh, vv = np.split(np.asarray(cut), 2)
    energy = np.sum(np.abs(hh) ** 2) * np.sum(np.abs(vv) ** 2)
    return float(np.abs(np.sum(hh * vv.conj())) / np.sqrt(energy))


def fourth_moment_ratio(white: ArrayLike) -> float:
    """Return the mean over features of ``E|z|⁴ / (E|z|²)²``, which is 2 for Gaussian samples.

    Parameters
    ----------
    white : (n, features) array_like
        Whitened samples.
    """
    power = np.abs(np.asarray(white)) ** 2
    return float(np.mean(np.mean(power**2, axis=0) / np.mean(power, axis=0) ** 2))


def look_measures(recipe: StudyRecipe, looks: Sequence[Look], whitener: ClutterWhitener) -> Entries:
    """Measure the images of mines and of the clutter around them.

    Parameters
    ----------
    looks : sequence of Look
        Images that the whitener has not seen.
    whitener : ClutterWhitener
        Learnt from the clutter of the training images.

    Returns
    -------
    dict
        ``mine`` and ``clutter`` with the lists ``HH``, ``VV`` (humps of each cut) and
        ``correlation``; ``across`` with the lists ``humps`` and ``width`` (m, NaN where the half
        power is not reached) of mines; and ``fourth_moment_ratio`` of the whitened clutter.
    """
    samples = [samples_at(look.image, look.position[None], recipe.cuts) for look in looks]
    across = [_across(recipe, look) for look in looks]
    clutter = np.concatenate([of_look.clutter for of_look in samples])
    return {
        "mine": _cut_measures(recipe, np.concatenate([of_look.target for of_look in samples])),
        "clutter": _cut_measures(recipe, clutter[:: recipe.premises.clutter_thinning]),
        "across": {
            "humps": [humps for humps, _ in across],
            "width": [width for _, width in across],
        },
        "fourth_moment_ratio": fourth_moment_ratio(whitener.transform(clutter)),
    }


def signature_humps(recipe: StudyRecipe, cuts: ComplexArray) -> dict[str, list[int]]:
    """Return the number of humps of clutter-free signatures of mines, by polarization.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cuts : (n, features) ndarray
        Range cuts through mines without a lane around them.
    """
    measures = _cut_measures(recipe, cuts)
    return {name: measures[name] for name in recipe.cut.polarizations}


def visible_mines(recipe: StudyRecipe, image: xr.DataArray) -> list[bool]:
    """Return whether each mine of the wide image is readily visible in HH (Fig. 2).

    It is if the peak of its box exceeds the peaks of a share ``premises.visible`` of the clutter
    boxes at its range.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    image : (polarization, y, x) DataArray
        As `flgpr_papers.cosgrove2004.images.wide_image` returns it.
    """
    return [
        bool(at_mine > np.quantile(at_clutter, recipe.premises.visible))
        for at_mine, at_clutter in wide_boxes(recipe, image)
    ]


def wide_boxes(recipe: StudyRecipe, image: xr.DataArray) -> list[tuple[float, FloatArray]]:
    """Return the peak power in HH of every mine's box, and of the clutter's boxes at its range."""
    power = (np.abs(image.sel(polarization="HH").values) ** 2).astype(np.float32)
    x = image["x"].values
    y = image["y"].values
    box = recipe.score.box
    half_step = recipe.radar.stop_spacing / 2
    peaks = []
    for position in floats(WIDE_MINES):
        area = Lane(float(x[0]), float(x[-1]), position[1] - half_step, position[1] + half_step)
        boxes = offset_boxes(position[None], area, box, recipe.score.clearance)
        at_mine, at_clutter = [box_peaks(power, x, y, of, box)[0] for of in (position, boxes)]
        peaks.append((float(at_mine[0]), at_clutter))
    return peaks


def _cut_measures(recipe: StudyRecipe, cuts: AnyArray) -> dict[str, list[Any]]:
    """Return the measures of cuts by polarization."""
    length = recipe.cut.length
    measures: dict[str, list[Any]] = {}
    for number, name in enumerate(recipe.cut.polarizations):
        channel = np.abs(cuts[:, number * length : (number + 1) * length])
        measures[name] = [hump_count(magnitude, recipe.premises.hump) for magnitude in channel]
    measures["correlation"] = [polarization_correlation(cut) for cut in cuts]
    return measures


def _across(recipe: StudyRecipe, look: Look) -> tuple[int, float]:
    """Return the humps across range at the brightest pixel near a mine in HH, and their width.

    The width is that between the half-power points, m.
    """
    magnitude = np.abs(look.image.sel(polarization="HH").values)
    x = look.image["x"].values
    y = look.image["y"].values
    search = recipe.training.search
    is_near_x = np.abs(x - look.position[0]) <= search
    is_near_y = np.abs(y - look.position[1]) <= search
    is_near = is_near_x[None, :] & is_near_y[:, None]
    row, column = np.unravel_index(int(np.argmax(np.where(is_near, magnitude, 0))), magnitude.shape)
    reach = min(round(_ACROSS / (x[1] - x[0])), int(column), x.size - 1 - int(column))
    columns = slice(int(column) - reach, int(column) + reach + 1)
    level = magnitude[row, columns] / magnitude[row, column]
    humps = hump_count(level, recipe.premises.hump)
    return humps, half_power(x[columns] - x[column], level)
