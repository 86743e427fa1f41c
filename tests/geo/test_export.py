import json
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.geo.anchor import fit_anchor
from flgpr.geo.export import (
    STATEMENT,
    georeference,
    write_earth_csv,
    write_earth_geojson,
    write_geopackage,
    write_geotiff,
    write_kml,
)
from io_geodesy import LANE, distance, on_the_ellipsoid

ALARMS = pd.DataFrame(
    {
        "alarm_id": ["a", "b", "c"],
        "x": [0.5, -1.0, 1.5],
        "y": [3.0, 31.0, 58.0],
        "confidence": [4.2, 1.5, np.nan],
    }
)
TRUE = on_the_ellipsoid(np.stack([ALARMS["x"], ALARMS["y"], 0 * ALARMS["x"]], axis=1))


@pytest.fixture
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)


@pytest.fixture
def points(anchor):
    return georeference(ALARMS, anchor, "alarms", "run-1", "2026-11-21T10:00:00+00:00")


def test_geojson_follows_rfc_7946(points, tmp_path):
    write_earth_geojson(points, tmp_path / "a.geojson", {"title": "lane"})
    told = json.loads((tmp_path / "a.geojson").read_text())
    assert "crs" not in told
    assert told["flgpr"]["statement"] == STATEMENT
    assert told["features"][2]["properties"]["confidence"] is None
    assert told["features"][0]["properties"] | {"anchor_sigma": 0} == {
        "alarm_id": "a", "lane_x": 0.5, "lane_y": 3.0, "confidence": 4.2, "crs": "EPSG:4326",
        "nature": "evidence point", "time": "2026-11-21T10:00:00+00:00", "processing_id": "run-1", "anchor_sigma": 0,
    }  # fmt: skip
    places = np.array([f["geometry"]["coordinates"] for f in told["features"]])
    assert distance(places, TRUE).max() < 0.01


@pytest.mark.parametrize("suffix", ["geojson", "gpkg", "kml"])
def test_an_independent_reader_finds_the_right_place_on_earth(points, tmp_path, suffix):
    pyogrio = pytest.importorskip("pyogrio")
    pytest.importorskip("geopandas")
    path = tmp_path / f"a.{suffix}"
    if suffix == "geojson":
        write_earth_geojson(points, path)
    elif suffix == "gpkg":
        write_geopackage(points, path, "alarms")
    else:
        write_kml(points, path, "lane <1>")
    if suffix == "kml" and "KML" not in pyogrio.list_drivers():
        pytest.skip("this GDAL reads no KML")
    frame = pyogrio.read_dataframe(path)
    assert frame.crs.to_epsg() in (4326, 4979)
    got = np.stack([frame.geometry.x, frame.geometry.y], axis=1)
    assert distance(got, TRUE).max() < 0.01
    assert set(frame.geom_type) == {"Point"}
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_geopackage_keeps_the_columns(points, tmp_path):
    geopandas = pytest.importorskip("geopandas")
    pytest.importorskip("pyogrio")
    write_geopackage(points, tmp_path / "a.gpkg", "alarms")
    frame = geopandas.read_file(tmp_path / "a.gpkg", layer="alarms")
    assert list(frame["alarm_id"]) == ["a", "b", "c"]
    np.testing.assert_array_equal(frame["confidence"], ALARMS["confidence"])
    assert set(frame["nature"]) == {"evidence point"}


def test_kml_and_csv(points, tmp_path):
    write_kml(points, tmp_path / "a.kml", "lane & <1>")
    root = ElementTree.parse(tmp_path / "a.kml").getroot()
    marks = root.findall(".//{*}Placemark")
    assert len(marks) == 3
    assert root.find(".//{*}Polygon") is None
    lon, lat = map(float, marks[1].findtext(".//{*}coordinates").split(","))
    assert distance(np.array([[lon, lat]]), TRUE[1:2])[0] < 0.01
    write_earth_csv(points, tmp_path / "a.csv")
    back = pd.read_csv(tmp_path / "a.csv")
    assert distance(back[["longitude", "latitude"]].to_numpy(), TRUE).max() < 0.01


def test_empty_tables_stay_empty(anchor, tmp_path):
    none = georeference(ALARMS.iloc[:0], anchor, "alarms", "run-1")
    assert len(none) == 0
    write_earth_geojson(none, tmp_path / "a.geojson")
    assert json.loads((tmp_path / "a.geojson").read_text())["features"] == []
    write_kml(none, tmp_path / "a.kml", "none")


def test_what_is_missing_is_named(anchor):
    with pytest.raises(ValueError, match="kind"):
        georeference(ALARMS, anchor, "mines", "p")
    with pytest.raises(ValueError, match="x and y"):
        georeference(ALARMS.drop(columns="x"), anchor, "alarms", "p")
    with pytest.raises(ValueError, match="processing_id"):
        georeference(ALARMS, anchor, "alarms", "")
    with pytest.raises(ValueError, match="time zone"):
        georeference(ALARMS, anchor, "alarms", "p", "2026-11-21T10:00:00")
    with pytest.raises(ValueError, match="ISO 8601"):
        georeference(ALARMS, anchor, "alarms", "p", "yesterday")


def test_geotiff_pixels_lie_where_the_lane_has_them(anchor, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    from pyproj import Transformer

    x = np.arange(-2, 2.01, 0.1)
    y = np.arange(0, 60.01, 0.1)
    values = np.full((2, 1, y.size, x.size), np.nan, np.float32)
    values[1, 0, 310, 7] = 5.0
    view = xr.DataArray(
        values,
        dims=("polarization", "subband", "y", "x"),
        coords={"polarization": ["HH", "VV"], "subband": ["F1"], "y": y, "x": x},
    )
    misfit = write_geotiff(view, tmp_path / "v.tif", anchor, "run-1")
    assert misfit < 0.001
    with rasterio.open(tmp_path / "v.tif") as file:
        band = file.read(2)
        assert file.crs.to_epsg() == 32632
        assert file.descriptions == ("HH F1", "VV F1")
        assert np.isnan(file.nodata)
        assert file.tags()["flgpr_processing_id"] == "run-1"
        row, column = np.argwhere(band == 5.0)[0]
        east, north = file.xy(row, column)
    lonlat = np.stack(
        Transformer.from_crs(32632, 4326, always_xy=True).transform([east], [north]), axis=-1
    )
    assert distance(lonlat, on_the_ellipsoid(np.array([[x[7], y[310], 0]])))[0] < 0.01
    with pytest.raises(ValueError, match="uniform"):
        write_geotiff(view.isel(x=[0, 1, 5]), tmp_path / "w.tif", anchor, "p")
