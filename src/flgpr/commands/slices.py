"""Depth slices of a run: focused images of level planes below the ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flgpr.commands.drawings import files_to_write, image_arrays, write_drawing
from flgpr.imaging.focus import focus
from flgpr.imaging.view_axes import View
from flgpr.progress import Track, silent
from flgpr.store import open_run
from flgpr.types import FloatArray, floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PathLike = str | Path
ENDINGS = (".png", ".npz")
_MOST_SLICES = 24  # of one picture
_PIXELS = 60_000  # of a slice, where the view does not fix their spacing
_ALL_GROUND = View()
_MARGIN = 0.25  # m of ground around the paths of the antennas


@dataclass(frozen=True)
class Slices:
    """Depth slices of a run."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x); z is minus the depth below z = 0, m
    spacing: float  #: of pixels, m
    scans: int  #: number of scans that were summed
    notes: tuple[str, ...] = ()  #: what was left out, and what may be wrong, in words

    def lines(self) -> Iterator[str]:
        """Yield scans, slices and pixels."""
        sizes = self.image.sizes
        pixels = f"{sizes['x']} x {sizes['y']} pixels of {self.spacing:g} m"
        yield f"{self.scans} scans, {sizes['z']} slices of {pixels}"
        for note in self.notes:
            yield f"note: {note}"

    def summary(self) -> dict[str, Any]:
        """Return the figures of the slices."""
        return {
            "scans": self.scans,
            "depths_m": (-self.image["z"].values).tolist(),
            "spacing_m": self.spacing,
            "shape": dict(self.image.sizes),
            "notes": list(self.notes),
        }


def make_slices(
    run: PathLike,
    depths: Sequence[float],
    view: View = _ALL_GROUND,
    output: Sequence[PathLike] = (),
    track: Track = silent,
) -> Slices:
    """Focus level planes below a stored run, and write them as PNG or NumPy (.npz).

    Parameters
    ----------
    run : path
        Run store.
    depths : sequence of float
        Depths of the planes below z = 0, increasing, m.
    view : View
        As for :func:`flgpr.commands.picture.make_picture`, without z; x and y are by default all
        that the antennas passed over.
    output : sequence of path
        Files to write.
    track : Track
        Shows progress.

    Returns
    -------
    Slices
        The slices.

    Raises
    ------
    ValueError
        If depths do not increase or are more than 24, the view has a z, or an output has another
        ending.
    FileExistsError
        If another file is at an output.
    """
    files = files_to_write(output, ENDINGS, " of depth slices")
    depth_axis = _checked_depths(depths)
    if view.z is not None:
        raise ValueError("depth and z both say how deep: give one")

    dataset = open_run(run)
    poses = dataset["pose"].values
    x = _limits(poses[:, 0]) if view.x is None else view.x
    y = _limits(poses[:, 1]) if view.y is None else view.y
    planes = []
    for depth in track(depth_axis.tolist(), "depth slices", depth_axis.size):
        plane = replace(view, x=x, y=y, z=-depth)
        planes.append(focus(dataset, plane, title=Path(run).name, pixels=_PIXELS))

    images = [plane.image for plane in planes]
    image = xr.concat(images, dim="z", combine_attrs="override", join="exact")

    def figure() -> Figure:
        from flgpr.report.images import slices_figure

        return slices_figure(image, poses)

    for path in files:
        write_drawing(path, figure, lambda: image_arrays(image))
    notes = dict.fromkeys(note for plane in planes for note in plane.notes)
    return Slices(image, planes[0].spacing, planes[0].scans, tuple(notes))


def _checked_depths(depths: Sequence[float]) -> FloatArray:
    """Return depths, m; they must be finite, not negative, and increase."""
    axis = floats(depths)
    is_increasing = axis.size > 0 and bool((np.diff(axis) > 0).all())
    if not is_increasing or axis.size > _MOST_SLICES or not np.isfinite(axis).all() or axis[0] < 0:
        raise ValueError(
            f"depth must be up to {_MOST_SLICES} depths from 0 on that increase, m, "
            f"got {list(map(float, axis))}"
        )
    return axis


def _limits(positions: FloatArray) -> tuple[float, float]:
    """Return the limits of the ground along an axis that antennas passed over, m."""
    return float(positions.min()) - _MARGIN, float(positions.max()) + _MARGIN
