import itertools
import json
import struct
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.geo.anchor import fit_anchor
from flgpr.geo.geotiff import RUN_VIEW_QUANTITY, write_geotiff
from flgpr.geo.points import STATEMENT, georeference, write_earth_csv, write_earth_geojson
from flgpr_exchange.maps.points import write_geopackage, write_gpx, write_kml
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


@pytest.fixture
def numbered_view():
    """Return a run-view of two bands and 40 x 1300 pixels, each with a value of its own."""
    x = -1.95 + 0.1 * np.arange(40)
    y = 0.05 * np.arange(1300)
    values = 1.0 + np.arange(2 * y.size * x.size, dtype=np.float32)
    values = values.reshape(2, 1, y.size, x.size)
    values[:, :, :, :3] = np.nan
    return xr.DataArray(
        values,
        dims=("polarization", "subband", "y", "x"),
        coords={"polarization": ["HH", "VV"], "subband": ["F1"], "y": y, "x": x},
    )


def on_the_map(lane, crs):
    """Return easting and northing of positions in the lane, by geodesics."""
    from pyproj import Transformer

    lonlat = on_the_ellipsoid(lane)
    transformer = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    return np.stack(transformer.transform(lonlat[:, 0], lonlat[:, 1]), axis=-1)


def test_every_pixel_of_a_geotiff_is_at_its_point_of_the_map(anchor, numbered_view, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    write_geotiff(numbered_view, tmp_path / "v.tif", anchor, "run-1", tags={"recipe": "abc"})
    x, y = np.meshgrid(numbered_view["x"].values, numbered_view["y"].values)
    lane = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)
    with rasterio.open(tmp_path / "v.tif") as file:
        bands = file.read()
        columns, rows = ~file.transform @ on_the_map(lane, file.crs).T
        tags = file.tags()
    # Pixel centres lie at half numbers of columns and rows.
    assert np.abs(columns % 1 - 0.5).max() < 0.1
    assert np.abs(rows % 1 - 0.5).max() < 0.1
    found = bands[:, rows.astype(int), columns.astype(int)]
    np.testing.assert_array_equal(found, numbered_view.values.reshape(2, -1))
    assert tags["recipe"] == "abc"
    assert tags["flgpr_quantity"] == RUN_VIEW_QUANTITY
    assert tags["flgpr_statement"] == STATEMENT


def tiff_directories(data):
    """Return where each directory of a little-endian TIFF lies, and its numbers by tag."""
    sizes = {3: (2, "H"), 4: (4, "I")}
    directories = []
    (position,) = struct.unpack_from("<I", data, 4)
    while position:
        (count,) = struct.unpack_from("<H", data, position)
        numbers = {}
        for entry in range(position + 2, position + 2 + 12 * count, 12):
            tag, kind, length = struct.unpack_from("<HHI", data, entry)
            if kind not in sizes:
                continue
            size, code = sizes[kind]
            start = entry + 8
            if size * length > 4:
                (start,) = struct.unpack_from("<I", data, start)
            numbers[tag] = struct.unpack_from(f"<{length}{code}", data, start)
        directories.append((position, numbers))
        (position,) = struct.unpack_from("<I", data, position + 2 + 12 * count)
    return directories


WIDTH, HEIGHT, TILE_WIDTH, TILE_HEIGHT, TILE_OFFSETS = 256, 257, 322, 323, 324


def test_a_geotiff_is_cloud_optimized(anchor, numbered_view, tmp_path):
    """The rules that validators of the format check, by the bytes of the file."""
    pytest.importorskip("rasterio")
    write_geotiff(numbered_view, tmp_path / "v.tif", anchor, "run-1")
    data = (tmp_path / "v.tif").read_bytes()
    assert data.startswith(b"II*\0")
    assert b"LAYOUT=IFDS_BEFORE_DATA" in data[:300]
    directories = tiff_directories(data)
    sizes = [(numbers[WIDTH][0], numbers[HEIGHT][0]) for _, numbers in directories]
    assert sizes == [(40, 1300), (20, 650), (10, 325)]
    positions = [position for position, _ in directories]
    assert positions == sorted(positions)
    for _, numbers in directories:
        assert numbers[TILE_WIDTH] == numbers[TILE_HEIGHT] == (512,)
    # Directories, then the tiles of the smallest overview first, those of the raster last.
    tiles = [numbers[TILE_OFFSETS] for _, numbers in directories]
    assert positions[-1] < min(min(offsets) for offsets in tiles)
    for larger, smaller in itertools.pairwise(tiles):
        assert max(smaller) < min(larger)


