"""Nominal frequencies of antennas: by a table of models or a unit, never by digits alone."""

import pytest

from flgpr.formats import gpr_run, read_gpr
from flgpr_exchange.gpr.antennas import antenna_frequency
from io_gpr import write_dzt, write_mala
from io_recordings import COUNTS, notes_with


@pytest.mark.parametrize(
    ("maker", "name", "megahertz"),
    [
        ("GSSI", "SS MINI #338\n", 1600),
        ("GSSI", "SS MINI #577\n", 1600),
        ("GSSI", "4105NR", 2000),
        ("GSSI", "GSSI 2.3GHz", 2300),
        ("GSSI", "2,6 GHz", 2600),
        ("GSSI", "400MHz", 400),
        ("GSSI", "50400S", 400),
        ("GSSI", "5103A", 400),
        ("GSSI", "1.5/1.6GHz", 1500),
        ("GSSI", "HS1.6", None),
        ("GSSI", "3200MLF", None),
        ("GSSI", "serial 512", None),
        ("GSSI", "", None),
        ("MALÅ", "500_shielded_x", 500),
        ("MALÅ", "GX450 HDR (v.1)", 450),
        ("MALÅ", "CO700", 700),
        ("MALÅ", "Ground Explorer GX80", 80),
        ("MALÅ", "GX80 and GX450", None),
        ("MALÅ", "HDR 450", None),
        ("MALÅ", "100 MHz RTA", 100),
        ("MALÅ", "1.6 GHz", 1600),
        ("MALÅ", "250", 250),
        ("MALÅ", "X3M no. 500", None),
        ("ImpulseRadar", "CO4080", None),
        ("ImpulseRadar", "400 MHz", 400),
    ],
)
def test_an_antenna_is_known_by_a_table_or_a_unit_and_by_no_digits(maker, name, megahertz):
    assert antenna_frequency(name, maker) == (None if megahertz is None else megahertz * 1e6)


def test_how_an_antenna_is_known_is_told(tmp_path):
    model = read_gpr(write_dzt(tmp_path / "a.dzt", COUNTS[:, None], names=("4105NR",)))
    assert notes_with(model, "antenna '4105NR' is one of 2000 MHz, by the table of models")
    number = read_gpr(write_mala(tmp_path / "d.rd3", COUNTS, ANTENNAS="500_shielded_x"))
    assert notes_with(number, "is one of 500 MHz, by the number that its name begins with")
    none = read_gpr(write_mala(tmp_path / "c.rd3", COUNTS, ANTENNAS=""))
    assert notes_with(none, "the header names no antenna: its frequency is unknown")
    unknown = read_gpr(write_mala(tmp_path / "b.rd3", COUNTS, ANTENNAS="prototype 7"))
    assert unknown.frequencies == (None,)
    assert notes_with(unknown, "antenna 'prototype 7' is in no table of models")
    assert any("by the sampling" in note for note in gpr_run(unknown).attrs["import_notes"])
