"""What the child process that reads untrusted files finds in them."""

import io
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from flgpr.formats import child


@pytest.fixture
def linked(tmp_path):
    """An HDF5 file with an array, a link to another file, and numbers that lie in a third."""
    (tmp_path / "other.bin").write_bytes(bytes(32))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.arange(4.0)
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["own"] = np.arange(3.0)
        file["group/link"] = h5py.ExternalLink("other.h5", "/secret")
        file.create_dataset("raw", (4,), "f8", external=[(str(tmp_path / "other.bin"), 0, 32)])
    return path


def test_parts_that_lie_in_other_files_are_named(linked):
    with h5py.File(linked) as file:
        assert child.parts_elsewhere(file) == {
            "group/link": "it is a link to another file",
            "raw": "its numbers lie in other files: copy them into this one",
        }


def test_a_probe_prints_what_is_not_read_and_nothing_of_a_sound_file(linked, tmp_path, capsys):
    child.probe_hdf5(str(linked))
    lines = capsys.readouterr().out.splitlines()
    assert sorted(line.split("\t")[0] for line in lines) == ["'group/link'", "'raw'"]
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["own"] = np.arange(3.0)
    child.probe_hdf5(str(tmp_path / "b.h5"))
    assert capsys.readouterr().out == ""


def test_the_arrays_of_a_matlab_file_come_one_after_the_other(tmp_path):
    values = {"s": {"re": np.arange(3.0), "flag": np.array([True])}, "name": "lane"}
    savemat(tmp_path / "a.mat", values)
    words = [sys.executable, "-P", child.__file__, "matlab", tmp_path / "a.mat", 10**6, 2**31]
    with open(tmp_path / "out", "wb") as out:
        subprocess.run([str(word) for word in words], stdout=out, check=True, timeout=60)
    content = (tmp_path / "out").read_bytes()
    stream = io.BytesIO(content)
    assert np.load(stream).size == 0  # nothing is passed over
    found = {}
    while stream.tell() < len(content):
        name = str(np.load(stream))
        found[name] = np.load(stream)
    assert found.keys() == {"s.re", "s.flag", "name"}
    np.testing.assert_array_equal(found["s.re"].ravel(), np.arange(3.0))
    assert found["s.flag"].dtype == np.uint8


def test_it_imports_nothing_of_the_package():
    text = Path(child.__file__).read_text(encoding="utf-8")
    assert "import flgpr" not in text
    assert "from flgpr" not in text
