"""Files of one measurement in groups of alike names."""

import numpy as np
import pytest

from flgpr.formats import explain_files


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
