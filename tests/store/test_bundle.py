"""Bundles come back bit for bit, and one that was altered anywhere is refused."""

import numpy as np
import pytest

from flgpr.store import Bundle, BundleError, write_bundle

ARRAYS = {
    "complex": np.array([[1 + 2j, -0.5j]], np.complex64),
    "empty": np.zeros((0, 3)),
    "text": np.array(["HH", "VV"]),
    "one": np.array(True),
}


@pytest.fixture
def path(tmp_path):
    write_bundle(tmp_path / "a.bundle", ARRAYS, {"kind": "test", "levels": [1, None]})
    return tmp_path / "a.bundle"


def test_arrays_and_metadata_come_back(path):
    bundle = Bundle(path)
    assert bundle.about == {"kind": "test", "levels": [1, None]}
    assert list(bundle) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert bundle[name].dtype == array.dtype
        np.testing.assert_array_equal(bundle[name], array)


def test_the_head_says_what_the_arrays_take(path):
    sizes = {row["name"]: row["bytes"] for row in Bundle(path).listed()}
    assert sizes == {name: array.nbytes for name, array in ARRAYS.items()}


def test_the_size_of_the_file_is_returned(tmp_path):
    size = write_bundle(tmp_path / "b", ARRAYS)
    assert size == (tmp_path / "b").stat().st_size
    assert [file.name for file in tmp_path.iterdir()] == ["b"]  # no temporary file is left


def test_equal_content_makes_equal_bytes(path, tmp_path):
    write_bundle(tmp_path / "again", ARRAYS, {"levels": [1, None], "kind": "test"})
    assert (tmp_path / "again").read_bytes() == path.read_bytes()


def test_a_flipped_byte_of_an_array_or_its_padding_is_found(path):
    data = bytearray(path.read_bytes())
    start = len(data) - 4 * 64 + 64  # "empty" takes nothing, the others 64 bytes each
    for offset in (start, len(data) - 1):
        altered = bytearray(data)
        altered[offset] ^= 1
        with pytest.raises(BundleError, match="differs from what was written"):
            Bundle(path, bytes(altered)).check()


@pytest.mark.parametrize("cut", [0, 10, 200, -1])
def test_a_file_that_is_cut_is_no_bundle(path, cut):
    with pytest.raises(BundleError, match="not a whole file of arrays"):
        Bundle(path, path.read_bytes()[:cut])


def test_objects_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="a must hold numbers, booleans or text, got object"):
        write_bundle(tmp_path / "c", {"a": np.array([None])})
    assert not list(tmp_path.iterdir())
