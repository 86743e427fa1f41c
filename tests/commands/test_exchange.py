import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from flgpr.chain.detection import Detection
from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.commands import exporting as exchange
from flgpr.commands.app import app
from flgpr.commands.imports import import_cphd, import_mapped
from flgpr.geo.anchor import read_anchor
from flgpr.results.description import describe_run
from flgpr.results.result import write_result
from flgpr.store import open_run, sample_lane, save_run
from io_geodesy import LANE, distance, on_the_ellipsoid
from scans_mapping import TIME, line_mapping
from take import UP, take_text


def anchor_text():
    points = [
        f"[[point]]\nlane = [{x}, {y}]\nlongitude = {lon!r}\nlatitude = {lat!r}\nheight = 0.0\n"
        for (x, y, _), (lon, lat) in zip(
            LANE.tolist(), on_the_ellipsoid(LANE).tolist(), strict=True
        )
    ]
    return 'crs = "EPSG:4326"\naccuracy = 0.02\n' + "".join(points)


@pytest.fixture(scope="module")
def anchor(tmp_path_factory):
    path = tmp_path_factory.mktemp("anchor") / "anchor.toml"
    path.write_text(anchor_text())
    return path


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return written(tmp_path_factory.mktemp("result") / "demo")


def written(folder, **told):
    """Write a result as the demo recipe would, of three alarms and what the run told besides."""
    alarms = pd.DataFrame(
        {
            "alarm_id": ["a", "b", "c"],
            "x": [0.1, -0.7, 1.1],
            "y": [3.0, 3.5, 4.2],
            "confidence": [9.0, 4.0, 2.5],
        }
    )
    x = np.arange(-1.5, 1.51, 0.1)
    y = np.arange(2.0, 5.01, 0.1)
    view = xr.DataArray(
        np.random.default_rng(0).random((1, 1, y.size, x.size), np.float32),
        dims=("polarization", "subband", "y", "x"),
        coords={
            "polarization": ["HH"],
            "subband": ["F1"],
            "y": y,
            "x": x,
            "looks": (("y", "x"), np.ones((31, 31))),
        },
    )
    text = recipe_text("demo")
    lane = parse_recipe(text, "demo").lane.lane()
    run = describe_run(open_run(sample_lane() / "run.zarr")) | told
    detection = Detection("main", "as it stands", alarms, view, {})
    return write_result(folder, [detection], text, lane, run)


def test_a_result_of_a_tied_run_has_alarms_on_the_earth(anchor, tmp_path):
    """RFC 7946: longitude first, WGS 84; what lies in the lane alone is no GeoJSON."""
    tie = read_anchor(anchor)
    home = written(tmp_path / "tied", georeference=tie.georeference())
    told = json.loads((home / "alarms.geojson").read_text())
    assert not (home / "alarms.json").exists()
    for feature, (x, y) in zip(
        told["features"], [(0.1, 3.0), (-0.7, 3.5), (1.1, 4.2)], strict=True
    ):
        lon, lat = feature["geometry"]["coordinates"][:2]
        lane = tie.from_geodetic([lon, lat, tie.to_geodetic([x, y, 0.0])[2]])
        np.testing.assert_allclose(lane[:2], (x, y), atol=1e-3)
        assert (feature["properties"]["lane_x"], feature["properties"]["lane_y"]) == (x, y)
    assert told["flgpr"]["statement"].startswith("Evidence points of a radar")
    bare = written(tmp_path / "bare")
    assert json.loads((bare / "alarms.json").read_text())["flgpr_frame"].startswith("lane frame")
    assert not list(bare.rglob("*.geojson"))


def test_alarms_leave_as_evidence_points(result, anchor, tmp_path):
    exchange.export_result(
        result, tmp_path / "a.geojson", "geojson", anchor, time="2026-11-21T10:00:00Z"
    )
    told = json.loads((tmp_path / "a.geojson").read_text())
    alarms = pd.read_csv(result / "alarms.csv")
    assert len(told["features"]) == len(alarms) > 0
    first = told["features"][0]
    assert first["geometry"]["type"] == "Point"
    assert first["properties"]["nature"] == "evidence point"
    for name in ("confidence", "crs", "time", "processing_id", "anchor_sigma"):
        assert first["properties"][name]
    got = np.array([f["geometry"]["coordinates"][:2] for f in told["features"]])
    want = on_the_ellipsoid(np.column_stack([alarms["x"], alarms["y"], 0 * alarms["x"]]))
    assert distance(got, want).max() < 0.01
    with pytest.raises(FileExistsError):
        exchange.export_result(result, tmp_path / "a.geojson", "geojson", anchor)


