"""A map below the lane: what lies where on the Earth lies there in the lane's frame."""

import io

import numpy as np
import pytest

from flgpr.geo import fit_anchor, map_backdrop
from flgpr.geo.geodesy import transform_lonlat

rasterio = pytest.importorskip("rasterio")
pytest.importorskip("rasterio.shutil")
Image = pytest.importorskip("PIL.Image")
pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning"
)  # rasterio's own, of affine

TIE = {"latitude": 47.9, "longitude": 11.3, "azimuth": 30.0}
ANCHOR = fit_anchor(
    [[0, 0, 0]], [[11.3, 47.9]], "EPSG:4326", 1.0, azimuth=np.radians(30.0), azimuth_accuracy=1.0
)
MARKS = {
    (3.0, 40.0): (255, 0, 0),
    (-6.0, 10.0): (0, 0, 255),
}  # colour of a square of 2 m about a place in the lane
BOX = -20.0, 20.0, -5.0, 60.0
EAST, NORTH = transform_lonlat([11.3, 47.9], "EPSG:32632")


def write(path, crs="EPSG:32632", kind="rgb", west=-100.0, dtype="uint8", driver="GTiff"):
    """A map of 200 m x 200 m in pixels of 0.25 m, green but for the marks."""
    size = 800
    pixel = 0.25
    transform = rasterio.transform.from_origin(EAST + west, NORTH + 100.0, pixel, pixel)
    number = np.ones((size, size), np.uint8)
    for index, (x, y) in enumerate(MARKS, 2):
        east, north = transform_lonlat(ANCHOR.to_geodetic([x, y, 0.0])[:2], "EPSG:32632")
        column = (east - EAST - west) / pixel
        row = (NORTH + 100.0 - north) / pixel
        number[int(row) - 4 : int(row) + 5, int(column) - 4 : int(column) + 5] = index
    colours = np.array([(0, 0, 0), (0, 200, 0), *MARKS.values()], np.uint8)
    bands = colours[number].transpose(2, 0, 1) if kind == "rgb" else number[None]
    about = {
        "driver": driver,
        "width": size,
        "height": size,
        "count": len(bands),
        "dtype": dtype,
        "crs": crs,
    }
    if kind == "palette":
        about["photometric"] = "palette"
    with rasterio.open(path, "w", transform=transform, **about) as file:
        file.write(bands.astype(dtype))
        if kind == "palette":
            file.write_colormap(1, {k: (*map(int, one), 255) for k, one in enumerate(colours)})
    return path


def drawn(path, **more):
    picture = np.asarray(Image.open(io.BytesIO(map_backdrop(path, TIE, BOX, **more))))
    assert picture.shape[2] == 4
    return picture


@pytest.mark.parametrize(("suffix", "driver"), [(".mbtiles", "MBTiles"), (".gpkg", "GPKG")])
def test_tiles_are_read_as_well(suffix, driver, tmp_path):
    write(tmp_path / "m.tif")
    rasterio.shutil.copy(tmp_path / "m.tif", tmp_path / f"m{suffix}", driver=driver)
    picture = drawn(tmp_path / f"m{suffix}", most=325).astype(int)
    for (x, y), colour in MARKS.items():
        pixel = picture[int((BOX[3] - y) / 0.2), int((x - BOX[0]) / 0.2), :3]
        assert (
            np.abs(pixel - colour).max() < 90
        )  # tiles have pixels of their own, and are compressed


@pytest.mark.parametrize("kind", ["rgb", "palette"])
def test_marks_lie_where_they_are_in_the_lane(kind, tmp_path):
    picture = drawn(write(tmp_path / "m.tif", kind=kind), most=650)
    assert picture.shape[:2] == (650, 400)
    for (x, y), colour in MARKS.items():
        rows, columns = np.nonzero((picture[..., :3] == colour).all(axis=2))
        assert rows.size == pytest.approx(22.5**2, rel=0.1)  # 2.25 m in pixels of 10 cm
        assert BOX[0] + 0.1 * (columns.mean() + 0.5) == pytest.approx(x, abs=0.15)
        assert BOX[3] - 0.1 * (rows.mean() + 0.5) == pytest.approx(y, abs=0.15)
    assert (picture[..., 3] == 255).all()


