"""A focused image of a run: by one scan or over the aperture of many, of ground, section or volume."""

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

CHOSEN_PIXELS = 300_000
"""Pixels of an image, about, where no spacing is given."""


@dataclass(frozen=True)
class FocusedImage:
    """A focused image and what was chosen on the way."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    spacing: float  #: of pixels, m
    scans: int  #: number of scans that were summed


def _unshown(items: Any, label: str, total: int) -> Iterable[Any]:  # noqa: ARG001
    """Pass items through."""
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

    Raises
    ------
    ValueError
        If the view does not fit the run, or has too many pixels.
    """
    chosen = chosen_scans(run, view.scans)
    if view.polarizations:
        known = [str(label) for label in run["polarization"].values]
        unknown = [label for label in view.polarizations if label not in known]
        if unknown:
            raise ValueError(
                f"polarization must be one of the run's, {', '.join(known)}, got {', '.join(unknown)}"
            )
        run = run.sel(polarization=list(view.polarizations))
    pose = run["pose"].values[chosen]
    if view.permittivity is None:
        if run.attrs.get("sounding") == "ground-coupled":
            raise ValueError(
                "permittivity must be told for antennas that are coupled to the ground; `flgpr calibrate permittivity` "
                "finds it by focus"
            )
        view = replace(view, permittivity=1.0)
    axes, spacing = view_axes(run, view, pose, pixels)
    grid = np.stack(np.meshgrid(axes["z"], axes["y"], axes["x"], indexing="ij")[::-1], axis=-1)
    weights = np.zeros(run.sizes["scan"])
    weights[chosen] = scan_weights(run, chosen)
    blocks = aperture_blocks(run, chosen)
    options: dict[str, Any] = {
        "window": view.window,
        "permittivity": view.permittivity,
        "half_space": view.half_space,
    }
    if view.band is not None:
        options["subbands"] = [view.band]
    values = aperture_image(
        run, grid, track(blocks, "scans focused", len(blocks)), weights, view.reach, **options
    )
    title = f"{run.attrs.get('title') or title}, {chosen.size} scan{'s' * (chosen.size > 1)}"
    about = {
        "title": title,
        "permittivity": view.permittivity,
        "half_space": view.half_space or 0.0,
    }
    image = xr.DataArray(
        values,
        dims=("polarization", "z", "y", "x"),
        coords={"polarization": run["polarization"].values.astype(str), **axes},
        attrs=about
        | {"window": view.window, "band_hz": list(view.band or run["frequency"].values[[0, -1]])},
        name="image",
    )
    return FocusedImage(image, spacing, chosen.size)


def scan_weights(run: xr.Dataset, scans: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the share of the way that each scan stands for; in a survey, of the way along its own line."""
    place = run["pose"].values[scans, :3]
    starts = run.attrs.get(LINE_STARTS)
    if not starts:
        return way_weights(place)
    line = np.searchsorted(np.asarray(starts), scans, side="right")
    weights = np.zeros(scans.size)
    for one in np.unique(line):
        own = line == one
        steps = np.hypot(*np.diff(place[own, :2], axis=0).T)
        weights[own] = way_weights(place[own]) * (steps.mean() if steps.size else 0.0)
    return np.asarray(weights / weights.mean()) if weights.sum() > 0 else np.ones(scans.size)
