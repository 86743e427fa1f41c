"""A focused image of a run, by a scan or over the aperture of many: ground, section or volume."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from flgpr.imaging.aperture import aperture_blocks, aperture_image, record_of
from flgpr.imaging.view_axes import View, chosen_scans, view_axes
from flgpr.model import LINE_STARTS, SPEED_OF_LIGHT, vehicle_to_lane
from flgpr.model.aperture import way_shares
from flgpr.model.constants import IMAGE_ATTRS
from flgpr.model.run import described, polarizations_of
from flgpr.types import BoolArray, FloatArray, IndexArray

_LEAST_DISTANCE = 1e-6  # m, of a pixel from a scan, level with the ground
_ON_TOP = 1e-6  # m, of rounding
_LEVEL = 0.01  # m, within which antennas are on level ground, whose surface is at 0 or their height
CHOSEN_PIXELS = 300_000
"""Pixels of an image, about, where no spacing is given."""


@dataclass(frozen=True)
class FocusedImage:
    """A focused image and what was chosen on the way."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    spacing: float  #: of pixels, m
    scans: int  #: number of scans that were summed
    notes: tuple[str, ...] = ()  #: what was left out, and what may be wrong, in words


def _unshown(items: Any, label: str, total: int) -> Iterable[Any]:  # noqa: ARG001
    """Return items as they are, without showing progress."""
    return items


def focus(
    run: xr.Dataset,
    view: View,
    track: Callable[[Any, str, int], Iterable[Any]] = _unshown,
    title: str = "",
    pixels: int = CHOSEN_PIXELS,
) -> FocusedImage:
    """Return the image of a run: the coherent sum over scans, each from its own pose.

    Each scan is weighed by the length of the way that it stands for.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    view : View
        What to image; where no spacing is given there are about ``pixels`` pixels.
    track : callable
        Passes the blocks of scans through and shows progress.
    title : str
        Title of the image, for a run that has none.
    pixels : int
        About how many pixels there are where no spacing is given.

    Returns
    -------
    FocusedImage
        The image.

    Raises
    ------
    ValueError
        If the view does not fit the run, or has too many pixels.
    """
    chosen = chosen_scans(run, view.scans)
    run = _with_polarizations(run, view.polarizations)
    view = _with_permittivity(run, view)
    pose = run["pose"].values[chosen]
    axes, spacing = view_axes(run, view, pose, pixels)
    grid = np.stack(np.meshgrid(axes["z"], axes["y"], axes["x"], indexing="ij")[::-1], axis=-1)

    weights = scan_weights(run, chosen)
    options: dict[str, Any] = {
        "window": view.window,
        "permittivity": view.permittivity,
        "half_space": view.half_space,
    }
    if view.band is not None:
        options["subbands"] = [view.band]
    blocks = aperture_blocks(run, chosen)
    shown_blocks = track(blocks, "scans focused", len(blocks))
    values = aperture_image(run, grid, shown_blocks, weights, view.reach, **options)

    notes = _fold_notes(run, view, chosen, grid)
    if run.attrs.get("sounding") == "ground-coupled":
        in_air = _is_above_antennas(run, pose, grid, spacing / 2)
        values[:, in_air] = 0
        if in_air.any():
            notes.append(
                f"{np.count_nonzero(in_air)} of {in_air.size} pixels lie above the antennas, which "
                "are on the ground: they are not imaged"
            )
    image = xr.DataArray(
        values,
        dims=("polarization", "z", "y", "x"),
        coords={"polarization": run["polarization"].values.astype(str), **axes},
        attrs=_attributes(run, view, chosen.size, title),
        name="image",
    )
    return FocusedImage(described(image, IMAGE_ATTRS), spacing, chosen.size, tuple(notes))


