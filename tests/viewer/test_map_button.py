"""The map that a result's page hands over."""

import io
import zipfile

import pytest

from flgpr.commands.exports import map_bytes

pytestmark = pytest.mark.slow("a browser draws every page")

ANCHOR = 'crs = "EPSG:4326"\naccuracy = 0.02\nazimuth_deg = 30.0\nazimuth_accuracy_deg = 0.5\n'
POINT = "[[point]]\nlane = [0.0, 0.0]\nlongitude = 11.0\nlatitude = 48.0\n"


@pytest.fixture
def anchor(tmp_path):
    (tmp_path / "anchor.toml").write_text(ANCHOR + POINT)
    return tmp_path / "anchor.toml"


def test_one_click_saves_the_map_of_an_anchored_result(demo, anchor, serving, watch):
    pytest.importorskip("pyogrio")
    pytest.importorskip("rasterio")
    with serving([demo[0].folder], anchor=anchor, make_map=map_bytes) as viewer:
        one = watch(viewer)
        name, data = one.saved("#export-map")
        one.close()
    assert name == "flgpr-map.zip"
    with zipfile.ZipFile(io.BytesIO(data)) as bundle:
        names = {path.rpartition("/")[2] for path in bundle.namelist()}
    assert names == {
        "alarms.gpkg",
        "lane.gpkg",
        "lane.qgs",
        "objects.gpkg",
        "run-view.tif",
        "truth.gpkg",
    }


def test_a_result_without_a_place_has_no_map(demo, anchor, serving, watch):
    for options in ({"make_map": map_bytes}, {"anchor": anchor}):
        with serving([demo[0].folder], **options) as viewer:
            one = watch(viewer)
            one.page.click("#export-menu summary")
            assert one.page.locator("#export-map").is_hidden()
            one.close()


def test_what_stands_against_the_map_is_told(demo, anchor, serving, watch):
    def refuse(folder, tie, score):
        assert (folder, tie, score) == (demo[0].folder.resolve(), anchor, None)
        raise ImportError("rasterio is needed for this")

    with serving([demo[0].folder], anchor=anchor, make_map=refuse) as viewer:
        one = watch(viewer)
        one.page.click("#export-menu summary")
        one.page.click("#export-map")
        one.page.wait_for_selector("#message:not([hidden])")
        assert one.text("#message") == "rasterio is needed for this"
        one.errors.clear()  # the browser's own line on the answer 400
        one.close()
