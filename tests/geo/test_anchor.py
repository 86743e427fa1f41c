import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flgpr.geo.anchor import check_same_place, fit_anchor, own_anchor, read_anchor
from io_geodesy import AZIMUTH, LANE, distance, on_the_ellipsoid


@pytest.fixture
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)


def test_places_agree_with_geodesics(anchor):
    points = np.array([[0, 0, 0], [5.0, 13.0, 0], [-3.0, 60.0, 0], [1.0, 120.0, 0]])
    assert distance(anchor.to_geodetic(points), on_the_ellipsoid(points)).max() < 1e-3
    assert anchor.azimuth == pytest.approx(AZIMUTH, abs=1e-5)


def test_a_map_projection_does_not_stretch_the_lane(anchor):
    from pyproj import Transformer

    lonlat = on_the_ellipsoid(LANE)
    utm = np.stack(
        Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True).transform(*lonlat.T),
        axis=-1,
    )
    mapped = fit_anchor(LANE, utm, "EPSG:32632", 0.02, [0.0] * 4)
    far = np.array([[0.0, 1000.0, 0]])
    assert distance(mapped.to_geodetic(far), anchor.to_geodetic(far)).max() < 1e-6
    assert anchor.utm() == "EPSG:32632"


@pytest.mark.parametrize("height", [1200.0, None])
def test_the_reference_of_a_run_says_where_its_anchor_says_far_along_the_lane(height):
    """North at the lane's origin is another than at surveyed points five kilometres away."""
    at = fit_anchor([[0.0, 5000.0, 0.0]], [[15.0, 60.0]], "EPSG:4326", 0.02, [height], math.pi / 2)
    reference = at.georeference()
    assert ("height" in reference) == (height is not None)
    there = np.array([[0.0, 5000.0, 0.0], [2.0, 5100.0, 0.0]])
    own = own_anchor(reference)
    assert distance(own.to_geodetic(there), at.to_geodetic(there)).max() < 0.01
    assert own.heights_known == at.heights_known


@given(st.floats(-179, 179), st.floats(-80, 80), st.floats(-math.pi, math.pi), st.floats(-50, 3000))
def test_there_and_back(lon, lat, azimuth, height):
    anchor = fit_anchor(
        [[1.0, 2.0, 0.3]],
        [[lon, lat]],
        "EPSG:4326",
        0.02,
        [height],
        azimuth=azimuth,
        azimuth_accuracy=0.001,
    )
    points = np.array([[3.0, -5.0, 0.2], [100.0, 400.0, 1.0]])
    np.testing.assert_allclose(anchor.from_geodetic(anchor.to_geodetic(points)), points, atol=1e-6)
    np.testing.assert_allclose(
        anchor.from_geocentric(anchor.to_geocentric(points)), points, atol=1e-8
    )
    np.testing.assert_allclose(anchor.to_geodetic([1.0, 2.0, 0.3])[2], height, atol=1e-6)


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_the_uncertainty_is_that_of_repeated_surveys():
    rng = np.random.default_rng(4)
    sigma = 0.02
    place = np.array([1.0, 150.0, 0.0])
    found = []
    true = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", sigma, [0.0] * 4)
    metre = np.array([1 / (111_320 * math.cos(math.radians(47.9))), 1 / 111_200])
    for _ in range(400):
        noisy = on_the_ellipsoid(LANE) + rng.normal(scale=sigma, size=(4, 2)) * metre
        found.append(
            fit_anchor(LANE, noisy, "EPSG:4326", sigma, [0.0] * 4).to_geodetic(place)[:2] / metre
        )
    scatter = np.sqrt(np.linalg.eigvalsh(np.cov(np.transpose(found))).max())
    # 400 samples: the standard deviation is known to 3.5 %.
    assert scatter == pytest.approx(float(true.uncertainty(place[0], place[1])), rel=0.1)
    assert true.uncertainty(0.0, 30.0) == pytest.approx(sigma / 2)