def test_one_band_is_grey_and_the_end_of_the_map_is_clear(tmp_path):
    picture = drawn(write(tmp_path / "m.tif", kind="grey", west=0.0), most=200)
    known = picture[..., 3] == 255
    assert 0.3 < known.mean() < 0.9
    assert (picture[known][:, 0] == picture[known][:, 2]).all()
    assert (picture[..., 3][~known] == 0).all()


@pytest.mark.slow("draws a map for every case")
def test_a_long_lane_is_as_sharp_whichever_way_it_lies(tmp_path):
    """Stripes of 8 m across the lane; a fourth band that is not opacity changes nothing."""
    for azimuth in (0.0, 60.0, 90.0):
        turn = np.radians(azimuth)
        transform = rasterio.transform.from_origin(EAST - 600, NORTH + 600, 0.5, 0.5)
        east = (np.arange(2400) - 1199.5) * 0.5
        north = (1199.5 - np.arange(2400)[:, None]) * 0.5
        stripes = (np.floor((east * np.sin(turn) + north * np.cos(turn)) / 8) % 2 * 255).astype(
            np.uint8
        )
        about = {
            "driver": "GTiff",
            "width": 2400,
            "height": 2400,
            "count": 4,
            "dtype": "uint8",
            "crs": "EPSG:32632",
        }
        about |= {"photometric": "rgb", "alpha": "no"}
        with rasterio.open(tmp_path / "s.tif", "w", transform=transform, **about) as file:
            file.write(np.stack([stripes] * 3 + [np.full_like(stripes, 30)]))
        tie = TIE | {"azimuth": azimuth + 1.7}  # the grid's convergence here, about
        picture = np.asarray(
            Image.open(io.BytesIO(map_backdrop(tmp_path / "s.tif", tie, (-10.0, 10.0, 0.0, 500.0))))
        )
        line = picture[:, picture.shape[1] // 2, 0].astype(int)
        assert np.count_nonzero(np.diff(line > 127)) == pytest.approx(500 / 8, abs=4)
        assert (picture[..., 3] == 255).all()


def test_few_pixels_are_means_of_many(tmp_path):
    """Of a mark that is smaller than a pixel of the picture something is left."""
    picture = drawn(write(tmp_path / "m.tif"), most=20).astype(int)
    assert 20 < picture[..., 0].max() < 255


@pytest.mark.slow("draws a map for every case")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"crs": None}, "must tell its reference system"),
        ({"dtype": "float32"}, "8 bits, got float32"),
        ({"west": 5000.0}, "must lie below the lane"),
    ],
)
def test_what_cannot_be_drawn_is_told(options, words, tmp_path):
    path = write(tmp_path / "m.tif", **options)
    with pytest.raises(ValueError, match=rf"map .*m\.tif: .*{words}"):
        drawn(path)


def test_other_files_are_refused(tmp_path):
    """A virtual raster may lead anywhere, over the network as well."""
    write(tmp_path / "m.tif")
    (tmp_path / "m.vrt").write_text(
        '<VRTDataset rasterXSize="9" rasterYSize="9"><VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
        f"<SourceFilename>{tmp_path / 'm.tif'}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    (tmp_path / "bad.tif").write_bytes(b"II*\x00" + b"\xff" * 100)
    (tmp_path / "hidden.tif").write_bytes((tmp_path / "m.vrt").read_bytes())
    for name in ("m.vrt", "bad.tif", "hidden.tif"):
        with pytest.raises(ValueError, match=name):
            drawn(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        drawn(tmp_path / "none.tif")
