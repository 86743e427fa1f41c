"""QGIS projects over GeoPackages of points, the outline of a lane, and a GeoTIFF.

The elements are those of QGIS 3 ("QGIS File Formats" in its user manual). QGIS fills in what is
left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS

from flgpr_exchange.maps.points import xml_text

#: colours of viridis, evenly spaced
_VIRIDIS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
_CLASSES = 5  # of points that are drawn by a number
_SMALLEST = 1.2  # mm, of a mark of no weight
_LARGEST = 3.5  # mm, of a mark in the highest class
_DOCTYPE = b"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
_SHAPES = {"metal": "square", "plastic": "triangle", "simulant": "diamond"}


@dataclass(frozen=True)
class MapLayer:
    """A layer of a project."""

    name: str
    file: str  #: name of a file in the project's folder
    crs: str  #: reference system
    geometry: str  #: "Point", "Polygon", or "" for a raster
    style: ElementTree.Element  #: how it is drawn

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
    root = ElementTree.Element("qgis", {"projectname": xml_text(title), "version": "3.22.0"})
    _put(root, "title", title)
    metadata = _put(root, "projectMetadata")
    _put(metadata, "title", title)
    _put(metadata, "abstract", about)
    project_crs = _put(root, "projectCrs")
    _reference(project_crs, crs)

    # A layer stands twice: in the tree that a user sees, and with its source and style.
    tree = _put(root, "layer-tree-group")
    map_layers = ElementTree.Element("projectlayers")
    for number, layer in enumerate(layers):
        identity = f"flgpr_{number}_{layer.name}"
        _put(
            tree,
            "layer-tree-layer",
            id=identity,
            name=layer.name,
            source=layer.source,
            providerKey=layer.provider,
            checked="Qt::Checked",
            expanded="1",
        )
        map_layers.append(_map_layer(layer, identity))

    _add_canvas(root, crs, extent)
    root.append(map_layers)
    properties = _put(root, "properties")
    paths = _put(properties, "Paths")
    _put(paths, "Absolute", "false", type="bool")
    reference_systems = _put(properties, "SpatialRefSys")
    _put(reference_systems, "ProjectionsEnabled", "1", type="int")
    ElementTree.indent(root)
    return _DOCTYPE + ElementTree.tostring(root, "utf-8") + b"\n"


def _add_canvas(
    root: ElementTree.Element, crs: str, extent: tuple[float, float, float, float]
) -> None:
    """Add the map: its unit, what of it is shown, and in which reference system."""
    canvas = _put(root, "mapcanvas", name="theMapCanvas")
    _put(canvas, "units", "meters")
    box = _put(canvas, "extent")
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), extent, strict=True):
        _put(box, name, f"{value:.3f}")
    shown_in = _put(canvas, "destinationsrs")
    _reference(shown_in, crs)


def graduated(column: str, values: ArrayLike) -> ElementTree.Element:
    """Return a style that draws points by a number, brighter and larger for larger values.

    There are five classes of as many points each.

    Parameters
    ----------
    column : str
        The column of the number.
    values : (point,) array_like of float
        Its values; those that are not finite make no class.

    Returns
    -------
    xml.etree.ElementTree.Element
        The style.
    """
    edges = _class_edges(np.asarray(values, dtype=np.float64))
    renderer = _renderer("graduatedSymbol", attr=column, graduatedMethod="GraduatedColor")
    ranges = _put(renderer, "ranges")
    symbols = _put(renderer, "symbols")
    classes = edges.size - 1
    for number, (low, high) in enumerate(pairwise(edges.tolist())):
        _put(
            ranges,
            "range",
            lower=repr(low),
            upper=repr(high),
            symbol=str(number),
            label=f"{low:.3g} to {high:.3g}",
            render="true",
        )
        share = (number + 1) / classes
        colour = _VIRIDIS[round(share * (len(_VIRIDIS) - 1))]
        size = _SMALLEST + (_LARGEST - _SMALLEST) * share
        _marker(symbols, number, "circle", colour, size)
    # Points are drawn in this order, so that the largest values are on top.
    order = _put(renderer, "orderby")
    _put(order, "orderByClause", f'"{column}"', asc="1", nullsFirst="1")
    renderer.set("enableorderby", "1")
    return renderer


def _class_edges(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of classes of as many finite values each, at least two edges."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return np.zeros(2)
    shares = np.linspace(0, 1, _CLASSES + 1)
    edges = np.unique(np.quantile(finite, shares))
    if edges.size == 1:
        return np.append(edges, edges[-1])
    return edges


def by_kind(kinds: Iterable[str], colour: str) -> ElementTree.Element:
    """Return a style that draws targets or objects by their ``kind``, with the viewer's shapes.

    Parameters
    ----------
    kinds : iterable of str
        The kinds that are there.
    colour : str
        Colour of the outlines, ``#rrggbb``.

    Returns
    -------
    xml.etree.ElementTree.Element
        The style.
    """
    renderer = _renderer("categorizedSymbol", attr="kind")
    categories = _put(renderer, "categories")
    symbols = _put(renderer, "symbols")
    for number, kind in enumerate(sorted(set(kinds))):
        _put(categories, "category", value=kind, symbol=str(number), label=kind, render="true")
        _marker(symbols, number, _SHAPES.get(kind, "hexagon"), colour, 4, filled=False)
    return renderer


def outline() -> ElementTree.Element:
    """Return a style that draws the border of an area."""
    renderer = _renderer("singleSymbol")
    symbols = _put(renderer, "symbols")
    symbol = _put(symbols, "symbol", type="fill", name="0", alpha="1", clip_to_extent="1")
    options = {
        "style": "no",
        "outline_color": "255,140,0,255",
        "outline_style": "dash",
        "outline_width": "0.6",
        "outline_width_unit": "MM",
    }
    _symbol_layer(symbol, "SimpleFill", options)
    return renderer


def shaded(band: int, low: float, high: float) -> ElementTree.Element:
    """Return a style that draws a band of a raster in viridis.

    Parameters
    ----------
    band : int
        Number of the band, from 1.
    low, high : float
        Values of the first and the last colour.

    Returns
    -------
    xml.etree.ElementTree.Element
        The style.
    """
    least = repr(float(low))
    largest = repr(float(high))
    attributes = {
        "type": "singlebandpseudocolor",
        "band": str(band),
        "alphaBand": "-1",
        "opacity": "1",
        "classificationMin": least,
        "classificationMax": largest,
    }
    renderer = ElementTree.Element("rasterrenderer", attributes)
    ramp = {
        "colorRampType": "INTERPOLATED",
        "classificationMode": "1",
        "clip": "0",
        "minimumValue": least,
        "maximumValue": largest,
    }
    raster_shader = _put(renderer, "rastershader")
    shader = _put(raster_shader, "colorrampshader", **ramp)
    values = np.linspace(low, high, len(_VIRIDIS))
    for value, colour in zip(values.tolist(), _VIRIDIS, strict=True):
        _put(
            shader,
            "item",
            value=repr(value),
            label=f"{value:.3g}",
            color=colour,
            alpha="255",
        )
    return renderer


def _map_layer(layer: MapLayer, identity: str) -> ElementTree.Element:
    """Return the element of a layer: its source, reference system and style."""
    attributes = {"type": "raster"}
    if layer.geometry:
        attributes = {"type": "vector", "geometry": layer.geometry}
    entry = ElementTree.Element("maplayer", attributes)
    _put(entry, "id", identity)
    _put(entry, "datasource", layer.source)
    _put(entry, "layername", layer.name)
    reference_system = _put(entry, "srs")
    _reference(reference_system, layer.crs)
    if layer.geometry:
        _put(entry, "provider", layer.provider, encoding="UTF-8")
        entry.append(layer.style)
    else:
        _put(entry, "provider", layer.provider)
        pipe = _put(entry, "pipe")
        pipe.append(layer.style)
    return entry


def _reference(parent: ElementTree.Element, crs: str) -> None:
    """Add a reference system to an element."""
    system = _put(parent, "spatialrefsys")
    # With the name alone QGIS shows a project without a reference system.
    _put(system, "wkt", CRS(crs).to_wkt())
    _put(system, "authid", crs)


def _renderer(kind: str, **attributes: str) -> ElementTree.Element:
    """Return a style of a layer of points or areas, without its symbols."""
    defaults = {"type": kind, "symbollevels": "0", "forceraster": "0", "enableorderby": "0"}
    return ElementTree.Element("renderer-v2", defaults | attributes)


def _marker(
    symbols: ElementTree.Element,
    number: int,
    shape: str,
    colour: str,
    size: float,
    filled: bool = True,
) -> None:
    """Add the symbol of a point; the colour is ``#rrggbb``, the size in mm."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    opaque = f"{red},{green},{blue},255"
    transparent = f"{red},{green},{blue},0"
    symbol = _put(symbols, "symbol", type="marker", name=str(number), alpha="1", clip_to_extent="1")
    options = {
        "name": shape,
        "color": opaque if filled else transparent,
        "outline_color": "0,0,0,255" if filled else opaque,
        "outline_width": "0.3" if filled else "0.6",
        "size_unit": "MM",
        "outline_width_unit": "MM",
        "size": f"{size:.2g}",
        "outline_style": "solid",
    }
    _symbol_layer(symbol, "SimpleMarker", options)


def _symbol_layer(symbol: ElementTree.Element, kind: str, options: Mapping[str, str]) -> None:
    """Add the only layer of a symbol.

    Its options are there twice, as ``Option`` for QGIS since 3.22 and as ``prop`` for older ones.
    """
    attributes = {"class": kind, "pass": "0", "enabled": "1", "locked": "0"}
    layer = ElementTree.SubElement(symbol, "layer", attributes)
    values = _put(layer, "Option", type="Map")
    for name, value in options.items():
        _put(values, "Option", name=name, value=value, type="QString")
    for name, value in options.items():
        _put(layer, "prop", k=name, v=value)


def _put(
    parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str
) -> ElementTree.Element:
    """Add an element with text and attributes fit for XML, and return it."""
    printable_attributes = {name: xml_text(value) for name, value in attributes.items()}
    child = ElementTree.SubElement(parent, tag, printable_attributes)
    child.text = None if text is None else xml_text(text)
    return child