def test_overviews_hold_the_mean_power(anchor, numbered_view, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    write_geotiff(numbered_view, tmp_path / "v.tif", anchor, "run-1")
    with rasterio.open(tmp_path / "v.tif") as file:
        full = file.read(2).astype(np.float64)
        assert [file.overviews(band) for band in (1, 2)] == [[2, 4], [2, 4]]
    with rasterio.open(tmp_path / "v.tif", overview_level=0) as file:
        overview = file.read(2)
    blocks = full.reshape(650, 2, 20, 2)
    power = np.nanmean(blocks[:, :, 1:] ** 2, axis=(1, 3))
    np.testing.assert_allclose(overview[:, 1:], np.sqrt(power), rtol=1e-6)
    assert np.isnan(overview[:, 0]).all()


def test_a_small_geotiff_has_one_tile_and_equal_views_give_equal_bytes(
    anchor, numbered_view, tmp_path
):
    pytest.importorskip("rasterio")
    small = numbered_view.isel(y=slice(0, 100))
    for name in ("a.tif", "b.tif"):
        write_geotiff(small, tmp_path / name, anchor, "run-1")
    data = (tmp_path / "a.tif").read_bytes()
    assert data == (tmp_path / "b.tif").read_bytes()
    [(_, numbers)] = tiff_directories(data)
    assert len(numbers[TILE_OFFSETS]) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tif", "b.tif"]


def test_columns_of_a_table_stay_beside_what_an_export_adds(anchor):
    """A truth's height is its body's, and an alarm has a time of its own."""
    own = ALARMS.assign(
        height=[0.08, 0.1, 0.2], time=["2026-05-01T10:00:00Z", "", "x"], lane_x=77.0
    )
    points = georeference(own, anchor, "alarms", "run-1")
    assert points["height"].tolist() == [0.08, 0.1, 0.2]
    assert points["time"].tolist() == ["2026-05-01T10:00:00Z", "", "x"]
    assert points["ellipsoidal_height"].to_numpy() == pytest.approx(0.0, abs=1e-3)
    assert points["lane_x"].tolist() == ALARMS["x"].tolist()
    assert not points.columns.duplicated().any()
    stamped = georeference(own, anchor, "alarms", "run-1", "2026-11-21T10:00:00+00:00")
    assert stamped["time"].unique().tolist() == ["2026-11-21T10:00:00+00:00"]


def test_one_anchor_does_not_put_two_lanes_on_one_ground(anchor):
    with pytest.raises(ValueError, match=r"anchor ties one lane .* got rows of 2 lanes \(A, B\)"):
        georeference(ALARMS.assign(lane=["A", "B", "A"]), anchor, "alarms", "run-1")
    assert len(georeference(ALARMS.assign(lane=["A", "", None]), anchor, "alarms", "run-1")) == 3


def test_a_waypoint_says_what_it_is_in_words_and_when_in_utc(anchor, tmp_path):
    time = "2026-11-21T10:00:00+02:00"
    points = georeference(ALARMS.assign(lane="A", depth=0.1), anchor, "alarms", "run-1", time)
    write_gpx(points, tmp_path / "a.gpx")
    gpx = "{http://www.topografix.com/GPX/1/1}"
    [first, *_, last] = ElementTree.parse(tmp_path / "a.gpx").iter(f"{gpx}wpt")
    assert first.findtext(f"{gpx}time") == "2026-11-21T08:00:00.000000Z"
    words = first.findtext(f"{gpx}desc")
    assert words.startswith("evidence point: x 0.500 m, y 3.000 m in lane A; confidence 4.2; ")
    assert words.endswith("m; EPSG:4326; from run-1")
    assert "depth 0.1" in words
    assert "confidence" not in last.findtext(f"{gpx}desc")


def test_columns_that_a_geopackage_does_not_tell_apart_are_renamed(anchor, tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    pytest.importorskip("geopandas")
    own = ALARMS.assign(fid=[1, 1, 2], kind="metal", Kind="steel")
    write_geopackage(georeference(own, anchor, "alarms", "run-1"), tmp_path / "a.gpkg", "alarms")
    read = pyogrio.read_dataframe(tmp_path / "a.gpkg")
    assert read["fid_2"].tolist() == [1, 1, 2]
    assert set(read["kind"]) == {"metal"}
    assert set(read["Kind_2"]) == {"steel"}
