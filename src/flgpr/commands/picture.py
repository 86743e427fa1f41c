"""A focused image of a run with its brightest points, written to files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.calibrate.peaks import image_peaks
from flgpr.commands.drawings import files_to_write, image_arrays, write_drawing
from flgpr.geo.anchor import read_anchor
from flgpr.geo.geotiff import write_geotiff
from flgpr.imaging.focus import CHOSEN_PIXELS, focus
from flgpr.imaging.view_axes import View, chosen_scans
from flgpr.progress import Track, silent
from flgpr.store import open_run
from flgpr.store.extras import optional
from flgpr.store.outputs import atomic_output
from flgpr.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PathLike = str | Path
_GROUND_AHEAD = View()
_IMAGE_QUANTITY = "magnitude of the focused image, in the arbitrary unit of the run's signal"
ENDINGS = (".png", ".npz", ".zarr", ".tif")


@dataclass(frozen=True)
class Picture:
    """A focused image and its brightest points."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    #: of the first polarization, brightest first: x, y, z (m), level (dB re the first),
    #: over_median (dB), and the width at -3 dB along every axis that is imaged, m; NaN where the
    #: level does not fall so far
    peaks: pd.DataFrame
    spacing: float  #: of pixels, m
    scans: int  #: number of scans that were summed
    notes: tuple[str, ...] = ()  #: what was left out, and what may be wrong, in words

    def lines(self) -> Iterator[str]:
        """Yield scans and pixels, then a line for each of the brightest points."""
        sizes = [self.image.sizes[axis] for axis in "xyz"]
        pixels = " x ".join(str(size) for size in sizes if size > 1)
        yield f"{self.scans} scans, {pixels} pixels of {self.spacing:g} m; brightest points:"
        for number, row in enumerate(self.peaks.to_dict("records"), 1):
            widths = []
            for name, value in row.items():
                if str(name).startswith("width") and value > 0:
                    widths.append(f"{str(name)[-1]} {value:.3f}")
            width = f", -3 dB width {', '.join(widths)} m" if widths else ""
            yield (
                f"{number:3}  ({row['x']:.3f}, {row['y']:.3f}, {row['z']:.3f}) m  "
                f"{row['level']:6.1f} dB, {row['over_median']:.1f} dB over the median{width}"
            )
        for note in self.notes:
            yield f"note: {note}"

    def summary(self) -> dict[str, Any]:
        """Return the figures of the picture."""
        return {
            "spacing_m": self.spacing,
            "scans": self.scans,
            "shape": dict(self.image.sizes),
            "notes": list(self.notes),
            "peaks": json.loads(self.peaks.to_json(orient="records")),
        }


def make_picture(
    run: PathLike,
    view: View = _GROUND_AHEAD,
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
    files = files_to_write(output, ENDINGS)
    lane_anchor = None if anchor is None else read_anchor(anchor)
    if lane_anchor is None and any(path.suffix.lower() == ".tif" for path in files):
        raise ValueError("a GeoTIFF needs an anchor, got none")

    dataset = open_run(run)
    picture = picture_of(dataset, view, points, track, title=Path(run).name)
    poses = dataset["pose"].values[chosen_scans(dataset, view.scans)]
    for path in files:
        if path.suffix.lower() == ".tif":
            _write_tiff(picture.image, path, lane_anchor)
        else:
            _write(picture, path, poses)
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
    peaks = image_peaks(focused.image, points)
    return Picture(focused.image, peaks, focused.spacing, focused.scans, focused.notes)


def _write(picture: Picture, path: Path, poses: FloatArray) -> None:
    """Write a picture as Zarr, PNG or NumPy archive, by the ending."""
    image = picture.image
    if path.suffix.lower() == ".zarr":
        with atomic_output(path) as partial:
            image.to_dataset("polarization").to_zarr(partial, zarr_format=2, consolidated=True)
        return

    def figure() -> Figure:
        from flgpr.report.images import image_figure

        return image_figure(image, picture.peaks, poses)

    write_drawing(path, figure, lambda: image_arrays(image))


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
