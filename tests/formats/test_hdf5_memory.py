"""A text of an HDF5 file that claims gigabytes takes none: the file is named as damaged."""

import resource
import struct

import h5py
import pytest

from flgpr.formats.arrays import open_arrays

TITLE = "a title of some words"


def claiming(path, size):
    """Write a small file whose title claims so many bytes."""
    with h5py.File(path, "w") as file:
        file.attrs["Title"] = TITLE
        file["x"] = range(10)
    content = bytearray(path.read_bytes())
    heap = content.find(b"GCOL")
    at = content.find(struct.pack("<I", len(TITLE)))
    assert 0 < at < heap, "the attribute states the length, the heap holds the text"
    content[at : at + 4] = struct.pack("<I", size)
    path.write_bytes(content)
    return path


def test_a_title_that_claims_four_gigabytes_is_refused_without_them(tmp_path):
    path = claiming(tmp_path / "a.h5", 0xFFFFFFF0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"a\.h5.*'Title' of '/' claims more memory than 2 GiB"):
        open_arrays(path)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 500_000, "kB"
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert children < 2_100_000, "kB"


def test_a_title_of_the_true_length_is_read(tmp_path):
    path = claiming(tmp_path / "a.h5", len(TITLE))
    assert "x" in str(open_arrays(path))
