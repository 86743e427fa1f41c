"""Entries of a mapping: what they allow, and errors that name them."""

import pytest

from flgpr.formats.mapping import (
    Index,
    Positions,
    Quantity,
    Variable,
    factor,
    parse_mapping,
    read_mapping,
)

COMPLETE = """
polarization = ["HH"]
signal = {variable = "s", dims = ["scan", "frequency"]}
frequency = {variable = "f", unit = "GHz"}
antenna_position = {values = [[0.0, 0.0, 1.0]], unit = "m"}
pose = {values = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]], unit = "m"}
"""


def test_a_unit_gives_the_factor_to_si_units():
    assert factor("ns", "time", "time.unit") == 1e-9
    with pytest.raises(ValueError, match=r"time\.unit is missing"):
        factor(None, "time", "time.unit")
    with pytest.raises(ValueError, match=r"time\.unit must be one of s, ms, .*, got 'Hz'"):
        factor("Hz", "time", "time.unit")


@pytest.mark.parametrize(
    "sources",
    [{}, {"variable": "f", "values": [1.0]}, {"values": 1.0, "span": (1.0, 2.0)}],
)
def test_a_quantity_has_one_source(sources):
    with pytest.raises(ValueError, match="give one of: variable, values or span"):
        Quantity(unit="Hz", **sources)


def test_positions_are_a_variable_axes_or_values():
    z = Variable(variable="height", column=2)
    for forms in (
        {"variable": "xyz"},
        {"variable": "xy", "z": 1.5},
        {"variable": "xy", "z": z},
        {"x": "e", "y": "n", "z": 0.0},
        {"values": [[0.0, 0.0, 1.0]]},
    ):
        Positions(unit="m", **forms)
    for forms in ({}, {"x": "e", "y": "n"}, {"variable": "xy", "x": 1.0}, {"values": [], "z": 1.0}):
        with pytest.raises(ValueError, match="give one of: variable"):
            Positions(unit="m", **forms)


def test_lists_count_from_0_or_1():
    assert Index(first=1).variable == "table"
    with pytest.raises(ValueError, match="first"):
        Index(first=2)


def test_an_unknown_entry_and_a_guess_are_named():
    with pytest.raises(ValueError, match=r"own: .*signal.*axes"):
        parse_mapping(COMPLETE.replace("dims =", "axes = [], dims ="), "own")
    with pytest.raises(ValueError, match=r"frequency\.unit.*guess, got 'GHz\?'"):
        parse_mapping(COMPLETE.replace('"GHz"', '"GHz?"'))


def test_a_file_is_named_in_its_errors(tmp_path):
    path = tmp_path / "own.toml"
    with pytest.raises(FileNotFoundError, match=r"own\.toml"):
        read_mapping(path)
    path.write_text("signal = 1\n")
    with pytest.raises(ValueError, match=r"own\.toml"):
        read_mapping(path)
