"""A focused image of a run, by a scan or over the aperture of many: ground, section or volume."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.imaging.aperture import aperture_blocks, aperture_image
from flgpr.imaging.view_axes import View, chosen_scans, view_axes
from flgpr.model import LINE_STARTS, way_weights
from flgpr.model.aperture import way_shares

CHOSEN_PIXELS = 300_000
"""Pixels of an image, about, where no spacing is given."""


@dataclass(frozen=True)
class FocusedImage:
    """A focused image and what was chosen on the way."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    spacing: float  #: of pixels, m
    scans: int  #: number of scans that were summed


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

    weights = np.zeros(run.sizes["scan"])
    weights[chosen] = scan_weights(run, chosen)
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

    image = xr.DataArray(
        values,
        dims=("polarization", "z", "y", "x"),
        coords={"polarization": run["polarization"].values.astype(str), **axes},
        attrs=_attributes(run, view, chosen.size, title),
        name="image",
    )
    return FocusedImage(image, spacing, chosen.size)


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
    known = [str(label) for label in run["polarization"].values]
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


def scan_weights(run: xr.Dataset, scans: NDArray[np.intp]) -> NDArray[np.float64]:
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
    starts = run.attrs.get(LINE_STARTS)
    if not starts:
        return way_weights(position)
    line = np.searchsorted(np.asarray(starts), scans, side="right")
    weights = np.zeros(scans.size)
    for number in np.unique(line):
        on_line = line == number
        # Lines of longer steps count more.
        weights[on_line] = way_shares(position[on_line])
    if not weights.sum() > 0:
        return np.ones(scans.size)
    return np.asarray(weights / weights.mean())
