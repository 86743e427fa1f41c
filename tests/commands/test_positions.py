"""Anchors, tracks and columns as options name them."""

import pytest

from flgpr.commands.positions import (
    TrackReading,
    needed_anchor,
    read_optional_anchor,
    table_reading,
    tied_run,
    track_of,
)
from flgpr.geo.anchor import read_anchor

REFERENCE = {"longitude": 11.3, "latitude": 47.9, "azimuth": 37.0}


def test_an_anchor_is_read_or_returned_as_it_is(anchor):
    assert read_optional_anchor(None) is None
    tie = read_optional_anchor(anchor)
    assert tie.georeference()["azimuth"] == pytest.approx(37.0, abs=0.01)
    assert read_optional_anchor(tie) is tie


def test_a_file_of_an_anchor_counts_before_the_run_s_own(anchor):
    own = needed_anchor(None, REFERENCE | {"azimuth": 90.0}, "run.zarr")
    assert own.georeference()["azimuth"] == pytest.approx(90.0)
    of_file = needed_anchor(anchor, REFERENCE | {"azimuth": 90.0}, "run.zarr")
    assert of_file.georeference()["azimuth"] == pytest.approx(37.0, abs=0.01)
    with pytest.raises(ValueError, match=r"run\.zarr: nothing tells where its lane lies"):
        needed_anchor(None, None, "run.zarr")


def test_a_run_is_tied_in_a_copy(small_run, anchor):
    assert tied_run(small_run, None) is small_run
    tied = tied_run(small_run, read_anchor(anchor))
    assert set(tied.attrs["georeference"]) == {*REFERENCE, "height"}
    assert tied.attrs["site"] == "yard"
    assert "georeference" not in small_run.attrs


def test_a_table_is_read_as_usual_unless_something_is_named(anchor):
    assert table_reading() is None
    reading = table_reading("x=Rechts, y=Hoch")
    assert reading.columns == {"x": "Rechts", "y": "Hoch"}
    assert reading.anchor is None
    assert table_reading(anchor=anchor).columns == {}
    with pytest.raises(ValueError, match="each name once, between commas, got 'x=a,x=b'"):
        table_reading("x=a,x=b")


def test_a_track_is_csv_or_a_log_that_needs_an_anchor(tmp_path):
    csv = tmp_path / "t.csv"
    csv.write_text(
        "time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n0,0,0,2,90,0,0\n1,1,3,2,0,0,0\n"
    )
    track = track_of(csv, None)
    assert len(track) == 2
    (tmp_path / "t.nmea").write_text("")
    with pytest.raises(
        ValueError, match=r"t\.nmea: a track of a satellite receiver needs an anchor"
    ):
        track_of(tmp_path / "t.nmea", None)
    with pytest.raises(ValueError, match=r"t\.nmea: body and axes are of takes of OptiTrack"):
        track_of(tmp_path / "t.nmea", None, TrackReading(body="radar"))
    with pytest.raises(FileNotFoundError, match="track not found"):
        track_of(tmp_path / "none.csv", None)