def test_every_format_is_written(result, anchor, tmp_path):
    for name in ("kml", "csv"):
        assert (
            exchange.export_result(result, tmp_path / f"a.{name}", name, anchor).stat().st_size
            > 100
        )
    pytest.importorskip("rasterio")
    pytest.importorskip("pyogrio")
    pytest.importorskip("geopandas")
    for name in ("gpkg", "geotiff"):
        assert (
            exchange.export_result(result, tmp_path / f"a.{name}", name, anchor).stat().st_size
            > 100
        )
    with pytest.raises(ValueError, match="to must be one of"):
        exchange.export_result(result, tmp_path / "a.shp", "shp", anchor)
    with pytest.raises(ValueError, match="detection must be one of main"):
        exchange.export_result(result, tmp_path / "b.csv", "csv", anchor, detection="best")


def test_a_result_that_knows_its_place_needs_no_anchor(anchor, tmp_path):
    pytest.importorskip("geopandas")
    here = written(tmp_path / "here", georeference=read_anchor(anchor).georeference())
    for name in exchange.TABLE_FORMATS:
        assert exchange.export_result(here, tmp_path / f"a.{name}", name).stat().st_size > 100
    assert '"anchor_sigma_m":null' in (tmp_path / "a.geojson").read_text().replace(" ", "")
    with pytest.raises(ValueError, match="georeference must have longitude"):
        exchange.export_result(
            written(tmp_path / "there", georeference="EPSG:4326"), tmp_path / "b.csv", "csv"
        )


def test_truth_is_exported_from_its_file(anchor, tmp_path):
    exchange.export_table(sample_lane() / "truth.csv", tmp_path / "t.csv", "csv", anchor, "truth")
    table = pd.read_csv(tmp_path / "t.csv")
    assert set(table["nature"]) == {"emplaced target"}
    assert table["processing_id"][0].startswith("sha256:")


def test_run_to_cphd_and_back(small_run, anchor, tmp_path):
    pytest.importorskip("sarkit")
    save_run(small_run, tmp_path / "a.zarr")
    exchange.export_run(tmp_path / "a.zarr", tmp_path / "a.cphd", anchor)
    import_cphd(tmp_path / "a.cphd", tmp_path / "b.zarr")
    back = open_run(tmp_path / "b.zarr").load()
    np.testing.assert_allclose(back["signal"].values, small_run["signal"].values, rtol=1e-6)
    assert back.drop_vars("signal").identical(small_run.drop_vars("signal"))
    with pytest.raises(
        ValueError, match=r"a\.zarr: nothing tells where its lane lies; an anchor is needed"
    ):
        exchange.export_run(tmp_path / "a.zarr", tmp_path / "c.cphd")
    placed = small_run.assign_attrs(georeference=read_anchor(anchor).georeference())
    save_run(placed, tmp_path / "placed.zarr")
    assert exchange.export_run(tmp_path / "placed.zarr", tmp_path / "c.cphd").stat().st_size > 100


MAPPING = line_mapping("a.npz", TIME, tones="values = [1.0, 1.1, 1.2]")


def test_import_with_a_track_or_a_survey(tmp_path):
    np.savez(tmp_path / "a.npz", s=np.ones((3, 3), complex), t=np.array([5.0, 6.0, 7.0]))
    (tmp_path / "m.toml").write_text(MAPPING)
    fixes = "time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n0,0,0,2,0,0,0\n100,0,200,2,0,0,0\n"
    (tmp_path / "t.csv").write_text(fixes)
    import_mapped(
        tmp_path / "m.toml",
        tmp_path / "r.zarr",
        track=tmp_path / "t.csv",
        clock_offset=10.0,
        lever_arm=(0, -1, 0.5),
    )
    run = open_run(tmp_path / "r.zarr")
    np.testing.assert_allclose(run["pose"].values[:, 1], [31, 33, 35])
    np.testing.assert_allclose(run["pose"].values[:, 2], 1.5)
    assert (tmp_path / "r-track.csv").is_file()
    (tmp_path / "s.csv").write_text(
        "x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n" + "0,1,2,0,0,0\n" * 2
    )
    with pytest.raises(ValueError, match="pose"):
        import_mapped(tmp_path / "m.toml", tmp_path / "q.zarr", survey=tmp_path / "s.csv")
    assert not (tmp_path / "q.zarr").exists()
    (tmp_path / "s.csv").write_text(
        "x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n" + "0,1,2,0,0,0\n" * 3
    )
    track = (tmp_path / "r-track.csv").read_bytes()
    with pytest.raises(FileExistsError):
        import_mapped(tmp_path / "m.toml", tmp_path / "r.zarr", survey=tmp_path / "s.csv")
    with pytest.raises(FileExistsError):
        import_mapped(tmp_path / "m.toml", tmp_path / "r.zarr", track=tmp_path / "t.csv")
    assert (tmp_path / "r-track.csv").read_bytes() == track


