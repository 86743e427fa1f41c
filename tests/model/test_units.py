"""Units that files are written in."""

import math

import pytest

from flgpr.model.units import UNITS


@pytest.mark.parametrize(
    ("kind", "unit", "value", "standard"),
    [
        ("frequency", "GHz", 2.5, 2.5e9),
        ("length", "ft", 10.0, 3.048),
        ("length", "in", 12.0, 0.3048),
        ("length", "um", 5.0, 5e-6),
        ("time", "ns", 3.0, 3e-9),
        ("time", "h", 2.0, 7200.0),
        ("angle", "deg", 180.0, math.pi),
        ("angle", "mrad", 1000.0, 1.0),
    ],
)
def test_a_factor_takes_values_to_si_units(kind, unit, value, standard):
    assert value * UNITS[kind][unit] == pytest.approx(standard, rel=1e-15)


def test_every_kind_has_its_si_unit_and_no_unit_is_of_two_kinds():
    for kind, unit in {"frequency": "Hz", "length": "m", "time": "s", "angle": "rad"}.items():
        assert UNITS[kind][unit] == 1.0
    units = [unit for kind in UNITS.values() for unit in kind]
    assert len(units) == len(set(units))