def test_a_given_direction_widens_with_distance():
    one = fit_anchor(
        [[0, 0, 0]], [[11.3, 47.9]], "EPSG:4326", 0.05, azimuth=0.0, azimuth_accuracy=0.01
    )
    assert one.uncertainty(0, 100) == pytest.approx(math.hypot(0.05, 1.0))


FILE = """
crs = "EPSG:32632"
accuracy = 0.02
[[point]]
lane = [0.0, 0.0]
easting = 500000.0
northing = 5300000.0
height = 520.0
[[point]]
lane = [0.0, 50.0]
easting = 500000.0
northing = 5300049.98
height = 520.0
"""


def test_an_anchor_file(tmp_path):
    (tmp_path / "a.toml").write_text(FILE)
    anchor = read_anchor(tmp_path / "a.toml")
    assert anchor.count == 2
    assert anchor.heights_known
    assert anchor.crs == "EPSG:32632"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("EPSG:32632", "EPSG:99999999", "reference system"),
        ("EPSG:32632", "EPSG:4326", "longitude and latitude"),
        ("EPSG:32632", "EPSG:4978", "geographic or projected"),
        ("EPSG:32632", "EPSG:2263", "metres or degrees"),
        ("accuracy = 0.02", "", "accuracy"),
        ("5300049.98", "5300051.0", "fit one another"),
        ("[0.0, 50.0]", "[0.0, 0.0]", "lie apart"),
        ("northing = 5300000.0\n", "", "give easting and northing"),
        ("easting = 500000.0\nnorthing = 5300000.0", "easting = nan\nnorthing = 1.0", "finite"),
        ("accuracy", "acuracy", "accuracy"),
        ("crs = ", "crs : ", "TOML|Expected"),
        (
            "easting = 500000.0\nnorthing = 5300000.0",
            "longitude = 9.0\nlatitude = 47.8",
            "must all have longitude and latitude as the first, point 1 has others",
        ),
    ],
)
def test_anchor_files_that_are_wrong(tmp_path, old, new, words):
    assert old in FILE
    (tmp_path / "a.toml").write_text(FILE.replace(old, new, 1))
    with pytest.raises(ValueError, match=words):
        read_anchor(tmp_path / "a.toml")


def test_no_anchor_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_anchor(tmp_path / "a.toml")


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3460"])
@pytest.mark.parametrize("azimuth", [90.0, 0.0, 215.0])
@pytest.mark.parametrize("start", [179.9998, 180.0, -179.9999])
def test_a_lane_across_180_degrees(crs, azimuth, start):
    from pyproj import Geod, Transformer

    geod = Geod(ellps="WGS84")
    end = geod.fwd(start, -17.0, azimuth, 60.0)
    lonlat = np.array([[start, -17.0], end[:2]])
    to = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    position = np.stack(to.transform(*lonlat.T), axis=-1)
    anchor = fit_anchor([[0, 0, 0], [0, 60.0, 0]], position, crs, 0.05, [100.0, 100.0])
    middle = geod.fwd(start, -17.0, azimuth, 30.0)
    right = geod.fwd(*middle[:2], azimuth + 90, 1.5)
    found = anchor.to_geodetic([[1.5, 30.0, 0.0]])
    assert geod.inv(found[0, 0], found[0, 1], right[0], right[1])[2] < 1e-3
    assert found[0, 2] == pytest.approx(100, abs=1e-2)
    assert anchor.residuals[0] < 1e-3
    assert abs(anchor.origin[0]) <= 180
    assert anchor.utm() in ("EPSG:32701", "EPSG:32760")


@pytest.fixture
def notes(caplog):
    caplog.set_level("INFO", "flgpr.notes")
    return caplog