def imported(*arguments):
    return CliRunner().invoke(app, ["import", "mapped", *map(str, arguments)])


def test_what_an_import_writes_is_a_track_for_the_next(tmp_path):
    np.savez(tmp_path / "a.npz", s=np.ones((3, 3), complex), t=np.array([5.0, 6.0, 7.0]))
    (tmp_path / "m.toml").write_text(MAPPING)
    rows = ("0;0,5;0;2;0;0;0", "6;;;2;0;0;0", "6,5;0,5;13;2;0;0;0", "9;0;1;2;0;0;0")
    (tmp_path / "t.csv").write_text(
        "\n".join(["time_s;x_m;y_m;z_m;heading_deg;pitch_deg;roll_deg", *rows]) + "\n"
    )
    mapping = tmp_path / "m.toml"
    refused = imported(mapping, "-o", tmp_path / "r.zarr", "--track", tmp_path / "t.csv")
    assert refused.exit_code == 2
    assert "max_gap = 1 s, got none for 6.5 s" in refused.output
    first = imported(
        mapping, "-o", tmp_path / "r.zarr", "--track", tmp_path / "t.csv", "--max-gap", "7"
    )
    assert "1 of 4 fixes of the track not finite, bridged" in first.output
    assert (
        imported(mapping, "-o", tmp_path / "s.zarr", "--track", tmp_path / "r-track.csv").exit_code
        == 0
    )
    runs = [open_run(tmp_path / f"{name}.zarr") for name in "rs"]
    np.testing.assert_array_equal(runs[0]["pose"], runs[1]["pose"])


def test_a_take_of_motion_capture_by_command(tmp_path):
    np.savez(tmp_path / "a.npz", s=np.ones((3, 3), complex), t=np.array([0.5, 1.0, 2.0]))
    (tmp_path / "m.toml").write_text(MAPPING)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    lane = np.array([[0, 0, 1.5], [0, 1, 1.5], [0, 2, 1.5]])
    (tmp_path / "take.csv").write_text(take_text([0.0, 1.0, 2.0], 1000 * lane @ UP, still))
    files = (
        tmp_path / "m.toml",
        "-o",
        tmp_path / "r.zarr",
        "--track",
        tmp_path / "take.csv",
        "--body",
        "Cart",
    )
    assert "axes must say" in imported(*files).output
    assert imported(*files, "--axes", "x,-z,y").exit_code == 0
    want = [[0, 0.5, 1.5, 0, 0, 0], [0, 1, 1.5, 0, 0, 0], [0, 2, 1.5, 0, 0, 0]]
    np.testing.assert_allclose(open_run(tmp_path / "r.zarr")["pose"].values, want, atol=1e-6)


def test_an_anchored_import_remembers_where_its_lane_lies(anchor, tmp_path):
    """What the viewer's cursor shows is where the anchor's points were surveyed."""
    np.savez(tmp_path / "a.npz", s=np.ones((3, 3), complex), t=np.array([5.0, 6.0, 7.0]))
    (tmp_path / "m.toml").write_text(MAPPING)
    (tmp_path / "s.csv").write_text(
        "x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n" + "0,1,2,0,0,0\n" * 3
    )
    files = {"survey": tmp_path / "s.csv", "anchor": anchor}
    import_mapped(tmp_path / "m.toml", tmp_path / "r.zarr", **files)
    run = open_run(tmp_path / "r.zarr")
    tied = run.attrs["georeference"]
    origin, ahead = on_the_ellipsoid(np.array([[0.0, 0.0, 0.0], [0.0, 50.0, 0.0]]))
    assert (tied["longitude"], tied["latitude"]) == pytest.approx(tuple(origin), abs=1e-8)
    east, north = (ahead - origin) * [111_320 * np.cos(np.radians(origin[1])), 111_200]
    assert np.degrees(np.arctan2(east, north)) % 360 == pytest.approx(
        tied["azimuth"] % 360, abs=0.3
    )
    assert describe_run(run)["georeference"] == tied
