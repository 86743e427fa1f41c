"""A picture of a run: focused, with its brightest points, and written to files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.calibrate.peaks import image_peaks
from flgpr.chain.progress import Track, silent
from flgpr.geo.anchor import read_anchor
from flgpr.geo.export import write_geotiff
from flgpr.imaging.focus import CHOSEN_PIXELS, focus
from flgpr.imaging.view_axes import View, chosen_scans
from flgpr.store import open_run
from flgpr.store.extras import optional
from flgpr.store.outputs import whole_output

PathLike = str | Path
_GROUND_AHEAD = View()
ENDINGS = (".png", ".npz", ".zarr", ".tif")


@dataclass(frozen=True)
class Picture:
    """A focused image, its brightest points and what was chosen on the way."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    #: of the first polarization, brightest first: x, y, z (m), level (dB re the first), over_median (dB), and the width
    #: at -3 dB along every axis that is imaged, m; NaN where it does not fall so far
    peaks: pd.DataFrame
    spacing: float
    scans: int


def make_picture(
    run: PathLike, view: View = _GROUND_AHEAD, output: Sequence[PathLike] = (), anchor: PathLike | None = None,
    points: int = 5, track: Track = silent,
) -> Picture:  # fmt: skip
    """Focus a stored run and write the picture to files: PNG, NumPy (.npz), Zarr (.zarr) or GeoTIFF (.tif, ``anchor``).

    The sum is coherent over the scans, each from its own pose and weighed by the way that it stands for. A view that
    does not fit the run, a picture of too many pixels or a file of another kind is a ValueError. A file that exists
    stays if it is this very picture, else it is a FileExistsError.
    """
    files = [Path(one) for one in output]
    for path in files:
        if path.suffix.lower() not in ENDINGS:
            raise ValueError(f"output must end in {', '.join(ENDINGS)}, got {path.name!r}")
    tie = read_anchor(anchor) if anchor is not None else None
    if any(path.suffix.lower() == ".tif" for path in files) and tie is None:
        raise ValueError("a GeoTIFF needs an anchor, got none")
    dataset = open_run(run)
    picture = picture_of(dataset, view, points, track, title=Path(run).name)
    pose = dataset["pose"].values[chosen_scans(dataset, view.scans)]
    for path in files:
        if path.suffix.lower() == ".tif":
            _write_tiff(picture.image, path, tie)
        else:
            _write(picture, path, pose)
    return picture


def picture_of(
    run: xr.Dataset,
    view: View,
    points: int = 5,
    track: Track = silent,
    title: str = "",
    pixels: int = CHOSEN_PIXELS,
) -> Picture:
    """Focus a run in memory and find its brightest points."""
    focused = focus(run, view, track, title, pixels)
    peaks = image_peaks(focused.image, points)
    return Picture(focused.image, peaks, focused.spacing, focused.scans)


def _write(picture: Picture, path: Path, pose: NDArray[np.float64]) -> None:
    image = picture.image
    with whole_output(path) as partial:
        if path.suffix.lower() == ".zarr":
            image.to_dataset("polarization").to_zarr(partial, zarr_format=2, consolidated=True)
        elif path.suffix.lower() == ".png":
            from flgpr.report import figure_png  # loads what draws
            from flgpr.report.figures import image_figure

            partial.write_bytes(figure_png(image_figure(image, picture.peaks, pose)))
        else:
            np.savez(
                partial,
                image=image.values,
                **{str(name): axis.values for name, axis in image.coords.items()},
            )


def _write_tiff(image: xr.DataArray, path: Path, tie: Any) -> None:
    if image.sizes["z"] > 1 or min(image.sizes["x"], image.sizes["y"]) < 2:
        raise ValueError("a GeoTIFF must be of level ground, with limits of x and y and one z")
    optional("rasterio", "gis")
    level = image.isel(z=0).copy(data=np.abs(image.values[:, 0]))
    flat = level.expand_dims(subband=["all"], axis=1)
    with whole_output(path) as partial:
        write_geotiff(flat, partial, tie, str(image.attrs["title"]))
