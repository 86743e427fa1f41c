"""Depth slices of a run: focused images of level planes below the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.imaging.focus import focus
from flgpr.imaging.view_axes import View
from flgpr.progress import Track, silent
from flgpr.store import open_run
from flgpr.store.outputs import atomic_output

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
    files = [Path(name) for name in output]
    for path in files:
        if path.suffix.lower() not in ENDINGS:
            raise ValueError(
                f"output of depth slices must end in {', '.join(ENDINGS)}, got {path.name!r}"
            )
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
    slices = Slices(image, planes[0].spacing, planes[0].scans)
    for path in files:
        _write(slices, poses, path)
    return slices


def _checked_depths(depths: Sequence[float]) -> NDArray[np.float64]:
    """Return depths, m; they must be finite, not negative, and increase."""
    axis = np.asarray(depths, dtype=np.float64)
    is_increasing = axis.size > 0 and bool((np.diff(axis) > 0).all())
    if not is_increasing or axis.size > _MOST_SLICES or not np.isfinite(axis).all() or axis[0] < 0:
        raise ValueError(
            f"depth must be up to {_MOST_SLICES} depths from 0 on that increase, m, "
            f"got {list(map(float, axis))}"
        )
    return axis


def _limits(positions: NDArray[np.float64]) -> tuple[float, float]:
    """Return the limits of the ground along an axis that antennas passed over, m."""
    return float(positions.min()) - _MARGIN, float(positions.max()) + _MARGIN


def _write(slices: Slices, poses: NDArray[np.float64], path: Path) -> None:
    """Write slices as PNG or NumPy archive, by the ending."""
    with atomic_output(path) as partial:
        if path.suffix.lower() == ".png":
            from flgpr.report import figure_png  # loads Matplotlib
            from flgpr.report.slices import slices_figure

            figure = slices_figure(slices.image, poses)
            partial.write_bytes(figure_png(figure))
        else:
            axes = {str(name): axis.values for name, axis in slices.image.coords.items()}
            np.savez(partial, image=slices.image.values, **axes)
