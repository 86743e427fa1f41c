"""Imports by a mapping, with tracks, surveys and anchors."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from alone import needs
from flgpr.commands.app import app
from flgpr.commands.importing import check_parent_folder, store_with_tables
from flgpr.commands.imports import import_mapped
from flgpr.results.description import describe_run
from flgpr.store import open_run, read_table
from io_geodesy import on_the_ellipsoid
from scans_mapping import TIME, line_mapping
from take import UP, take_text

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
    assert "--max-gap = 1 s, got none for 6.5 s" in refused.output
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


@needs("flgpr_exchange")
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


def test_an_output_needs_a_folder(tmp_path):
    assert check_parent_folder(str(tmp_path / "a.zarr")) == tmp_path / "a.zarr"
    with pytest.raises(FileNotFoundError, match=r"the folder of the output must exist, got .*none"):
        check_parent_folder(tmp_path / "none" / "a.zarr")


def test_tables_lie_beside_the_run_and_are_not_written_again(small_run, tmp_path):
    truth = pd.DataFrame(
        {"target_id": ["a"], "kind": ["metal"], "x": [0.5], "y": [3.0], "depth": [0.1]}
    )
    store = tmp_path / "new" / "lane.zarr"
    written = store_with_tables(small_run, store, {"truth": truth, "objects": None})
    assert written == [store, store.with_name("lane-truth.csv")]
    assert store.with_name("lane-truth.json").is_file()
    pd.testing.assert_frame_equal(read_table(written[1], "truth"), truth, check_like=True)
    assert store_with_tables(small_run, store, {"truth": truth}) == [store]
    with pytest.raises(FileExistsError):
        store_with_tables(small_run.assign_attrs(site="road"), store, {"truth": truth})


@pytest.mark.parametrize(
    ("name", "value"),
    [("clock_offset", 1.0), ("lever_arm", (0.0, 0.1, 0.0)), ("latency", 0.1), ("max_gap", 2.0),
     ("axes", "x,-z,y"), ("body", "cart")],
)  # fmt: skip
def test_options_of_a_track_are_not_dropped_without_one(name, value, tmp_path):
    with pytest.raises(ValueError, match=f"{name}: these are of `track`"):
        import_mapped(tmp_path / "m.toml", tmp_path / "q.zarr", **{name: value})


def test_an_import_replaces_no_table_that_somebody_made_beside_the_run(tmp_path, small_run):
    surveyed = tmp_path / "lane-truth.csv"
    surveyed.write_text("by hand\n")
    truth = pd.DataFrame({"target_id": ["m"], "x": [0.0], "y": [1.0], "depth": [0.1]})
    with pytest.raises(FileExistsError, match=r"lane-truth\.csv, which holds something else"):
        store_with_tables(small_run, tmp_path / "lane.zarr", {"truth": truth})
    assert surveyed.read_text() == "by hand\n"
    assert not (tmp_path / "lane.zarr").exists()
