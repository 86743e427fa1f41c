"""Alarms as rows for IMSMA: what is known is in its column, and the rest is empty."""

import pandas as pd
import pytest

from flgpr.geo.anchor import read_anchor
from flgpr.geo.points import STATEMENT, georeference
from flgpr_exchange.maps.imsma import IMSMA_COLUMNS, STATUS, imsma_table

ANCHOR = """
crs = "EPSG:32633"
accuracy = 0.02
[[point]]
lane = [0.0, 0.0]
easting = 500000.0
northing = 5400000.0
[[point]]
lane = [0.0, 50.0]
easting = 500000.0
northing = 5400050.0
"""


@pytest.fixture
def anchor(tmp_path):
    (tmp_path / "anchor.toml").write_text(ANCHOR)
    return read_anchor(tmp_path / "anchor.toml")


def points(anchor, **columns):
    table = pd.DataFrame({"x": [0.0, 1.0], "y": [10.0, 20.0], "confidence": [2.5, 1.0]})
    table = table.assign(**columns)
    return georeference(table, anchor, "alarms", "sha256:ab", "2026-05-04T09:30:00Z")


def test_a_row_has_place_time_status_and_source(anchor):
    table = imsma_table(points(anchor), "Test team")
    assert list(table) == list(IMSMA_COLUMNS)
    # UTM zone 33 has its meridian, 15° E, at an easting of 500 km.
    assert table["longitude"][0] == pytest.approx(15.0, abs=1e-7)
    assert 48.6 < table["latitude"][0] < 48.9
    assert table["longitude"][1] > table["longitude"][0]
    assert set(table["coordinate_system"]) == {"EPSG:4326"}
    assert table["date"].str.startswith("2026-05-04T09:30:00").all()
    assert set(table["status"]) == {STATUS}
    assert set(table["organisation"]) == {"Test team"}
    assert table["source"].str.startswith("sha256:ab, flgpr ").all()
    assert set(table["remarks"]) == {STATEMENT}
    assert table["confidence"].tolist() == [2.5, 1.0]
    assert table["id"].tolist() == ["alarm-1", "alarm-2"]


def test_what_a_radar_does_not_know_stays_empty_unless_the_list_has_it(anchor):
    table = imsma_table(points(anchor))
    for name in ("device_category", "device_model", "device_condition", "organisation"):
        assert set(table[name]) == {""}, name
    assert table["depth_m"].isna().all()

    stated = points(
        anchor, kind=["metal", None], depth=[0.05, 0.1], alarm_id=["a", "b"], lane=["north", ""]
    )
    table = imsma_table(stated)
    assert table["device_category"].tolist() == ["metal", ""]
    assert table["depth_m"].tolist() == [0.05, 0.1]
    assert table["id"].tolist() == ["north/a", "b"]
