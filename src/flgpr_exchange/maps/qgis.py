"""QGIS projects over GeoPackages of points, the outline of a lane, and a GeoTIFF.

The elements, in ``templates/project.qgs``, are those of QGIS 3 ("QGIS File Formats" in its user
manual). QGIS fills in what is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from pyproj import CRS

from flgpr.types import ArrayLike, floats
from flgpr_exchange.documents import document

#: colours of viridis, evenly spaced
_VIRIDIS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
_CLASSES = 5  # of points that are drawn by a number
_SMALLEST = 1.2  # mm, of a mark of no weight
_LARGEST = 3.5  # mm, of a mark in the highest class
_SHAPES = {"metal": "square", "plastic": "triangle", "simulant": "diamond"}


@dataclass(frozen=True)
class Range:
    """A class of points that are drawn alike."""

    low: float
    high: float
    label: str
    colour: str  #: red, green and blue, up to 255
    size: str  #: mm


@dataclass(frozen=True)
class Graduated:
    """Points drawn by a number, brighter and larger for larger values."""

    manner: ClassVar[str] = "graduated"
    column: str  #: the column of the number
    classes: Sequence[Range]


@dataclass(frozen=True)
class ByKind:
    """Targets or objects drawn by their ``kind``, with the viewer's shapes."""

    manner: ClassVar[str] = "by kind"
    shapes: Mapping[str, str]  #: by kind
    colour: str  #: red, green and blue of the outlines


@dataclass(frozen=True)
class Outline:
    """The border of an area."""

    manner: ClassVar[str] = "outline"


@dataclass(frozen=True)
class Shaded:
    """A band of a raster in viridis."""

    manner: ClassVar[str] = "shaded"
    band: int  #: its number, from 1
    low: float  #: value of the first colour
    high: float

    @property
    def colours(self) -> Iterable[tuple[float, str]]:
        """Values and their colours."""
        values = np.linspace(self.low, self.high, len(_VIRIDIS))
        return zip(values.tolist(), _VIRIDIS, strict=True)


@dataclass(frozen=True)
class MapLayer:
    """A layer of a project."""

    name: str
    file: str  #: name of a file in the project's folder
    crs: str  #: reference system
    geometry: str  #: "Point", "Polygon", or "" for a raster
    style: Graduated | ByKind | Outline | Shaded  #: how it is drawn

    @property
    def source(self) -> str:
        """Source of the layer for QGIS, relative to the project's folder."""
        if not self.geometry:
            return f"./{self.file}"
        return f"./{self.file}|layername={self.name}"

    @property
    def provider(self) -> str:
        """Library by which QGIS reads the layer."""
        return "ogr" if self.geometry else "gdal"


def project(
    title: str,
    about: str,
    crs: str,
    extent: tuple[float, float, float, float],
    layers: Sequence[MapLayer],
) -> bytes:
    """Return a project, the XML of a ``.qgs`` file.

    Parameters
    ----------
    title, about : str
        Title and description of the project.
    crs : str
        Reference system in which it is shown.
    extent : tuple of float
        Least easting and northing, largest easting and northing, m.
    layers : sequence of MapLayer
        The layers, the first on top.

    Returns
    -------
    bytes
        Content of the file.
    """
    return document(
        "flgpr_exchange.maps",
        "project.qgs",
        title=title,
        about=about,
        crs=crs,
        extent=extent,
        layers=layers,
        wkt=lambda system: CRS(system).to_wkt(),
    )


def graduated(column: str, values: ArrayLike) -> Graduated:
    """Return a style that draws points by a number, in five classes of as many points each.

    Parameters
    ----------
    column : str
        The column of the number.
    values : (point,) array_like of float
        Its values; those that are not finite make no class.

    Returns
    -------
    Graduated
        The style.
    """
    numbers = floats(values)
    finite = numbers[np.isfinite(numbers)]
    edges = np.zeros(2)
    if finite.size:
        # Of as many values each.
        edges = np.unique(np.quantile(finite, np.linspace(0, 1, _CLASSES + 1)))
    if edges.size == 1:
        edges = np.append(edges, edges)
    classes = []
    for number, (low, high) in enumerate(pairwise(edges.tolist()), start=1):
        share = number / (edges.size - 1)
        colour = _VIRIDIS[round(share * (len(_VIRIDIS) - 1))]
        size = _SMALLEST + (_LARGEST - _SMALLEST) * share
        label = f"{low:.3g} to {high:.3g}"
        classes.append(Range(low, high, label, _components(colour), f"{size:.2g}"))
    return Graduated(column, classes)


def by_kind(kinds: Iterable[str], colour: str) -> ByKind:
    """Return a style that draws targets or objects by their kinds, in a colour ``#rrggbb``."""
    shapes = {kind: _SHAPES.get(kind, "hexagon") for kind in sorted(set(kinds))}
    return ByKind(shapes, _components(colour))


def _components(colour: str) -> str:
    """Return red, green and blue of a colour ``#rrggbb``."""
    return ",".join(map(str, bytes.fromhex(colour.removeprefix("#"))))
