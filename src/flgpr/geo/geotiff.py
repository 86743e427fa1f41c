"""Magnitudes on the Earth as Cloud Optimized GeoTIFF."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import axes_of, reference_system, transform_lonlat
from flgpr.geo.points import STATEMENT
from flgpr.store.extras import optional
from flgpr.store.files import write_whole
from flgpr.types import Float32Array, floats

RUN_VIEW_QUANTITY = "magnitude over the gain background, no unit; no-data where no scan looked"
"""What the values of a run-view are."""
_UNWRITTEN = "it could not be written, is there room on the disk?"
_TILE = 512  # pixels


def write_geotiff(
    view: xr.DataArray,
    path: str | Path,
    anchor: Anchor,
    processing_id: str,
    crs: str | None = None,
    quantity: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> float:
    """Write magnitudes as Cloud Optimized GeoTIFF, one band per polarization and sub-band.

    The raster keeps the lane's pixels, turned by its geotransform, so that nothing is resampled.
    It has tiles of 512 x 512 pixels. Where it is larger than one tile it also has overviews, each
    with half the pixels across and along of the one before. A pixel of an overview is the root of
    the mean square of those below it, so that it shows their mean power; pixels without a value
    do not count.

    Parameters
    ----------
    view : (..., y, x) DataArray
        Magnitudes, such as a run-view, of at least two pixels both ways; NaN where nothing was
        seen.
    path : str or Path
        The file, which holds its old content or all of the new one.
    anchor : Anchor
        Where the lane lies.
    processing_id : str
        What the view came from, a tag of the file.
    crs : str, optional
        A projected reference system, by default the UTM zone.
    quantity : str, optional
        What the values are and in which unit, a tag of the file; by default those of a run-view.
    tags : mapping of str to str, optional
        Further tags of the file.

    Returns
    -------
    float
        Largest misfit of the geotransform, m: a map is not quite a turned lane.

    Raises
    ------
    ValueError
        If the view's axes or the system are not valid.
    MissingExtraError
        Without rasterio, the extra ``gis``.
    OSError
        If the file cannot be written.
    """
    rasterio = optional("rasterio", "gis")
    x = _axis(view, "x")
    y = _axis(view, "y")
    crs = crs or anchor.utm()
    axes = axes_of(reference_system(crs))
    if axes != ("east", "north"):
        raise ValueError(
            f"crs of a GeoTIFF must have axes to east and north, got {crs}, whose axes point to "
            f"{axes[0]} and {axes[1]}"
        )
    bands = view.values.reshape(-1, y.size, x.size)[:, ::-1].astype(np.float32)
    transform, misfit = _geotransform(x, y, anchor, crs, rasterio)
    names = ["run-view"] * len(bands)
    if view.ndim == 4:
        outer, inner = (view[name].values for name in view.dims[:2])
        names = [f"{first} {second}" for first in outer for second in inner]
    sigma = float(anchor.uncertainty(float(x.mean()), float(y.mean())))
    all_tags = {
        **dict(tags or {}),
        "flgpr_processing_id": processing_id,
        "flgpr_quantity": quantity or RUN_VIEW_QUANTITY,
        "flgpr_anchor_sigma_m": f"{sigma:.4g}",
        "flgpr_geotransform_misfit_m": f"{misfit:.3g}",
        "flgpr_statement": STATEMENT,
    }
    data = _cloud_optimized(bands, names, crs, transform, all_tags, rasterio)
    write_whole(Path(path), data)
    return misfit


def _cloud_optimized(
    bands: Float32Array,
    names: Sequence[str],
    crs: str,
    transform: Any,
    tags: Mapping[str, str],
    rasterio: Any,
) -> bytes:
    """Return the bytes of a Cloud Optimized GeoTIFF of bands (band, row, column).

    It is made in memory: GDAL leaves files of its own beside one on disk when it is killed, and
    does not report a full disk.
    """
    count, height, width = bands.shape
    profile = {
        "driver": "COG",
        "dtype": "float32",
        "nodata": float("nan"),
        "width": width,
        "height": height,
        "count": count,
        "crs": crs,
        "transform": transform,
        "BLOCKSIZE": _TILE,
        "COMPRESS": "DEFLATE",
        "PREDICTOR": "YES",
        # Magnitudes are averaged as powers.
        "RESAMPLING": "RMS",
        "BIGTIFF": "IF_SAFER",
    }
    with rasterio.MemoryFile() as memory:
        with memory.open(**profile) as file:
            file.write(bands)
            file.update_tags(**tags)
            for number, name in enumerate(names):
                file.set_band_description(number + 1, name)
        with memory.open() as file:
            if not np.array_equal(file.read(), bands, equal_nan=True):
                raise OSError(errno.EIO, "the GDAL library wrote a raster that reads otherwise")
        return bytes(memory.getbuffer())


@contextmanager
def disk_errors() -> Iterator[None]:
    """Turn an error of GDAL without a number, which mostly means a full disk, into that error."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise OSError(errno.ENOSPC, f"{_UNWRITTEN} ({error})") from None


def _geotransform(x: Any, y: Any, anchor: Anchor, crs: str, rasterio: Any) -> tuple[Any, float]:
    """Fit the affine map from pixels to a projected system, and return its largest misfit, m."""
    columns, rows = np.meshgrid(np.linspace(0, x.size, 5), np.linspace(0, y.size, 5))
    across = x[0] + (columns - 0.5) * (x[1] - x[0])
    along = y[-1] - (rows - 0.5) * (y[1] - y[0])
    lane = np.stack([across, along, np.zeros_like(rows)], axis=-1)
    projected = transform_lonlat(anchor.to_geodetic(lane)[..., :2], crs).reshape(-1, 2)
    # Eastings and northings are large numbers: the fit is made about their mean.
    middle = projected.mean(axis=0)
    design = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)], axis=1)
    coefficients, *_ = np.linalg.lstsq(design, projected - middle, rcond=None)
    residual = design @ coefficients - (projected - middle)
    misfit = float(np.linalg.norm(residual, axis=1).max())
    (a, d), (b, e), (c, f) = coefficients
    return rasterio.Affine(a, b, c + middle[0], d, e, f + middle[1]), misfit


def _axis(view: xr.DataArray, name: str) -> Any:
    """Return an axis of a run-view, which must be uniform and rising."""
    values = floats(view[name].values)
    has_axes = view.dims[-2:] == ("y", "x") and values.size >= 2
    step = np.diff(values)
    if not has_axes or step.min() <= 0 or np.ptp(step) > 1e-6 * step.mean():
        raise ValueError(
            f"view must have the dimensions (..., y, x), both uniform and rising; {name} is not"
        )
    return values
