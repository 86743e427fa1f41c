"""Which array of a file is the measured field, and which names its polarizations."""

import numpy as np
import pytest

from flgpr.formats.draft_arrays import find_signal, labels_of
from formats.test_draft_units import file_of


def found(**arrays):
    field = find_signal(file_of(**arrays))
    return (None, None) if field is None else (field.info.name, field.imaginary)


def test_the_largest_complex_array_goes_before_larger_real_ones():
    small = np.ones((2, 3), complex)
    large = np.ones((4, 5), np.complex64)
    assert found(a=small, b=large, c=np.ones((50, 50))) == ("b", None)


@pytest.mark.parametrize(
    ("real", "imaginary"),
    [("s_real", "s_imag"), ("data_re", "data_im"), ("ch_i", "ch_q"), ("S_Real", "s_imag")],
)
def test_parts_that_lie_apart_are_found_by_their_names(real, imaginary):
    part = np.ones((3, 4))
    assert found(**{"map": np.ones((9, 9)), real: part, imaginary: part}) == (real, imaginary)
    assert found(**{real: part, imaginary: np.ones((3, 5))}) == (imaginary, None)


@pytest.mark.parametrize(
    ("magnitude", "phase"),
    [("S21(DB)", "S21(DEG)"), ("S21[dB]", "S21[deg]"), ("s21_db", "s21_rad"), ("MAG", "MAG_deg")],
)
def test_magnitudes_and_phases_are_found_by_their_units(magnitude, phase):
    part = np.ones((3, 4))
    field = find_signal(file_of(**{magnitude: part, phase: part, "map": np.ones((9, 9))}))
    assert (field.info.name, field.phase) == (magnitude, phase)
    assert field.unit == ("rad" if phase.endswith("rad") else "deg")


def test_vectors_positions_and_covariances_are_no_field():
    assert found(t=np.ones(9), pos=np.ones((9, 3)), covariance=np.ones((9, 36))) == (None, None)
    assert found(one=np.ones((1, 1), complex)) == (None, None)


def test_labels_are_taken_where_all_are_polarizations():
    sizes = [5, 2, 7]
    assert labels_of(file_of(pol=np.array(["HH", "VV"])), sizes) == ["HH", "VV"]
    assert labels_of(file_of(pol=np.array([b"HV", b"VH"])), sizes) == ["HV", "VH"]
    assert labels_of(file_of(pol=np.array(["HH", "left"])), sizes) == ["HH?"]
    assert labels_of(file_of(pol=np.array(["HH", "HV", "VV"])), sizes) == ["HH?"]
    assert labels_of(file_of(number=np.arange(2)), sizes) == ["HH?"]
