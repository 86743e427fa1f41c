"""A part of a map or an aerial photograph, drawn in the frame of a lane."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from flgpr.geo.anchor import own_anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.model.printable import in_one_line
from flgpr.store.extras import optional
from flgpr.store.files import existing
from flgpr.types import FloatArray

DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".mbtiles": "MBTiles", ".gpkg": "GPKG"}
"""Formats of GDAL that are opened, by ending: those whose files name no other file."""
_MOST = 2048  # pixels of the longer side of the picture
_MOST_READ = 30_000_000  # pixels of the map that are read
_LONGEST_REASON = 240  # characters of a library's message that are passed on
_WGS_84 = 4326  # EPSG code of longitude and latitude


def map_backdrop(
    path: str | Path,
    georeference: Mapping[str, float],
    box: tuple[float, float, float, float],
    most: int = _MOST,
) -> bytes:
    """Draw a stored map in the frame of a lane, +x to the right and +y upwards.

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

    Returns
    -------
    bytes
        PNG, transparent where the map ends.

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
    anchor = own_anchor(georeference)
    ground = _pixel_centres(box, most)
    try:
        with rasterio.open(file, driver=driver) as source:
            _check_map(source)
            points = anchor.to_geodetic(ground)[..., :2]
            if source.crs.to_epsg() != _WGS_84:
                points = transform_lonlat(points, source.crs.to_wkt())
            image = _sample(source, points)
    except (rasterio.errors.RasterioError, ValueError) as error:
        raise ValueError(f"map {file}: {in_one_line(error, _LONGEST_REASON)}") from None
    return _png_bytes(image)


def _pixel_centres(box: tuple[float, float, float, float], most: int) -> FloatArray:
    """Return the centres (row, column, 3) of the pixels of a box of the lane frame, m.

    The first row is that of the largest y, as in a picture.
    """
    x_min, x_max, y_min, y_max = box
    pixel = max(x_max - x_min, y_max - y_min) / most
    x = np.arange(x_min + pixel / 2, x_max, pixel)
    y = np.arange(y_max - pixel / 2, y_min, -pixel)
    across, ahead = np.meshgrid(x, y)
    height = np.zeros((y.size, x.size))
    return np.stack([across, ahead, height], axis=-1)


def _png_bytes(image: NDArray[np.uint8]) -> bytes:
    """Return red, green, blue and opacity (4, row, column) as PNG."""
    rasterio = optional("rasterio", "gis")
    _, rows, columns = image.shape
    with catch_warnings(), rasterio.MemoryFile() as memory:
        # A picture in the lane's frame has no georeference.
        simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with memory.open(
            driver="PNG",
            width=columns,
            height=rows,
            count=4,
            dtype="uint8",
        ) as png:
            png.write(image)
        return bytes(memory.read())


def _check_map(source: Any) -> None:
    """Refuse a raster that names other files, has no reference system, or is not of 8 bits."""
    if source.tags(ns="OVERVIEWS"):
        raise ValueError("it must hold its overviews itself, it names a file of them")
    if source.crs is None:
        raise ValueError("it must tell its reference system, it does not")
    is_of_8_bits = all(kind == "uint8" for kind in source.dtypes)
    if not is_of_8_bits or source.count > 4:
        kinds = ", ".join(source.dtypes[:5])
        raise ValueError(f"it must have one to four bands of 8 bits, got {kinds}")


def _sample(source: Any, points: FloatArray) -> NDArray[np.uint8]:
    """Return red, green, blue and opacity (4, row, column) of a raster.

    The points (row, column, 2) are in the raster's own reference system.
    """
    enums = optional("rasterio.enums", "gis")
    windows = optional("rasterio.windows", "gis")
    # The inverse of the map's affine transform leads from its coordinates to its pixels.
    a, b, c, d, e, f = tuple(~source.transform)[:6]
    columns = a * points[..., 0] + b * points[..., 1] + c
    rows = d * points[..., 0] + e * points[..., 1] + f
    inside = (columns >= 0) & (columns < source.width)
    inside &= (rows >= 0) & (rows < source.height)
    if not inside.any():
        raise ValueError("it must lie below the lane, it ends before it")

    # Only the window of the map below the lane is read.
    left = int(columns[inside].min())
    top = int(rows[inside].min())
    width = int(columns[inside].max()) - left + 1
    height = int(rows[inside].max()) - top + 1
    shape = _shape_to_read(columns, rows, width, height)

    # The numbers of a palette's colours have no mean.
    has_palette = source.colorinterp[0] == enums.ColorInterp.palette
    resampling = enums.Resampling.nearest if has_palette else enums.Resampling.average
    window = windows.Window(left, top, width, height)
    data = source.read(window=window, out_shape=(source.count, *shape), resampling=resampling)
    mask = source.dataset_mask(window=window, out_shape=shape)
    read_rows, read_columns = shape
    u = np.clip((columns - left) * read_columns / width, 0, read_columns - 1).astype(np.intp)
    v = np.clip((rows - top) * read_rows / height, 0, read_rows - 1).astype(np.intp)
    bands = data[:, v, u]
    alpha = np.where(inside, mask[v, u], 0).astype(np.uint8)
    if has_palette:
        colours = _palette(source)
        red, green, blue, opacity = np.moveaxis(colours[bands[0]], -1, 0)
        alpha = np.minimum(alpha, opacity)
    elif len(bands) > 2:
        red, green, blue = bands[:3]
    else:
        red, green, blue = np.repeat(bands[:1], 3, axis=0)
    return np.stack([red, green, blue, alpha])


def _palette(source: Any) -> NDArray[np.uint8]:
    """Return the colours (256, 4) of a raster's palette; numbers without one are transparent."""
    table = source.colormap(1)
    colours = []
    for number in range(256):
        colours.append(table.get(number, (0, 0, 0, 0)))
    return np.array(colours, dtype=np.uint8)


def _shape_to_read(
    columns: FloatArray, rows: FloatArray, width: int, height: int
) -> tuple[int, int]:
    """Return rows and columns to read of a window of a map, so that no more are read than drawn."""
    # Pixels of the map from one drawn pixel to the next, whichever way the lane is turned.
    steps = []
    for axis in (0, 1):
        step = np.hypot(np.diff(columns, axis=axis), np.diff(rows, axis=axis))
        steps.append(step.ravel())
    every = max(1.0, float(np.median(np.concatenate(steps))))
    shape = (max(round(height / every), 1), max(round(width / every), 1))
    pixels = shape[0] * shape[1]
    if pixels > _MOST_READ:
        shrink = (_MOST_READ / pixels) ** 0.5
        shape = (max(int(shape[0] * shrink), 1), max(int(shape[1] * shrink), 1))
    return shape
