"""Units of arrays: stated, by names, and guessed by sizes."""

import numpy as np
import pytest

from flgpr.formats.arrays import ArrayFile, ArrayInfo
from flgpr.formats.draft_arrays import SMALL, is_fast_time, small_values, unit_of, unit_suffix


def file_of(**arrays):
    """Make an opened file of arrays in memory."""
    infos = {
        name: ArrayInfo(name, values.shape, str(values.dtype)) for name, values in arrays.items()
    }
    return ArrayFile("a.npz", "arrays", infos, arrays.__getitem__)


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
    assert unit_of(opened, ArrayInfo("a", (2,), "float64", stated), usual) == unit


def test_a_stated_unit_of_another_kind_is_not_taken():
    opened = file_of(a=np.ones(2))
    assert unit_of(opened, ArrayInfo("a", (2,), "float64", "kg"), "m") == "m?"


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
    assert unit_of(opened, opened.arrays[name], usual) == unit


def test_times_of_samples_are_known_by_unit_or_size():
    opened = file_of(t_ns=np.array([1e9]), short=np.array([0.0, 5e-8]), clock=np.array([0.0, 9.0]))
    assert is_fast_time(opened, opened.arrays["t_ns"])
    assert is_fast_time(opened, opened.arrays["short"])
    assert not is_fast_time(opened, opened.arrays["clock"])


def test_large_and_damaged_arrays_are_not_read():
    def read(name):
        raise ValueError(name)

    infos = {"a": ArrayInfo("a", (2,), "f8"), "b": ArrayInfo("b", (SMALL + 1,), "f8")}
    opened = ArrayFile("a.h5", "arrays", infos, read)
    assert small_values(opened, infos["a"]) is None
    assert small_values(opened, infos["b"]) is None
    assert unit_of(opened, infos["a"], "Hz") == "GHz?"
