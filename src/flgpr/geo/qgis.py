"""A project of QGIS over layers that lie beside it: GeoPackages of points and of the lane's outline, and a GeoTIFF.

The elements are those of QGIS 3 ("QGIS File Formats" in its user manual); what is left out QGIS fills in.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS

from flgpr.geo.export import printable

#: anchors of viridis, evenly spaced
_VIRIDIS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
_CLASSES = 5
_SHAPES = {"metal": "square", "plastic": "triangle", "simulant": "diamond"}


@dataclass(frozen=True)
class Layer:
    """A layer of a project: ``name``, ``file`` beside the project, ``crs``, and how it is drawn (elements)."""

    name: str
    file: str
    crs: str
    geometry: str  #: "Point", "Polygon", or "" for a raster
    style: ElementTree.Element

    @property
    def source(self) -> str:
        """Where QGIS finds it, from the project's folder."""
        return f"./{self.file}|layername={self.name}" if self.geometry else f"./{self.file}"


def project(
    title: str,
    about: str,
    crs: str,
    extent: tuple[float, float, float, float],
    layers: Sequence[Layer],
) -> bytes:
    """Write a project (XML of a ``.qgs``) that shows ``layers``, the first on top, in ``crs`` over an extent in it.

    ``extent`` is least and largest easting and northing: (x_min, y_min, x_max, y_max).
    """
    root = ElementTree.Element("qgis", {"projectname": printable(title), "version": "3.22.0"})
    _put(root, "title", title)
    metadata = _put(root, "projectMetadata")
    _put(metadata, "title", title)
    _put(metadata, "abstract", about)
    _reference(_put(root, "projectCrs"), crs)
    tree = _put(root, "layer-tree-group")
    held = ElementTree.Element("projectlayers")
    for number, layer in enumerate(layers):
        provider = "ogr" if layer.geometry else "gdal"
        identity = f"flgpr_{number}_{layer.name}"
        told = {"id": identity, "name": layer.name, "source": layer.source, "providerKey": provider}
        _put(tree, "layer-tree-layer", **told, checked="Qt::Checked", expanded="1")
        held.append(_map_layer(layer, identity, provider))
    canvas = _put(root, "mapcanvas", name="theMapCanvas")
    _put(canvas, "units", "meters")
    box = _put(canvas, "extent")
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), extent, strict=True):
        _put(box, name, f"{value:.3f}")
    _reference(_put(canvas, "destinationsrs"), crs)
    root.append(held)
    properties = _put(root, "properties")
    _put(_put(properties, "Paths"), "Absolute", "false", type="bool")
    _put(_put(properties, "SpatialRefSys"), "ProjectionsEnabled", "1", type="int")
    ElementTree.indent(root)
    return (
        b"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
        + ElementTree.tostring(root, "utf-8")
        + b"\n"
    )