def test_points_outside_of_the_area_of_a_system_are_told(notes):
    points = [[540_000.0, 5_500_000.0], [540_000.0, 5_500_050.0]]
    fit_anchor([[0, 0, 0], [0, 50.0, 0]], points, "EPSG:32633", 0.5)
    assert not notes.messages
    points = [[1_540_000.0, 5_500_000.0], [1_540_000.0, 5_500_050.0]]
    with pytest.raises(ValueError, match="must fit one another"):  # its scale is none there
        fit_anchor([[0, 0, 0], [0, 50.0, 0]], points, "EPSG:32633", 0.05)
    (note,) = notes.messages
    assert "degrees outside of the area of use of EPSG:32633" in note
    assert "is it the right system?" in note


def test_a_system_whose_area_passes_180_degrees(notes):
    points = [[179.9, -17.0], [-179.9, -17.0]]
    fit_anchor([[0, 0, 0], [0, 21_292.0, 0]], points, "EPSG:4748", 50.0)
    assert not notes.messages


@pytest.mark.parametrize("code", [2053, 5513])
@pytest.mark.parametrize("negative", [False, True])
def test_axes_to_west_and_south(code, negative, notes):
    """A westing as such, or as a negative easting: the lane lies where its points are."""
    from pyproj import Geod, Transformer

    lon, lat = (28.6, -26.0) if code == 2053 else (15.0, 50.0)
    end = Geod(ellps="WGS84").fwd(lon, lat, 30.0, 50.0)
    lonlat = np.array([[lon, lat], end[:2]])
    position = np.stack(
        Transformer.from_crs("EPSG:4326", f"EPSG:{code}", always_xy=True).transform(*lonlat.T),
        axis=-1,
    )
    if code == 5513:
        position = position[:, ::-1]  # its first axis points to the south
    position = -position if negative else position
    lane = [[0, 0, 0], [0, 50.0, 0]]
    anchor = fit_anchor(lane, position, f"EPSG:{code}", 0.1)
    assert distance(anchor.to_geodetic([[0, 0, 0]])[:, :2], lonlat[:1]).max() < 0.01
    assert math.degrees(anchor.azimuth) == pytest.approx(30.0, abs=0.05)
    assert any("the axes of EPSG" in note for note in notes.messages)


HOME = {"longitude": 8.5, "latitude": 49.0, "azimuth": 30.0}


@pytest.mark.parametrize(
    ("other", "apart"),
    [({"latitude": 49.1}, r"11,1\d\d"), ({"azimuth": 40.0}, "17"), ({"azimuth": -150.0}, "200")],
)
def test_a_lane_elsewhere_on_the_earth_is_not_the_same(other, apart):
    with pytest.raises(
        ValueError, match=rf"b.zarr: must be a run of the same lane.* lane {apart} m"
    ):
        check_same_place(HOME, HOME | other, "b.zarr")


@pytest.mark.parametrize("other", [None, {}, "here", {"latitude": 49.00005}, {"height": 300.0}])
def test_a_lane_a_few_metres_off_or_of_no_place_may_be_the_same(other):
    check_same_place(HOME, HOME | other if isinstance(other, dict) and other else other, "b.zarr")
    check_same_place(None, HOME, "b.zarr")


def test_points_closer_than_their_accuracy_fix_no_direction():
    """An accuracy in mm would let points that are swapped pass, in any direction."""
    points = [[500_000.0, 5_400_000.0], [500_000.0, 5_400_050.0]]
    with pytest.raises(
        ValueError, match=r"five times the accuracy of 20 m, got a spread of 35\.4 m"
    ):
        fit_anchor([[0, 0, 0], [0, 50.0, 0]], points, "EPSG:32633", 20.0)
    with pytest.raises(ValueError, match=r"must lie apart .* got a spread of 0 m"):
        fit_anchor([[0, 50.0, 0], [0, 50.0, 0]], points, "EPSG:32633", 0.02)
    assert fit_anchor([[0, 0, 0], [0, 50.0, 0]], points, "EPSG:32633", 5.0).sigma == 5.0
