"""Lanes on Earth from a table of surveyed points, checked by a geodesic of its own."""

import json

import numpy as np
import pytest
from pyproj import Geod, Transformer
from typer.testing import CliRunner

from flgpr.commands.anchor import anchor
from flgpr.commands.app import app
from flgpr.geo import read_anchor
from flgpr.store import open_run, save_run

AZIMUTH = 30.0
LON = 15.0
LAT = 48.75
LANE = "x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = 60.0\n"


def on_earth(x, y):
    """Longitude and latitude of a place in the lane, along the geodesic."""
    lon, lat, _ = Geod(ellps="WGS84").fwd(
        LON, LAT, AZIMUTH + np.degrees(np.arctan2(x, y)), np.hypot(x, y)
    )
    return lon, lat


@pytest.fixture
def survey(tmp_path):
    """Three points surveyed in UTM, and the lane's file."""
    to_map = Transformer.from_crs("EPSG:4326", "EPSG:32633", always_xy=True)
    rows = ["lane_x_m,lane_y_m,easting_m,northing_m,height_m"]
    for x, y in ((0.0, 0.0), (0.0, 50.0), (3.0, 25.0)):
        east, north = to_map.transform(*on_earth(x, y))
        rows.append(f"{x},{y},{east:.5f},{north:.5f},0.0")
    (tmp_path / "points.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "lane.toml").write_text(LANE)
    return tmp_path


def flgpr(*words):
    return CliRunner().invoke(app, ["anchor", *map(str, words)])


def test_surveyed_points_become_an_anchor_a_tied_run_and_an_outline(survey, small_run):
    save_run(small_run, survey / "run.zarr")
    told = flgpr(
        survey / "points.csv", "--crs", "EPSG:32633", "--accuracy", 0.02, "--write", survey / "anchor.toml",
        "--lane", survey / "lane.toml", "--outline", survey / "lane.geojson",
        "--run", survey / "run.zarr", "-o", survey / "tied.zarr", "--json",
    )  # fmt: skip
    assert told.exit_code == 0, told.stderr
    found = json.loads(told.stdout)
    assert found["azimuth"] == pytest.approx(AZIMUTH, abs=1e-3)
    geod = Geod(ellps="WGS84")
    for corner in found["corners"]:
        lon, lat = on_earth(corner["x"], corner["y"])
        assert geod.inv(lon, lat, corner["longitude"], corner["latitude"])[2] < 0.002
    # Three points of 2 cm: their mean is known to 2/sqrt(3) cm, the far corners less well.
    assert found["sigma_at_points_m"] == pytest.approx(0.02 / np.sqrt(3))
    assert found["corners"][2]["sigma_m"] > found["sigma_at_points_m"]
    tied = open_run(survey / "tied.zarr")
    assert tied.attrs["georeference"] == pytest.approx(
        read_anchor(survey / "anchor.toml").georeference()
    )
    np.testing.assert_array_equal(tied["signal"].values, small_run["signal"].values)
    outline = json.loads((survey / "lane.geojson").read_text())
    kinds = [feature["geometry"]["type"] for feature in outline["features"]]
    assert kinds == ["LineString", "Point", "Point", "Point", "Point"]
    ring = outline["features"][0]["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    assert geod.inv(*ring[0], *on_earth(-1.5, 0.0))[2] < 0.002


def test_the_words_tell_place_misfit_and_uncertainty(survey):
    told = flgpr(
        survey / "points.csv", "--crs", "EPSG:32633", "--accuracy", 0.02, "--write", survey / "anchor.toml",
        "--lane", survey / "lane.toml",
    )  # fmt: skip
    assert told.exit_code == 0
    assert "+y points 30.000 degrees from true north" in told.stdout
    assert "3 points in EPSG:32633" in told.stdout
    assert "uncertainty at their mean 12 mm" in told.stdout
    assert told.stdout.count("corner (") == 4
    assert flgpr(survey / "anchor.toml").exit_code == 0


def test_faults_are_told_and_nothing_is_written(survey):
    def refused(match, *words):
        told = flgpr(*words)
        assert told.exit_code == 2
        assert match in told.stderr
        assert not (survey / "a.toml").exists()

    points = survey / "points.csv"
    crs = ("--crs", "EPSG:32633")
    accuracy = ("--accuracy", 0.02)
    write = ("--write", survey / "a.toml")
    refused("needs --crs, --accuracy and --write", points, *crs)
    refused("crs must be a reference system", points, "--crs", "EPSG:1", *accuracy, *write)
    refused(
        "an outline needs a lane", points, *crs, *accuracy, *write, "--outline", survey / "o.json"
    )
    lines = points.read_text().splitlines()
    swapped = survey / "swapped.csv"
    swapped.write_text(
        "\n".join([lines[0], lines[1], lines[3].replace("3.0,25.0", "0.0,50.0"), lines[2]]) + "\n"
    )
    refused("swapped.csv: anchor points must fit one another", swapped, *crs, *accuracy, *write)
    swapped.write_text("lane_x_m,lane_y_m,easting_m\n1,2,3\n")
    refused("must have lane_x_m and lane_y_m, and either", swapped, *crs, *accuracy, *write)


def test_options_of_a_table_of_points_do_nothing_in_silence_beside_an_anchor(survey):
    options = {"crs": "EPSG:32633", "accuracy": 0.02, "write": survey / "anchor.toml"}
    anchor(survey / "points.csv", **options)
    for name, value in options.items():
        with pytest.raises(ValueError, match="crs, accuracy and write go with a CSV"):
            anchor(survey / "anchor.toml", **{name: value})