def _is_above_antennas(
    run: xr.Dataset, pose: FloatArray, grid: FloatArray, margin: float
) -> BoolArray:
    """Return which pixels of a grid (z, y, x, 3), m, are above the antennas that passed there.

    They are so by more than a margin, m.

    The height at a pixel is that of the two nearest scans, by their distances: below a line, the
    one on the line between them.
    """
    from scipy.spatial import cKDTree  # slow to load

    middle = (run["tx_position"].values + run["rx_position"].values) / 2
    antennas = vehicle_to_lane(middle, pose).reshape(-1, 3)
    level = np.unique(grid[..., :2].reshape(-1, 2), axis=0)
    tree = cKDTree(antennas[:, :2])
    distance, nearest = tree.query(level, k=min(2, len(antennas)))
    distance = distance.reshape(len(level), -1)
    nearness = 1 / np.maximum(distance, _LEAST_DISTANCE)
    heights = antennas[nearest.reshape(distance.shape), 2]
    surface = (heights * nearness).sum(axis=1) / nearness.sum(axis=1)
    _, column = np.unique(grid[..., :2].reshape(-1, 2), axis=0, return_inverse=True)
    top = surface[column.ravel()].reshape(grid.shape[:-1])
    if np.ptp(antennas[:, 2]) < _LEVEL:
        top = np.maximum(top, 0.0)
    return grid[..., 2] > top + margin + _ON_TOP


def _fold_notes(run: xr.Dataset, view: View, scans: IndexArray, grid: FloatArray) -> list[str]:
    """Return a note if tones repeat within the image, and no record says what is beyond them."""
    record = record_of(run)
    if record is None or np.isfinite(record.end) or scans.size < 2:
        return []
    reach = SPEED_OF_LIGHT * record.period / (2 * math.sqrt(view.permittivity or 1.0))
    low = grid.reshape(-1, 3).min(axis=0)
    high = grid.reshape(-1, 3).max(axis=0)
    place = run["pose"].values[scans, :3]
    farthest = np.linalg.norm(np.maximum(np.abs(place - low), np.abs(high - place)), axis=1).max()
    if min(float(farthest), view.reach) <= reach:
        return []
    return [
        f"tones {1e-6 / record.period:.6g} MHz apart repeat after {reach:.4g} m: from antennas "
        f"farther from a pixel than that, nearer echoes fold into it; --reach {reach:.3g} leaves "
        "them out"
    ]


def _attributes(run: xr.Dataset, view: View, scans: int, title: str) -> dict[str, Any]:
    """Return the attributes of a focused image of so many scans."""
    scan_word = "scan" if scans == 1 else "scans"
    return {
        "title": f"{run.attrs.get('title') or title}, {scans} {scan_word}",
        "permittivity": view.permittivity,
        "half_space": view.half_space or 0.0,
        "window": view.window,
        "band_hz": list(view.band or run["frequency"].values[[0, -1]]),
    }


def _with_polarizations(run: xr.Dataset, selected: tuple[str, ...]) -> xr.Dataset:
    """Return the run with the selected polarizations, or a ValueError; none selected are all."""
    if not selected:
        return run
    known = polarizations_of(run)
    unknown = [label for label in selected if label not in known]
    if unknown:
        raise ValueError(
            f"polarization must be one of the run's, {', '.join(known)}, got {', '.join(unknown)}"
        )
    return run.sel(polarization=list(selected))


def _with_permittivity(run: xr.Dataset, view: View) -> View:
    """Return the view with a permittivity: air's, or a ValueError where there is ground."""
    if view.permittivity is not None:
        return view
    if run.attrs.get("sounding") == "ground-coupled":
        raise ValueError(
            "permittivity must be given for antennas that are coupled to the ground; "
            "`flgpr calibrate permittivity` finds it by focus"
        )
    return replace(view, permittivity=1.0)


def scan_weights(run: xr.Dataset, scans: IndexArray) -> FloatArray:
    """Return the share of the way that each scan stands for, of mean one.

    In a survey it is the share of the way along the scan's own line.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    scans : (scan,) ndarray of int
        Numbers of the scans.

    Returns
    -------
    (scan,) ndarray
        Weights.
    """
    position = run["pose"].values[scans, :3]
    line = np.searchsorted(np.asarray(run.attrs.get(LINE_STARTS) or ()), scans, side="right")
    shares = np.zeros(scans.size)
    for number in np.unique(line):
        on_line = line == number
        # Lines of longer steps count more.
        shares[on_line] = way_shares(position[on_line])
    weights = np.zeros(run.sizes["scan"])
    weights[scans] = shares / shares.mean() if shares.sum() > 0 else 1.0
    return weights
