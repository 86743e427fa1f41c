"""A result as a project of QGIS: what the project says of its layers, and the layers beside it."""

import itertools
import json
import re
import shutil
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from pyproj import CRS
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.export import export
from flgpr.commands.exports import map_bytes
from flgpr.geo import own_anchor, read_anchor
from flgpr_exchange.maps import qgis
from io_geodesy import distance
from small_results import small_result

pyogrio = pytest.importorskip("pyogrio")
rasterio = pytest.importorskip("rasterio")
ANCHOR = """
crs = "EPSG:4326"
accuracy = 0.02
azimuth_deg = 30.0
azimuth_accuracy_deg = 0.5
[[point]]
lane = [0.0, 0.0]
longitude = 11.0
latitude = 48.0
"""


@pytest.fixture
def anchor(tmp_path):
    (tmp_path / "anchor.toml").write_text(ANCHOR)
    return tmp_path / "anchor.toml"


@pytest.fixture
def unpacked(demo, anchor, tmp_path):
    """A demo's map, exported by the command and unpacked."""
    ran = CliRunner().invoke(
        app,
        [
            "export",
            str(demo[0].folder),
            "--to",
            "qgis",
            "--anchor",
            str(anchor),
            "-o",
            str(tmp_path / "map.zip"),
        ],
    )
    assert ran.exit_code == 0, ran.output
    with zipfile.ZipFile(tmp_path / "map.zip") as bundle:
        bundle.extractall(tmp_path)
    return tmp_path / "map"


def test_the_project_names_layers_that_lie_beside_it(demo, unpacked):
    text = (unpacked / "lane.qgs").read_bytes()
    root = ElementTree.fromstring(text)
    assert text.startswith(b"<!DOCTYPE qgis")
    told = root.findall("./layer-tree-group/layer-tree-layer")
    layers = {one.findtext("id"): one for one in root.findall("./projectlayers/maplayer")}
    assert [one.get("name") for one in told] == ["truth", "alarms", "objects", "lane", "run-view"]
    assert [one.get("id") for one in told] == list(layers)
    for one in told:
        layer = layers[one.get("id")]
        assert one.get("source") == layer.findtext("datasource")
        file, _, name = layer.findtext("datasource").partition("|layername=")
        assert file.startswith("./")
        path = unpacked / file
        assert CRS(layer.findtext("srs/spatialrefsys/wkt")) == CRS(
            layer.findtext("srs/spatialrefsys/authid")
        )
        if layer.get("type") == "vector":
            [(held, geometry)] = pyogrio.list_layers(path).tolist()
            assert (held, geometry) == (name, layer.get("geometry"))
            assert pyogrio.read_info(path)["crs"] == layer.findtext("srs/spatialrefsys/authid")
        else:
            with rasterio.open(path) as raster:
                assert raster.crs.to_string() == layer.findtext("srs/spatialrefsys/authid")
                band = int(layer.find("pipe/rasterrenderer").get("band"))
                index = json.loads((demo[0].folder / "view" / "index.json").read_text())
                assert raster.descriptions[band - 1] == " ".join(index["channel"])
    assert root.findtext("projectCrs/spatialrefsys/authid") == "EPSG:32632"
    box = [
        float(root.findtext(f"mapcanvas/extent/{name}"))
        for name in ("xmin", "ymin", "xmax", "ymax")
    ]
    with rasterio.open(unpacked / "run-view.tif") as raster:
        x, y = raster.transform @ (raster.width / 2, raster.height / 2)
    assert box[0] < x < box[2]
    assert box[1] < y < box[3]
    assert "not hazard areas" in root.findtext("projectMetadata/abstract")


def test_every_alarm_falls_into_a_class_and_every_kind_has_a_symbol(demo, unpacked):
    root = ElementTree.fromstring((unpacked / "lane.qgs").read_bytes())
    graduated = root.find("projectlayers/maplayer/renderer-v2[@type='graduatedSymbol']")
    confidence = pyogrio.read_dataframe(unpacked / "alarms.gpkg")[graduated.get("attr")].to_numpy()
    assert sorted(confidence) == sorted(demo[0].detections[0].alarms["confidence"])
    ranges = [
        (float(one.get("lower")), float(one.get("upper")))
        for one in graduated.findall("ranges/range")
    ]
    assert all(any(low <= value <= high for low, high in ranges) for value in confidence)
    assert all(a[1] == b[0] for a, b in itertools.pairwise(ranges))
    for renderer in root.findall("projectlayers/maplayer/renderer-v2"):
        symbols = {one.get("name") for one in renderer.findall("symbols/symbol")}
        used = {one.get("symbol") for one in renderer.iter() if one.get("symbol") is not None}
        assert symbols == (used or {"0"})
        for layer in renderer.iter("layer"):
            options = {one.get("name"): one.get("value") for one in layer.findall("Option/Option")}
            assert options == {one.get("k"): one.get("v") for one in layer.findall("prop")} != {}
    kinds = set(pyogrio.read_dataframe(unpacked / "truth.gpkg")["kind"])
    categories = root.find(
        "projectlayers/maplayer/renderer-v2[@type='categorizedSymbol']/categories"
    )
    assert {one.get("value") for one in categories} == kinds


