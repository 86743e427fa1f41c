"""Finished steps of a study on disk: the same inputs have the same key and are not computed again."""

import numpy as np
import pytest

from flgpr_papers.kit.cache import key_of, read_arrays, read_or_make, write_arrays

pytestmark = pytest.mark.slow("studies of papers")


def test_a_key_stands_for_all_that_a_result_comes_from():
    assert key_of({"a": 1, "b": 2}, "x") == key_of({"b": 2, "a": 1}, "x")
    assert len({key_of({"a": 1}), key_of({"a": 2}), key_of({"a": 1}, "x")}) == 3
    assert len(key_of("anything")) == 12


def test_a_record_is_made_once(tmp_path):
    calls = []

    def make():
        calls.append(1)
        return {"value": [1.5, None]}

    path = tmp_path / "folder" / "record.json"
    assert read_or_make(path, make) == read_or_make(path, make) == {"value": [1.5, None]}
    assert len(calls) == 1


def test_arrays_are_read_back_bit_by_bit(tmp_path):
    arrays = {"complex": np.array([1 + 2j, np.nan], np.complex64), "names": np.arange(3)}
    write_arrays(tmp_path / "folder" / "arrays.bundle", arrays)
    again = read_arrays(tmp_path / "folder" / "arrays.bundle")
    assert again.keys() == arrays.keys()
    for name, values in arrays.items():
        assert again[name].dtype == values.dtype
        np.testing.assert_array_equal(again[name], values)
