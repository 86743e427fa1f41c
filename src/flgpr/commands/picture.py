"""Focused images of a run, a picture with its brightest points or depth slices, and their files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.calibrate.peaks import image_peaks
from flgpr.commands.positions import read_optional_anchor
from flgpr.geo.geotiff import write_geotiff
from flgpr.imaging.focus import CHOSEN_PIXELS, FocusedImage, focus
from flgpr.imaging.view_axes import View, chosen_scans
from flgpr.progress import Track, silent
from flgpr.store import open_run
from flgpr.store.extras import optional
from flgpr.store.outputs import atomic_output, write_new
from flgpr.types import Entries, FloatArray, PathLike, floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GROUND = View()
_IMAGE_QUANTITY = "magnitude of the focused image, in the arbitrary unit of the run's signal"
_PICTURES = (".png", ".npz", ".zarr", ".tif")
_DRAWINGS = (".png", ".npz")
_MOST_SLICES = 24  # of one picture
_SLICE_PIXELS = 60_000  # where the view does not fix their spacing
_MARGIN = 0.25  # m of ground around the paths of the antennas


@dataclass(frozen=True, kw_only=True)
class Picture(FocusedImage):
    """A focused image and its brightest points."""

    #: of the first polarization, brightest first: x, y, z (m), level (dB re the first),
    #: over_median (dB), and the width at -3 dB along every axis that is imaged, m; NaN where the
    #: level does not fall so far
    peaks: pd.DataFrame

    def lines(self) -> Iterator[str]:
        """Yield scans and pixels, then a line for each of the brightest points."""
        sizes = [self.image.sizes[axis] for axis in "xyz"]
        pixels = " x ".join(str(size) for size in sizes if size > 1)
        yield f"{self.scans} scans, {pixels} pixels of {self.spacing:g} m; brightest points:"
        for number, row in enumerate(self.peaks.to_dict("records"), 1):
            widths = [
                f"{str(name)[-1]} {value:.3f}"
                for name, value in row.items()
                if str(name).startswith("width") and value > 0
            ]
            width = f", -3 dB width {', '.join(widths)} m" if widths else ""
            yield (
                f"{number:3}  ({row['x']:.3f}, {row['y']:.3f}, {row['z']:.3f}) m  "
                f"{row['level']:6.1f} dB, {row['over_median']:.1f} dB over the median{width}"
            )
        yield from noted(self.notes)

    def as_json(self) -> Entries:
        """Return the figures of the picture."""
        return {
            "spacing_m": self.spacing,
            "scans": self.scans,
            "shape": dict(self.image.sizes),
            "notes": list(self.notes),
            "peaks": json.loads(self.peaks.to_json(orient="records")),
        }


class Slices(FocusedImage):
    """Depth slices of a run; the image's z is minus the depth below z = 0, m."""

    def lines(self) -> Iterator[str]:
        """Yield scans, slices and pixels."""
        sizes = self.image.sizes
        pixels = f"{sizes['x']} x {sizes['y']} pixels of {self.spacing:g} m"
        yield f"{self.scans} scans, {sizes['z']} slices of {pixels}"
        yield from noted(self.notes)

    def as_json(self) -> Entries:
        """Return the figures of the slices."""
        return {
            "scans": self.scans,
            "depths_m": (-self.image["z"].values).tolist(),
            "spacing_m": self.spacing,
            "shape": dict(self.image.sizes),
            "notes": list(self.notes),
        }


def noted(notes: Sequence[str]) -> list[str]:
    """Return notes as lines of text."""
    return [f"note: {note}" for note in notes]