def test_the_outline_is_that_of_the_lane(demo, unpacked, anchor):
    [polygon] = pyogrio.read_dataframe(unpacked / "lane.gpkg").geometry
    lane = demo[0].lane
    ring = np.array(polygon.exterior.coords)
    want = read_anchor(anchor).to_geodetic(
        [[lane.x_min, lane.y_min, 0], [lane.x_max, lane.y_max, 0]]
    )
    assert distance(ring[[0, 2]], want[:, :2]).max() < 0.01


@pytest.mark.parametrize("values", [[], [np.nan], [3.0, 3.0], [1.0, np.nan, 2.0]])
def test_few_or_no_confidences_are_drawn_too(values):
    style = qgis.graduated("confidence", values)
    layer = qgis.MapLayer("alarms", "alarms.gpkg", "EPSG:4326", "Point", style)
    root = ElementTree.fromstring(qgis.project("", "", "EPSG:32632", (0, 0, 1, 1), [layer]))
    ranges = root.findall(".//ranges/range")
    assert ranges
    finite = [value for value in values if np.isfinite(value)]
    limits = [(float(one.get("lower")), float(one.get("upper"))) for one in ranges]
    assert all(any(low <= value <= high for low, high in limits) for value in finite)


def test_words_that_xml_does_not_allow_do_not_break_the_project():
    style = qgis.by_kind(["a\x00b", "<&\"'>"], "#102030")
    layer = qgis.MapLayer("truth", "truth.gpkg", "EPSG:4326", "Point", style)
    root = ElementTree.fromstring(
        qgis.project("lane \x07 \ud800 & <x>", "", "EPSG:32632", (0, 0, 1, 1), [layer])
    )
    assert root.findtext("title") == "lane ? ? & <x>"
    assert [one.get("value") for one in root.iter("category")] == ["<&\"'>", "a?b"]


def test_a_run_that_knows_its_place_needs_no_anchor(demo, anchor):
    reference = read_anchor(anchor).georeference()
    point = [[1.0, 5.0, 0.0]]
    there, here = (one.to_geodetic(point) for one in (read_anchor(anchor), own_anchor(reference)))
    assert distance(there[:, :2], here[:, :2]).max() < 1e-3
    assert np.isnan(own_anchor(reference).uncertainty(1.0, 5.0))
    for wrong in (
        {},
        {"latitude": 48.0, "longitude": "east", "azimuth": 0.0},
        {"latitude": np.nan},
    ):
        with pytest.raises(
            ValueError, match="georeference must have longitude, latitude and azimuth"
        ):
            own_anchor(wrong)
    with pytest.raises(ValueError, match="nothing tells where its lane lies; give an `anchor`"):
        map_bytes(demo[0].folder, None, None)


def test_what_is_wrong_is_told_and_nothing_is_written(demo, anchor, tmp_path):
    with pytest.raises(ValueError, match=r"output must end in \.zip, got .*map\.qgz"):
        export(demo[0].folder, tmp_path / "map.qgz", "qgis", anchor)
    (tmp_path / "there.zip").write_text("x")
    with pytest.raises(FileExistsError, match="must not exist"):
        export(demo[0].folder, tmp_path / "there.zip", "qgis", anchor)
    with pytest.raises(ValueError, match="detection must be one of"):
        export(demo[0].folder, tmp_path / "map.zip", "qgis", anchor, detection="other")
    copy = shutil.copytree(demo[0].folder, tmp_path / "copy")
    score = copy / "view" / "score.json"
    text = score.read_text()
    stored = json.loads(text)
    for changed in (
        text.replace('"halo":', '"hallo":', 1),
        text[:-20],
        re.sub(r'"sha256":"\w+"', '"sha256":"00"', text),
        json.dumps([stored]),
    ):
        assert changed != text
        score.write_text(changed)
        with pytest.raises(ValueError, match=r"score\.json"):
            export(copy, tmp_path / "map.zip", "qgis", anchor)
        with pytest.raises(ValueError, match=r"score\.json: .*; run `flgpr.score` again"):
            export(demo[0].folder, tmp_path / "map.zip", "qgis", anchor, score=copy)
    assert not list(tmp_path.glob("*map.zip"))


def test_the_command_reads_the_truth_of_a_score_in_another_folder(demo, anchor, tmp_path):
    score = tmp_path / "score" / "view" / "score.json"
    score.parent.mkdir(parents=True)
    shutil.copy(demo[0].folder / "view" / "score.json", score)

    def run_export(to):
        words = [
            "--anchor",
            str(anchor),
            "--score",
            str(tmp_path / "score"),
            "--to",
            to,
            "-o",
            str(tmp_path / "a.zip"),
        ]
        return CliRunner().invoke(app, ["export", str(demo[0].folder), *words])

    ran = run_export("qgis")
    assert ran.exit_code == 0, ran.output
    (tmp_path / "a.zip").unlink()
    score.write_text("{}")
    for to, told in (("qgis", "run `flgpr score` again"), ("kml", "score goes with qgis")):
        ran = run_export(to)
        assert ran.exit_code == 2
        assert told in ran.stderr
    assert not (tmp_path / "a.zip").exists()


def test_a_result_without_a_score_has_no_truth_in_its_map(anchor, tmp_path):
    folder = small_result(tmp_path / "small")
    assert map_bytes(Path(folder), anchor, None)[:2] == b"PK"
    with zipfile.ZipFile(export(folder, tmp_path / "map.zip", "qgis", anchor)) as bundle:
        names = {"map/alarms.gpkg", "map/lane.gpkg", "map/lane.qgs", "map/run-view.tif"}
        assert set(bundle.namelist()) == names
