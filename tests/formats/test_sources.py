"""Values that the entries of a mapping stand for."""

import numpy as np
import pytest

from flgpr.formats.mapping import Positions, Quantity
from flgpr.formats.sources import Sources, plausible, real


@pytest.fixture
def sources(tmp_path):
    """Two files of scans."""
    paths = [tmp_path / "a_0.npz", tmp_path / "a_1.npz"]
    for number, path in enumerate(paths):
        np.savez(
            path,
            t=np.arange(3.0) + 3 * number,
            f=np.array([1.0, 2.0]),
            table=np.arange(6.0).reshape(3, 2) + 10 * number,
            name=np.array(["x"]),
        )
    return Sources({"data": paths}, "scan", 10_000)


def test_what_is_joined_follows_and_the_rest_must_be_the_same(sources):
    time = Quantity(variable="t", unit="ms")
    np.testing.assert_allclose(sources.vector(time, "time", "time", "scan"), 1e-3 * np.arange(6))
    tones = Quantity(variable="f", unit="GHz")
    np.testing.assert_allclose(sources.vector(tones, "frequency", "frequency"), [1e9, 2e9])
    with pytest.raises(ValueError, match=r"a_0\.npz and 1 more: time must be the same in all 2"):
        sources.vector(time, "time", "time", "pair")


def test_clocks_may_begin_at_zero_and_columns_are_taken(sources):
    column = Quantity(variable="table", column=1, unit="s", zero_first=True)
    found = sources.vector(column, "time", "time", "scan")
    np.testing.assert_array_equal(found, [0, 2, 4, 10, 12, 14])
    wrong = Quantity(variable="table", column=2, unit="s")
    with pytest.raises(ValueError, match=r"time\.column must be a column .*, got 2 for shape"):
        sources.vector(wrong, "time", "time", "scan")


def test_a_span_needs_a_count(sources):
    span = Quantity(span=(1.0, 2.0), unit="GHz")
    np.testing.assert_allclose(
        sources.vector(span, "frequency", "frequency", count=3), [1e9, 1.5e9, 2e9]
    )
    with pytest.raises(ValueError, match="frequency must be a variable or values"):
        sources.vector(span, "frequency", "frequency")


def test_files_variables_and_kinds_are_named(sources):
    with pytest.raises(ValueError, match="signal: file must be one of data, got 'poses'"):
        sources.arrays("poses", "t", "signal")
    with pytest.raises(ValueError, match=r"variable must be one of .*, got 'none'"):
        sources.arrays("data", "none", "signal")
    with pytest.raises(ValueError, match="name must hold numbers, got <U1"):
        sources.arrays("data", "name", "signal")


def test_the_limit_is_that_of_all_files_together(sources):
    sources.arrays("data", "table", "signal")  # each file is small enough
    sources.limit = 60  # bytes: one table has 48
    with pytest.raises(ValueError, match="table of 2 files must hold at most 6e-08 GB"):
        sources.arrays("data", "table", "signal")


def test_numbers_that_no_instrument_records_are_refused():
    plausible(np.array([0.0, 1e29, np.nan]), "signal")
    for size in (1e31, 1e-31):
        with pytest.raises(
            ValueError, match=r"signal must lie between .*: is the byte order wrong"
        ):
            plausible(np.array([size]), "signal")
    with pytest.raises(ValueError, match="time must be real numbers, got complex128"):
        real(np.array([1j]), "time")
    assert real(np.array([1], np.int16), "time").dtype == np.float64


def test_three_positions_of_three_numbers_are_told_to_be_rows(tmp_path):
    path = tmp_path / "a.npz"
    square = np.arange(9.0).reshape(3, 3)
    np.savez(path, square=square, wide=np.arange(12.0).reshape(3, 4))
    sources = Sources({"data": [path]}, "scan", 10_000)
    rows = sources.points(Positions(variable="square", unit="m"), "antenna_position", "pair")
    np.testing.assert_array_equal(rows, square)
    assert ["antenna_position is 3 x 3: a row is taken" in one for one in sources.notes] == [True]
    columns = sources.points(Positions(variable="wide", unit="m"), "antenna_position", "pair")
    assert columns.shape == (4, 3)
    assert len(sources.notes) == 1