def make_picture(
    run: PathLike,
    view: View = _GROUND,
    output: Sequence[PathLike] = (),
    anchor: PathLike | None = None,
    points: int = 5,
    track: Track = silent,
) -> Picture:
    """Focus a stored run and write the picture to files.

    The sum is coherent over the scans, each from its own pose and weighted by the distance that it
    stands for.

    Parameters
    ----------
    run : path
        Run store.
    view : View
        What is imaged.
    output : sequence of path
        Files to write: PNG, NumPy (.npz), Zarr (.zarr), or GeoTIFF (.tif), which needs an anchor.
    anchor : path, optional
        TOML that ties the lane to the Earth.
    points : int
        Number of brightest points.
    track : Track
        Shows progress.

    Returns
    -------
    Picture
        The picture.

    Raises
    ------
    ValueError
        If the view does not fit the run, a picture has too many pixels, or an output has another
        ending.
    FileExistsError
        If another file is at an output; a file that holds this very picture stays.
    """
    files = files_to_write(output, _PICTURES)
    lane_anchor = read_optional_anchor(anchor)
    if lane_anchor is None and any(path.suffix.lower() == ".tif" for path in files):
        raise ValueError("a GeoTIFF needs an anchor, got none")

    dataset = open_run(run)
    picture = picture_of(dataset, view, points, track, title=Path(run).name)
    poses = dataset["pose"].values[chosen_scans(dataset, view.scans)]

    def figure() -> Figure:
        from flgpr.report.images import image_figure

        return image_figure(picture.image, picture.peaks, poses)

    for path in files:
        if path.suffix.lower() == ".tif":
            _write_tiff(picture.image, path, lane_anchor)
        elif path.suffix.lower() == ".zarr":
            with atomic_output(path) as partial:
                dataset_of_image = picture.image.to_dataset("polarization")
                dataset_of_image.to_zarr(partial, zarr_format=2, consolidated=True)
        else:
            write_drawing(path, figure, lambda: _arrays(picture.image))
    return picture


def picture_of(
    run: xr.Dataset,
    view: View,
    points: int = 5,
    track: Track = silent,
    title: str = "",
    pixels: int = CHOSEN_PIXELS,
) -> Picture:
    """Focus a run in memory and find its brightest points.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    view : View
        What is imaged.
    points : int
        Number of brightest points.
    track : Track
        Shows progress.
    title : str
        Title of the picture.
    pixels : int
        About how many pixels there are, where the view does not fix their spacing.

    Returns
    -------
    Picture
        The picture.

    Raises
    ------
    ValueError
        If the view does not fit the run.
    """
    focused = focus(run, view, track, title, pixels)
    return Picture(**vars(focused), peaks=image_peaks(focused.image, points))


def _write_tiff(image: xr.DataArray, path: Path, anchor: Any) -> None:
    """Write the level ground of a picture as GeoTIFF."""
    if image.sizes["z"] > 1 or min(image.sizes["x"], image.sizes["y"]) < 2:
        raise ValueError("a GeoTIFF must be of level ground, with limits of x and y and one z")
    optional("rasterio", "gis")
    level = image.isel(z=0).copy(data=np.abs(image.values[:, 0]))
    as_run_view = level.expand_dims(subband=["all"], axis=1)
    with atomic_output(path) as partial:
        title = str(image.attrs["title"])
        write_geotiff(as_run_view, partial, anchor, title, quantity=_IMAGE_QUANTITY)


def make_slices(
    run: PathLike,
    depths: Sequence[float],
    view: View = _GROUND,
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
    files = files_to_write(output, _DRAWINGS, " of depth slices")
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
        planes.append(focus(dataset, plane, title=Path(run).name, pixels=_SLICE_PIXELS))

    images = [plane.image for plane in planes]
    image = xr.concat(images, dim="z", combine_attrs="override", join="exact")

    def figure() -> Figure:
        from flgpr.report.images import slices_figure

        return slices_figure(image, poses)

    for path in files:
        write_drawing(path, figure, lambda: _arrays(image))
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


def files_to_write(output: Sequence[PathLike], endings: Sequence[str], of: str = "") -> list[Path]:
    """Return files whose names must have one of some endings; ``of`` says what is written."""
    files = [Path(name) for name in output]
    for path in files:
        if path.suffix.lower() not in endings:
            raise ValueError(f"output{of} must end in {', '.join(endings)}, got {path.name!r}")
    return files


def write_drawing(
    path: Path, figure: Callable[[], Figure], arrays: Callable[[], Mapping[str, Any]]
) -> None:
    """Write what was drawn as PNG, or its arrays as NumPy archive, by the ending."""
    if path.suffix.lower() == ".png":
        from flgpr.report import figure_png  # loads Matplotlib

        write_new(path, figure_png(figure()))
        return
    with atomic_output(path) as partial:
        np.savez(partial, **arrays())


def _arrays(image: xr.DataArray) -> Entries:
    """Return the arrays of an image and its axes by name."""
    return {"image": image.values} | {str(name): one.values for name, one in image.coords.items()}
