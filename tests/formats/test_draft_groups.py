"""Files of one measurement in groups of alike names."""

import numpy as np
import pytest

from flgpr.formats import explain_files
from flgpr.formats.arrays import LIMIT
from flgpr.formats.draft_arrays import group_files


def test_files_that_do_not_belong_together_are_refused(tmp_path):
    np.savez(tmp_path / "a_1.npz", one=np.ones(3))
    np.savez(tmp_path / "a_2.npz", other=np.ones(3))
    with pytest.raises(
        ValueError,
        match=r"files of one kind must hold the same arrays, got other beside one of a_1\.npz",
    ):
        explain_files([tmp_path / "a_1.npz", tmp_path / "a_2.npz"])
    np.save(tmp_path / "b.npy", np.arange(3.0))
    with pytest.raises(ValueError, match="one of the files must hold a signal"):
        explain_files([tmp_path / "b.npy", tmp_path / "a_1.npz"])


def test_names_that_differ_by_numbers_alone_are_one_group_in_their_order(tmp_path):
    for name in ("scan_10", "scan_9", "other"):
        np.save(tmp_path / f"{name}.npy", np.arange(3.0))
    paths = [tmp_path / f"{name}.npy" for name in ("scan_10", "other", "scan_9")]
    scans, other = group_files(paths, LIMIT)
    assert [path.name for path in scans.paths] == ["scan_9.npy", "scan_10.npy"]
    assert (scans.key, other.key) == ("scan", "other")


def test_a_key_is_free_and_never_that_of_the_data(tmp_path):
    (tmp_path / "sub").mkdir()
    paths = [tmp_path / "data.npy", tmp_path / "sub" / "data.npy", tmp_path / "12.npy"]
    for path in paths:
        np.save(path, np.arange(3.0))
    assert [group.key for group in group_files(paths, LIMIT)] == ["data_", "data__", "file"]


def test_columns_of_text_are_kept_beside_the_numbers(tmp_path):
    path = tmp_path / "list.csv"
    path.write_text("kind;x\ntx;0.5\nrx;1.5\n")
    (group,) = group_files([path], LIMIT)
    assert group.texts == {"kind": ["tx", "rx"]}