def graduated(column: str, values: ArrayLike) -> ElementTree.Element:
    """Draw points by a number: five classes of as many points each, the larger the value, the brighter and larger."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    edges = (
        np.unique(np.quantile(known, np.linspace(0, 1, _CLASSES + 1)))
        if known.size
        else np.zeros(1)
    )
    edges = np.append(edges, edges[-1]) if edges.size == 1 else edges
    renderer = _renderer("graduatedSymbol", attr=column, graduatedMethod="GraduatedColor")
    ranges = _put(renderer, "ranges")
    symbols = _put(renderer, "symbols")
    for number, (low, high) in enumerate(pairwise(edges)):
        share = (number + 1) / (edges.size - 1)
        label = f"{low:.3g} to {high:.3g}"
        limits = {"lower": repr(float(low)), "upper": repr(float(high))}
        _put(ranges, "range", **limits, symbol=str(number), label=label, render="true")
        _marker(
            symbols,
            number,
            "circle",
            _VIRIDIS[round(share * (len(_VIRIDIS) - 1))],
            1.2 + 2.3 * share,
        )
    _put(
        _put(renderer, "orderby"), "orderByClause", f'"{column}"', asc="1", nullsFirst="1"
    )  # the largest on top
    renderer.set("enableorderby", "1")
    return renderer


def by_kind(kinds: Iterable[str], colour: str) -> ElementTree.Element:
    """Draw targets or objects by their ``kind``, each with the shape that the viewer gives it."""
    renderer = _renderer("categorizedSymbol", attr="kind")
    categories = _put(renderer, "categories")
    symbols = _put(renderer, "symbols")
    for number, kind in enumerate(sorted(set(kinds))):
        _put(categories, "category", value=kind, symbol=str(number), label=kind, render="true")
        _marker(symbols, number, _SHAPES.get(kind, "hexagon"), colour, 4, filled=False)
    return renderer


def outline() -> ElementTree.Element:
    """Draw an area by its border alone."""
    renderer = _renderer("singleSymbol")
    symbol = _put(
        _put(renderer, "symbols"), "symbol", type="fill", name="0", alpha="1", clip_to_extent="1"
    )
    options = {
        "style": "no",
        "outline_color": "255,140,0,255",
        "outline_style": "dash",
        "outline_width": "0.6",
    }
    _symbol_layer(symbol, "SimpleFill", options | {"outline_width_unit": "MM"})
    return renderer


def shaded(band: int, low: float, high: float) -> ElementTree.Element:
    """Draw one band of a raster, counted from 1, in viridis between two values."""
    limits = {"classificationMin": repr(float(low)), "classificationMax": repr(float(high))}
    kind = {"type": "singlebandpseudocolor", "band": str(band), "alphaBand": "-1", "opacity": "1"}
    renderer = ElementTree.Element("rasterrenderer", kind | limits)
    ramp = {"colorRampType": "INTERPOLATED", "classificationMode": "1", "clip": "0"}
    ends = {"minimumValue": repr(float(low)), "maximumValue": repr(float(high))}
    shader = _put(_put(renderer, "rastershader"), "colorrampshader", **ramp, **ends)
    for value, colour in zip(np.linspace(low, high, len(_VIRIDIS)), _VIRIDIS, strict=True):
        _put(
            shader,
            "item",
            value=repr(float(value)),
            label=f"{value:.3g}",
            color=colour,
            alpha="255",
        )
    return renderer


def _map_layer(layer: Layer, identity: str, provider: str) -> ElementTree.Element:
    kind = {"type": "vector", "geometry": layer.geometry} if layer.geometry else {"type": "raster"}
    entry = ElementTree.Element("maplayer", kind)
    _put(entry, "id", identity)
    _put(entry, "datasource", layer.source)
    _put(entry, "layername", layer.name)
    _reference(_put(entry, "srs"), layer.crs)
    if layer.geometry:
        _put(entry, "provider", provider, encoding="UTF-8")
        entry.append(layer.style)
    else:
        _put(entry, "provider", provider)
        _put(entry, "pipe").append(layer.style)
    return entry


def _reference(parent: ElementTree.Element, crs: str) -> None:
    system = _put(parent, "spatialrefsys")
    _put(system, "wkt", CRS(crs).to_wkt())  # a project of the name alone has no reference system
    _put(system, "authid", crs)


def _renderer(kind: str, **attributes: str) -> ElementTree.Element:
    always = {"type": kind, "symbollevels": "0", "forceraster": "0", "enableorderby": "0"}
    return ElementTree.Element("renderer-v2", always | attributes)


def _marker(
    symbols: ElementTree.Element,
    number: int,
    shape: str,
    colour: str,
    size: float,
    filled: bool = True,
) -> None:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    own = f"{red},{green},{blue},{255 if filled else 0}"
    border = ("0,0,0,255", "0.3") if filled else (f"{red},{green},{blue},255", "0.6")
    options = {"name": shape, "color": own, "outline_color": border[0], "outline_width": border[1]}
    symbol = _put(symbols, "symbol", type="marker", name=str(number), alpha="1", clip_to_extent="1")
    units = {"size_unit": "MM", "outline_width_unit": "MM"}
    _symbol_layer(
        symbol, "SimpleMarker", options | units | {"size": f"{size:.2g}", "outline_style": "solid"}
    )


def _symbol_layer(symbol: ElementTree.Element, kind: str, options: Mapping[str, str]) -> None:
    """Give a symbol its only layer; its options stand there twice, as QGIS reads them since 3.22 and before."""
    layer = ElementTree.SubElement(
        symbol, "layer", {"class": kind, "pass": "0", "enabled": "1", "locked": "0"}
    )
    values = _put(layer, "Option", type="Map")
    for name, value in options.items():
        _put(values, "Option", name=name, value=value, type="QString")
    for name, value in options.items():
        _put(layer, "prop", k=name, v=value)


def _put(
    parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str
) -> ElementTree.Element:
    child = ElementTree.SubElement(
        parent, tag, {name: printable(value) for name, value in attributes.items()}
    )
    child.text = None if text is None else printable(text)
    return child
