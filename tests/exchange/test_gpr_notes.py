"""Whatever is assumed, replaced or dropped on reading is in the notes."""

import struct

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats import explain_file, gpr_run, read_gpr
from flgpr.store import open_run
from io_gpr import (
    SEPARATION,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)
from io_recordings import (
    ALONG,
    COUNTS,
    LATITUDE,
    LONGITUDE,
    TRACES,
    dt1_at,
    gps_lines,
    notes_with,
    set_dt1_words,
)

ENTRIES = {
    "dt1": ("TIMEZERO AT POINT", "POSITION UNITS", "DATA TYPE"),
    "rd3": ("ANTENNAS", "DISTANCE INTERVAL"),
    "iprb": ("ZERO LEVEL", "DATA VERSION", "ANTENNA"),
}


@pytest.mark.parametrize("kind", ENTRIES)
def test_every_entry_that_is_missing_is_told(kind, tmp_path):
    write, suffix = {
        "dt1": (write_dt1, ".hd"),
        "rd3": (write_mala, ".RAD"),
        "iprb": (write_impulse, ".iprh"),
    }[kind]
    path = write(tmp_path / f"a.{kind}", COUNTS)
    head = path.with_suffix(suffix)
    whole = head.read_text(encoding="utf-8")
    usual = read_gpr(path)
    for entry in ENTRIES[kind]:
        head.write_text(
            "\n".join(line for line in whole.splitlines() if not line.startswith(entry)),
            encoding="utf-8",
        )
        read = read_gpr(path)
        same = read.distance is not None and np.array_equal(read.distance, usual.distance)
        assert set(read.history) - set(usual.history) or not same or entry == "DATA TYPE"


def test_notes_are_in_info_in_the_run_and_on_the_screen(tmp_path):
    places = ALONG.copy()
    places[11] = places[10]
    path = dt1_at(tmp_path / "a.dt1", COUNTS, places)
    note = "1 traces stand where the one before was"
    assert note in "\n".join(explain_file(path).lines)
    store = tmp_path / "a.zarr"
    done = CliRunner().invoke(app, ["import", "gpr", str(path), "-o", str(store)])
    assert note in done.output
    assert any(note in one for one in open_run(store).attrs["import_notes"])
    assert note in CliRunner().invoke(app, ["info", str(store)]).output


def test_positions_and_marks_that_a_run_does_not_keep_are_told(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    path.with_suffix(".dzg").write_text(
        gps_lines([0, 9, 20], LATITUDE[[0, 9, 20]], LONGITUDE[[0, 9, 20]], "dzt")
    )
    notes = gpr_run(read_gpr(path)).attrs["import_notes"]
    assert "3 positions of the satellite receiver are not used: they need an anchor" in notes
    assert "1 marks of the operator are not kept in the run" in notes


def test_what_is_given_in_place_of_the_file_is_in_the_notes(tmp_path):
    read = read_gpr(write_dt1(tmp_path / "a.dt1", COUNTS))
    notes = gpr_run(read, step=0.1, separation=0.5, time_zero=3e-9, window=100e-9).attrs[
        "import_notes"
    ]
    for words in (
        "equal steps of 0.1 m are given",
        "separation 0.5 m is given",
        "time zero 3e-09 s is",
        "time window 1e-07 s",
    ):
        assert any(words in note for note in notes), words
    same = gpr_run(read, separation=SEPARATION).attrs["import_notes"]
    assert not any("given in place" in note for note in same)


@pytest.mark.parametrize("kind", ["dt1", "dzt", "rd3", "iprb", "dt", "sgy"])
def test_traces_beyond_those_that_a_header_tells_are_read_and_counted(kind, tmp_path):
    write = {
        "dt1": lambda path: write_dt1(path, COUNTS, NUMBER_OF_TRACES=10),
        "dzt": lambda path: write_dzt(path, COUNTS[:, None]),
        "rd3": lambda path: write_mala(path, COUNTS, LAST_TRACE=10),
        "iprb": lambda path: write_impulse(path, COUNTS, LAST_TRACE=10),
        "dt": lambda path: write_ids(path, COUNTS, traces=10),
        "sgy": lambda path: write_segy(path, COUNTS),
    }[kind]
    read = read_gpr(write(tmp_path / f"a.{kind}"))
    assert len(read.traces) == TRACES
    told = notes_with(
        read, f"the header tells 10 traces, the file holds {TRACES}, all of which are read"
    )
    assert bool(told) == (kind not in ("dzt", "sgy"))


def test_words_of_the_headers_are_where_they_are_written(tmp_path):
    """The offsets that these tests use are those of the reader."""
    path = set_dt1_words(write_dt1(tmp_path / "a.dt1", COUNTS), "number", range(7, 7 + TRACES))
    assert struct.unpack_from("<f", path.read_bytes())[0] == 7
