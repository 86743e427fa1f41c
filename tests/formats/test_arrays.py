"""Files of named arrays, opened without reading them."""

import numpy as np
import pytest

from flgpr.formats.arrays import ArrayFile, ArrayInfo, open_arrays


def test_an_archive_is_described_before_it_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", big=np.arange(6, dtype=">i2").reshape(2, 3), label=np.array("x"))
    opened = open_arrays(tmp_path / "a.npz")
    assert opened.kind == "NumPy archive"
    assert opened.arrays["big"].shape == (2, 3)
    values = opened.read("big")
    np.testing.assert_array_equal(values, np.arange(6).reshape(2, 3))
    assert values.dtype.isnative
    assert opened.read("label") == "x"


@pytest.mark.parametrize(("width", "kind"), [("f4", np.complex64), ("f8", np.complex128)])
@pytest.mark.parametrize("names", [("re", "im"), ("real", "imag"), ("R", "I"), ("r", "i")])
def test_records_of_two_parts_are_complex(width, kind, names, tmp_path):
    records = np.zeros(2, dtype=[(name, width) for name in names])
    records[names[0]] = [1, 2]
    records[names[1]] = [3, -4]
    np.save(tmp_path / "a.npy", records)
    opened = open_arrays(tmp_path / "a.npy")
    (name,) = opened.arrays
    values = opened.read(name)
    assert values.dtype == kind
    np.testing.assert_array_equal(values, [1 + 3j, 2 - 4j])


def test_other_records_and_unknown_names_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")]))
    opened = open_arrays(tmp_path / "a.npy")
    (name,) = opened.arrays
    with pytest.raises(ValueError, match="must be of numbers, got a record of x, y, z"):
        opened.read(name)
    with pytest.raises(ValueError, match=f"variable must be one of {name}, got 'none'"):
        opened.read("none")


def test_the_size_is_checked_before_the_array_is_read(tmp_path):
    def read(name):
        raise AssertionError(name)

    infos = {"a": ArrayInfo("a", (10, 10), "float64")}
    opened = ArrayFile(tmp_path / "a.h5", "HDF5 file", infos, read, limit=799)
    with pytest.raises(ValueError, match=r"a must hold at most 7\.99e-07 GB, got shape \(10, 10\)"):
        opened.read("a")


def test_objects_are_never_read(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"a\.npy"):
        read_first(tmp_path / "a.npy")


def read_first(path):
    """Read the first array of a file."""
    opened = open_arrays(path)
    return opened.read(next(iter(opened.arrays)))
