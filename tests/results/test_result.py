"""The result folder: what is written is read back, files are added, damage is refused."""

import numpy as np
import pytest
import xarray as xr

from flgpr.results.manifest import MANIFEST, ResultError, read_result_manifest
from flgpr.results.result import add_files, are_settled, check_free, read_result, thinned
from small_results import LANE, small_result


def view(rows=7, columns=3):
    values = np.arange(rows * columns, dtype=np.float32).reshape(1, 1, rows, columns)
    coords = {
        "polarization": ["HH"],
        "subband": ["low"],
        "y": np.arange(rows) * 0.5,
        "x": np.arange(columns) * 0.25,
    }
    return xr.DataArray(values, dims=tuple(coords), coords=coords, name="run_view")


def test_a_thinned_view_keeps_the_largest_of_its_rows():
    full = view()
    few = thinned(full, 3)
    np.testing.assert_array_equal(few.values[0, 0, :, 0], [6.0, 15.0, 18.0])
    assert few["y"].values.tolist() == [0.5, 2.0, 3.0]
    assert thinned(full, 1) is full


def test_what_is_written_is_read_back(tmp_path):
    folder = small_result(tmp_path / "result")
    result = read_result(folder)
    (detection,) = result.detections
    assert (result.lane, result.recipe.name) == (LANE, "wang2007")
    assert detection.alarms["alarm_id"].tolist() == ["a", "b", "c"]
    assert detection.features["C_HH_F1"].tolist() == [9.0, 4.0, 2.5]
    assert detection.view.dtype == np.float32
    assert result.model() is None


def test_added_files_change_no_identity(tmp_path):
    folder = small_result(tmp_path / "result")
    before = read_result_manifest(folder)
    add_files(folder, {"report.html": "<p>page</p>", "notes/a.txt": b"a"})
    add_files(folder, {"report.html": "<p>other</p>"})
    after = read_result_manifest(folder)
    assert after["identity"] == before["identity"]
    assert sorted(after["added"]) == ["notes/a.txt", "report.html"]
    assert are_settled(folder)
    assert (folder / "report.html").read_text() == "<p>other</p>"
    assert len(read_result(folder).detections) == 1


def test_a_changed_table_is_refused(tmp_path):
    folder = small_result(tmp_path / "result")
    table = folder / "alarms.csv"
    table.write_text(table.read_text().replace("9", "8", 1))
    with pytest.raises(ResultError, match=r"alarms\.csv"):
        read_result(folder)


def test_a_result_replaces_a_result_and_nothing_else(tmp_path):
    folder = small_result(tmp_path / "result")
    assert check_free(folder) == folder
    (folder / MANIFEST).unlink()
    with pytest.raises(FileExistsError):
        check_free(folder)
