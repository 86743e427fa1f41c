"""Units of arrays: stated, by names, and guessed by sizes."""

import numpy as np
import pytest

from flgpr.formats.arrays import ArrayFile, ArrayInfo
from flgpr.formats.draft_arrays import SMALL, ArraySource, FileGroup, small_values, unit_suffix


def file_of(**arrays):
    """Make an opened file of arrays in memory."""
    infos = {
        name: ArrayInfo(name, values.shape, str(values.dtype)) for name, values in arrays.items()
    }
    return ArrayFile("a.npz", "arrays", infos, arrays.__getitem__)


def source(opened, info):
    """Make an array of a group of that file alone."""
    return ArraySource(FileGroup("data", [], opened), info)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("t_ns", "ns"),
        ("radar/Freq_GHz", "GHz"),
        ("pos.x_mm", "mm"),
        ("ns", ""),  # the whole name is no ending
        ("fade_in", ""),  # a word, not inches
        ("rate_h", ""),
        ("field", ""),
    ],
)
def test_a_unit_may_end_a_name(name, unit):
    assert unit_suffix(ArrayInfo(name, (3,), "float64")) == unit


@pytest.mark.parametrize(
    ("stated", "usual", "unit"),
    [("m", "m", "m"), ("meters", "m", "m"), ("Feet", "m", "ft"), ("degrees", "rad", "deg")],
)
def test_what_a_file_states_is_no_guess(stated, usual, unit):
    opened = file_of(a=np.ones(2))
    assert source(opened, ArrayInfo("a", (2,), "float64", stated)).unit(usual) == unit


def test_a_stated_unit_of_another_kind_is_not_taken():
    opened = file_of(a=np.ones(2))
    assert source(opened, ArrayInfo("a", (2,), "float64", "kg")).unit("m") == "m?"


@pytest.mark.parametrize(
    ("name", "usual", "largest", "unit"),
    [
        ("f", "Hz", 3e9, "Hz?"),
        ("f", "Hz", 1e6, "Hz?"),
        ("f", "Hz", 3000.0, "MHz?"),
        ("f", "Hz", 99.0, "GHz?"),
        ("t", "ns", 50.0, "ns?"),
        ("t", "ns", 5e-8, "s?"),
        ("x", "m", 2.0, "m?"),
        ("x_ft", "m", 2.0, "ft"),
    ],
)
def test_a_size_gives_a_guess_with_a_question_mark(name, usual, largest, unit):
    opened = file_of(**{name: np.array([0.0, largest])})
    assert source(opened, opened.arrays[name]).unit(usual) == unit


def test_times_of_samples_are_known_by_unit_or_size():
    opened = file_of(t_ns=np.array([1e9]), short=np.array([0.0, 5e-8]), clock=np.array([0.0, 9.0]))
    assert source(opened, opened.arrays["t_ns"]).is_fast_time()
    assert source(opened, opened.arrays["short"]).is_fast_time()
    assert not source(opened, opened.arrays["clock"]).is_fast_time()


def test_large_and_damaged_arrays_are_not_read():
    def read(name):
        raise ValueError(name)

    infos = {"a": ArrayInfo("a", (2,), "f8"), "b": ArrayInfo("b", (SMALL + 1,), "f8")}
    opened = ArrayFile("a.h5", "arrays", infos, read)
    assert small_values(opened, infos["a"]) is None
    assert small_values(opened, infos["b"]) is None
    assert source(opened, infos["a"]).unit("Hz") == "GHz?"
