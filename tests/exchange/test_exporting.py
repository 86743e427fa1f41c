"""Runs, tables and results as files that lie on the Earth."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.commands.export import export
from flgpr.formats.mapped import import_mapped
from flgpr.geo.anchor import read_anchor
from flgpr.method.detection import Detection
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.results.description import describe_run
from flgpr.results.result import write_result
from flgpr.store import open_run, sample_lane, save_run
from flgpr_exchange.commands.imports import import_cphd
from io_geodesy import distance, on_the_ellipsoid


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
    export(result, tmp_path / "a.geojson", "geojson", anchor, time="2026-11-21T10:00:00Z")
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
        export(result, tmp_path / "a.geojson", "geojson", anchor)


def test_every_format_is_written(result, anchor, tmp_path):
    for name in ("kml", "csv"):
        assert export(result, tmp_path / f"a.{name}", name, anchor).stat().st_size > 100
    pytest.importorskip("rasterio")
    pytest.importorskip("pyogrio")
    pytest.importorskip("geopandas")
    for name in ("gpkg", "geotiff"):
        assert export(result, tmp_path / f"a.{name}", name, anchor).stat().st_size > 100
    with pytest.raises(ValueError, match="to must be one of"):
        export(result, tmp_path / "a.shp", "shp", anchor)
    with pytest.raises(ValueError, match="detection must be one of main"):
        export(result, tmp_path / "b.csv", "csv", anchor, detection="best")


def test_a_geotiff_names_the_recipe_and_result_that_it_is_of(result, anchor, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    export(result, tmp_path / "a.tif", "geotiff", anchor)
    manifest = json.loads((result / "manifest.json").read_text())
    with rasterio.open(tmp_path / "a.tif") as file:
        tags = file.tags()
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
    assert tags["flgpr_recipe_sha256"] == manifest["recipe_sha256"]
    assert tags["flgpr_result_identity"] == manifest["identity"]
    assert tags["flgpr_detection"] == "main"


def test_a_run_leaves_as_sigmf_and_comes_back(small_run, anchor, tmp_path):
    run = small_run.assign_attrs(georeference=read_anchor(anchor).georeference())
    save_run(run, tmp_path / "a.zarr")
    folder = export(
        tmp_path / "a.zarr", tmp_path / "out", "sigmf", time="2026-05-04T11:30:00+02:00"
    )
    metadata = json.loads((folder / "out.sigmf-meta").read_text())
    assert metadata["captures"][0]["core:datetime"] == "2026-05-04T09:30:00.000000Z"
    assert len(metadata["captures"][0]["core:geolocation"]["coordinates"]) >= 2
    back = import_mapped(folder / "out.toml").run
    assert back.equals(run)
    for time in ("2026-05-04T09:30:00", "noon"):
        with pytest.raises(ValueError, match="time must be ISO 8601 with a time zone"):
            export(tmp_path / "a.zarr", tmp_path / "b", "sigmf", time=time)


def test_a_result_that_knows_its_place_needs_no_anchor(anchor, tmp_path):
    pytest.importorskip("geopandas")
    here = written(tmp_path / "here", georeference=read_anchor(anchor).georeference())
    for name in ("geojson", "gpkg", "kml", "gpx", "csv"):
        assert export(here, tmp_path / f"a.{name}", name).stat().st_size > 100
    assert '"anchor_sigma_m":null' in (tmp_path / "a.geojson").read_text().replace(" ", "")
    with pytest.raises(ValueError, match="georeference must have longitude"):
        export(written(tmp_path / "there", georeference="EPSG:4326"), tmp_path / "b.csv", "csv")


def test_truth_is_exported_from_its_file(anchor, tmp_path):
    export(sample_lane() / "truth.csv", tmp_path / "t.csv", "csv", anchor, "truth")
    table = pd.read_csv(tmp_path / "t.csv")
    assert set(table["nature"]) == {"emplaced target"}
    assert table["processing_id"][0].startswith("sha256:")


def test_run_to_cphd_and_back(small_run, anchor, tmp_path):
    pytest.importorskip("sarkit")
    save_run(small_run, tmp_path / "a.zarr")
    export(tmp_path / "a.zarr", tmp_path / "a.cphd", "cphd", anchor)
    import_cphd(tmp_path / "a.cphd", tmp_path / "b.zarr")
    back = open_run(tmp_path / "b.zarr").load()
    np.testing.assert_allclose(back["signal"].values, small_run["signal"].values, rtol=1e-6)
    assert back.drop_vars("signal").identical(small_run.drop_vars("signal"))
    with pytest.raises(
        ValueError, match=r"a\.zarr: nothing tells where its lane lies; give an `anchor`"
    ):
        export(tmp_path / "a.zarr", tmp_path / "c.cphd", "cphd")
    placed = small_run.assign_attrs(georeference=read_anchor(anchor).georeference())
    save_run(placed, tmp_path / "placed.zarr")
    assert export(tmp_path / "placed.zarr", tmp_path / "c.cphd", "cphd").stat().st_size > 100


def test_alarms_for_imsma_need_a_place_and_a_time(result, anchor, tmp_path):
    target = tmp_path / "imsma.csv"
    time = "2026-05-04T09:30:00Z"
    with pytest.raises(ValueError, match=r"imsma needs latitude and longitude.*give `anchor`"):
        export(result, target, "imsma", time=time)
    with pytest.raises(ValueError, match="imsma needs the time of the survey"):
        export(result, target, "imsma", anchor)
    assert not target.exists()

    export(result, target, "imsma", anchor, time=time, organisation="=Team")
    assert "'=Team" in target.read_text()  # no formula for a spreadsheet
    table = pd.read_csv(target)
    earth = on_the_ellipsoid(np.array([[0.1, 3.0, 0.0]]))[0]
    assert distance(table[["longitude", "latitude"]].to_numpy()[0], earth) < 0.05
    assert table["id"].tolist() == ["a", "b", "c"]

    alarms = tmp_path / "list.csv"
    alarms.write_text("quer,y,score\n0.1,3.0,9\n")
    listed = tmp_path / "listed.csv"
    export(alarms, listed, "imsma", anchor, time=time, columns="confidence=score")
    assert pd.read_csv(listed)["latitude"][0] == pytest.approx(table["latitude"][0], abs=1e-8)
    truth = tmp_path / "truth.csv"
    truth.write_text("target_id,x,y,kind,depth\na,0.1,3.0,metal,0.05\n")
    with pytest.raises(ValueError, match="must have the columns confidence"):
        export(truth, tmp_path / "no.csv", "imsma", anchor, time=time)


def test_a_list_of_another_kind_names_the_option(anchor, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x,y,confidence\n0.1,1.0,0.9\n")
    with pytest.raises(ValueError, match="it reads as alarms, give `kind` alarms"):
        export(path, tmp_path / "a.geojson", "geojson", anchor)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="truth must have the columns") as told:
        export(path, tmp_path / "a.geojson", "geojson", anchor)
    assert "--kind" not in str(told.value)
    assert "`columns` target_id=NAME says which it is" in str(told.value)
    with pytest.raises(ValueError, match="kind must be one of alarms, truth, objects, got 'mines'"):
        export(path, tmp_path / "a.geojson", "geojson", anchor, kind="mines")


@pytest.mark.parametrize(
    ("to", "of_result", "option", "words"),
    [
        ("kml", True, {"kind": "truth"}, "kind goes with a table of points"),
        ("csv", True, {"columns": "x=foo"}, "columns goes with a table"),
        ("csv", False, {"detection": "variant"}, "detection goes with a result"),
        ("geotiff", True, {"time": "2026-05-04T09:30:00Z"}, "time goes with"),
        ("cphd", False, {"kind": "truth"}, "kind goes with a table of points"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(
    result, anchor, tmp_path, to, of_result, option, words
):
    truth = tmp_path / "T.CSV"
    truth.write_text("target_id,x,y,kind,depth\na,0,1,metal,0\n")
    source = result if of_result else truth
    with pytest.raises(ValueError, match=words):
        export(source, tmp_path / "out", to, anchor, **option)
    assert not (tmp_path / "out").exists()
