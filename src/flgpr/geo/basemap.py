"""A piece of a map or an aerial photograph, drawn in a lane's own frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from flgpr.geo.anchor import own_anchor, transform_lonlat
from flgpr.store.extras import optional
from flgpr.store.files import existing

DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".mbtiles": "MBTiles", ".gpkg": "GPKG"}
"""Formats of GDAL that are opened, by ending: files that hold their pixels themselves and lead nowhere else."""
# pixels of a side that is drawn, and of the map that are read
_MOST = 2048
_MOST_READ = 30_000_000


def map_backdrop(
    path: str | Path,
    georeference: Mapping[str, float],
    box: tuple[float, float, float, float],
    most: int = _MOST,
) -> bytes:
    """Draw a stored map below a lane: a PNG with +x to the right and +y upwards, transparent where the map ends.

    Parameters
    ----------
    path : path
        GeoTIFF, or raster tiles in MBTiles or GeoPackage, with a reference system; one to four
        bands of 8 bits.
    georeference : mapping
        Run attribute ``georeference``: ``latitude``, ``longitude`` and ``azimuth`` of +y, degrees.
    box : tuple of float
        x_min, x_max, y_min, y_max in the lane frame, m.
    most : int
        Pixels of the longer side.

    Raises
    ------
    ValueError
        If the file is none of these, tells no reference system, has other values than 8 bits, or
        ends before the lane.
    MissingExtraError
        Without the extra ``gis``.
    """
    rasterio = optional("rasterio", "gis")
    file = existing(path, "map")
    driver = DRIVERS.get(file.suffix.lower())
    if driver is None:
        raise ValueError(f"map must end in {', '.join(DRIVERS)}, got {file}")
    tie = own_anchor(georeference)
    x_min, x_max, y_min, y_max = box
    pixel = max(x_max - x_min, y_max - y_min) / most
    x = np.arange(x_min + pixel / 2, x_max, pixel)
    y = np.arange(y_max - pixel / 2, y_min, -pixel)
    try:
        with rasterio.open(file, driver=driver) as source:
            if source.tags(ns="OVERVIEWS"):
                raise ValueError("it must hold its overviews itself, it names a file of them")
            if source.crs is None:
                raise ValueError("it must tell its reference system, it does not")
            if any(kind != "uint8" for kind in source.dtypes) or source.count > 4:
                raise ValueError(
                    f"it must have one to four bands of 8 bits, got {', '.join(source.dtypes[:5])}"
                )
            ground = np.stack([*np.meshgrid(x, y), np.zeros((y.size, x.size))], axis=-1)
            lonlat = tie.to_geodetic(ground)[..., :2]
            place = (
                lonlat
                if source.crs.to_epsg() == 4326
                else transform_lonlat(lonlat, source.crs.to_wkt())
            )
            image = _sampled(source, place)
    except (rasterio.errors.RasterioError, ValueError) as error:
        raise ValueError(f"map {file}: {' '.join(str(error).split())[:240]}") from None
    with catch_warnings(), rasterio.MemoryFile() as memory:
        simplefilter(
            "ignore", rasterio.errors.NotGeoreferencedWarning
        )  # a picture of the lane's frame has no Earth
        with memory.open(driver="PNG", width=x.size, height=y.size, count=4, dtype="uint8") as png:
            png.write(image)
        return bytes(memory.read())


def _sampled(source: Any, place: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Take red, green, blue and opacity (4, row, column) at places (row, column, 2) of a raster's own system."""
    enums, windows = (optional(f"rasterio.{name}", "gis") for name in ("enums", "windows"))
    a, b, c, d, e, f = tuple(~source.transform)[:6]
    columns = a * place[..., 0] + b * place[..., 1] + c
    rows = d * place[..., 0] + e * place[..., 1] + f
    known = (columns >= 0) & (columns < source.width) & (rows >= 0) & (rows < source.height)
    if not known.any():
        raise ValueError("it must lie below the lane, it ends before it")
    left = int(columns[known].min())
    top = int(rows[known].min())
    wide = int(columns[known].max()) - left + 1
    high = int(rows[known].max()) - top + 1
    # Pixels of the map to a pixel drawn, whichever way the lane is turned: no more are read than
    # are drawn.
    steps = [np.hypot(np.diff(columns, axis=axis), np.diff(rows, axis=axis)) for axis in (0, 1)]
    every = max(1.0, float(np.median(np.concatenate([one.ravel() for one in steps]))))
    shape = max(round(high / every), 1), max(round(wide / every), 1)
    if shape[0] * shape[1] > _MOST_READ:
        shrink = (_MOST_READ / (shape[0] * shape[1])) ** 0.5
        shape = max(int(shape[0] * shrink), 1), max(int(shape[1] * shrink), 1)
    named = source.colorinterp[0] == enums.ColorInterp.palette  # of which no mean can be taken
    how = enums.Resampling.nearest if named else enums.Resampling.average
    window = windows.Window(left, top, wide, high)
    data = source.read(window=window, out_shape=(source.count, *shape), resampling=how)
    there = source.dataset_mask(
        window=window, out_shape=shape
    )  # by opacity, mask or the value of no data
    u = np.clip((columns - left) * shape[1] / wide, 0, shape[1] - 1).astype(np.intp)
    v = np.clip((rows - top) * shape[0] / high, 0, shape[0] - 1).astype(np.intp)
    bands = data[:, v, u]
    alpha = np.where(known, there[v, u], 0).astype(np.uint8)
    if named:
        table = source.colormap(1)
        colours = np.array([table.get(k, (0, 0, 0, 0)) for k in range(256)], dtype=np.uint8)
        red, green, blue, solid = np.moveaxis(colours[bands[0]], -1, 0)
        alpha = np.minimum(alpha, solid)
    else:
        red, green, blue = bands[:3] if len(bands) > 2 else np.repeat(bands[:1], 3, axis=0)
    return np.stack([red, green, blue, alpha])
