"""Positions of a satellite receiver: what is no place, and what no vehicle reaches, is told."""

import numpy as np
import pytest

from flgpr.formats import explain_file, gpr_run, read_gpr
from flgpr.geo import anchor_from_fixes, fit_anchor
from flgpr_exchange.gpr.positions import cor_fixes, nmea_fixes, settle_fixes
from io_geodesy import LANE, on_the_ellipsoid
from io_gpr import STEP, closed, gga, write_dt1, write_dzt, write_mala
from io_recordings import (
    ALONG,
    COUNTS,
    LATITUDE,
    LONGITUDE,
    TRACES,
    gps_lines,
    notes_with,
    set_dt1_words,
)


def test_a_receiver_without_a_fix_is_told(tmp_path):
    path = tmp_path / "a.dzg"
    path.write_text(gps_lines(range(9), LATITUDE[:9], LONGITUDE[:9], "dzt", quality=0))
    notes = []
    assert len(nmea_fixes(path, TRACES, notes).table) == 0
    assert notes == ["9 of 9 sentences of a.dzg tell no position (the receiver had no fix)"]


@pytest.mark.parametrize(
    ("quality", "words"), [(6, "dead reckoning"), (7, "put in by hand"), (8, "simulated"), (1, "")]
)
def test_positions_that_no_satellite_gave_are_told(quality, words, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    lines = gps_lines([0, 9], LATITUDE[[0, 9]], LONGITUDE[[0, 9]])
    lines += gps_lines([20], LATITUDE[[20]], LONGITUDE[[20]], quality=quality)
    path.with_suffix(".gps").write_text(lines)
    read = read_gpr(path)
    assert read.fixes[:, 0].tolist() == [0, 9, 20]
    told = [f"1 of 3 sentences of a.gps are {words}: they are used"] if words else []
    assert notes_with(read, "sentences of a.gps") == told


def test_zero_north_zero_east_is_no_place(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    lines = gps_lines([0, 10, 20], LATITUDE[[0, 10, 20]], LONGITUDE[[0, 10, 20]], "dzt")
    path.with_suffix(".dzg").write_text(lines + f"$GSSIS,25,-1\n{gga(0, 0, 0, quality=1)}\n")
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], [0, 10, 20])
    assert notes_with(read, "1 of 4 positions left out: 0 N 0 E")


def test_rmc_serves_where_there_is_no_gga(tmp_path):
    path = tmp_path / "a.dzg"
    rmc = closed("$GPRMC,120000.00,A,4700.0000,N,01100.0000,E,0.0,0.0,010120,,")
    path.write_text(f"$GSSIS,3,-1\n{rmc}\n")
    notes = []
    found = nmea_fixes(path, TRACES, notes)
    np.testing.assert_allclose(found.table, [[3, 11, 47, 0]])
    assert "1 of 1 positions tell no height: 0 m is taken" in notes
    assert "a.dzg holds RMC sentences alone, which tell no height" in notes


def test_positions_of_merged_lines_stand_on_their_own_traces(tmp_path):
    """Two lines of 15 traces, whose trace numbers begin anew in the headers and in the positions."""
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "number", [1 + k % 15 for k in range(TRACES)])
    own = np.arange(0, 15, 7)
    lines = gps_lines(own, LATITUDE[own], LONGITUDE[own]) + gps_lines(
        own, LATITUDE[15 + own], LONGITUDE[15 + own]
    )
    path.with_suffix(".gps").write_text(lines)
    read = read_gpr(path)
    traces = np.concatenate([own, 15 + own])
    np.testing.assert_array_equal(read.fixes[:, 0], traces)
    np.testing.assert_allclose(read.fixes[:, 1], LONGITUDE[traces], atol=1e-8)
    assert notes_with(read, "2 lines were merged")
    set_dt1_words(path, "number", [1 + k for k in range(TRACES)])
    unknown = read_gpr(path)
    np.testing.assert_array_equal(unknown.fixes[:, 0], own)
    assert notes_with(unknown, "3 of 6 positions of a.gps left out: its trace numbers begin anew")


def test_a_position_out_of_order_is_no_merged_line():
    notes = []
    found = [(trace, 11.0, 47.0, 1.0) for trace in (0, 4, 2, 6, 8)]
    assert settle_fixes([(*one, np.nan) for one in found], 9, notes, "a").table[:, 0].tolist() == [
        0,
        2,
        4,
        6,
        8,
    ]
    assert not notes


@pytest.mark.parametrize("evidence", ["wheel", "receiver", "recorder"])
def test_a_jump_that_no_vehicle_makes_is_told_by_info_and_left_out_of_a_run(evidence, tmp_path):
    """114 m within a second: by the wheel, by the receiver's own times, or by the recorder's rate of traces."""
    wheel = 1 / STEP if evidence == "wheel" else 0.0
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=wheel)
    traces = np.arange(0, TRACES, 3)
    lines = []
    for k, trace in enumerate(traces):
        lat = LATITUDE[trace] + (114 / 111_000 if k == 4 else 0)
        second = k if evidence == "receiver" else 0
        lines += [
            f"$GSSIS,{trace},-1",
            gga(lat, LONGITUDE[trace], 0, clock=f"1200{second:02d}.00"),
        ]
    path.with_suffix(".dzg").write_text("\n".join(lines))
    told = "\n".join(explain_file(path).lines)
    assert "1 of 10 positions of the satellite receiver an import with an anchor leaves out" in told
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    run = gpr_run(read_gpr(path), anchor=anchor)
    np.testing.assert_allclose(run["pose"].values[:, 1], ALONG[: len(run["pose"])], atol=1e-3)
    assert any(
        "1 of 10 positions of the satellite receiver left out" in note
        for note in run.attrs["import_notes"]
    )


def test_a_receivers_clock_that_goes_back_is_told(tmp_path):
    rows = [
        f"{k + 1}\td\t12:00:{50 - k:02d}\t{LATITUDE[k]:.9f}\tN\t{LONGITUDE[k]:.9f}\tE\t0"
        for k in range(5)
    ]
    (tmp_path / "a.cor").write_text("\n".join(rows))
    notes = []
    assert len(cor_fixes(tmp_path / "a.cor", TRACES, notes).table) == 5
    assert notes == ["the receiver's clock in a.cor goes back 4 times"]


def test_a_spacing_that_the_receiver_contradicts_is_told(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, step=1.0)
    lat = LATITUDE[0] + np.arange(TRACES) * 20 / 111_000
    path.with_suffix(".gps").write_text(
        gps_lines(range(TRACES), lat, np.full(TRACES, LONGITUDE[0]))
    )
    told = "\n".join(explain_file(path).lines)
    assert "where the traces' own distance is 29 m: is their spacing right?" in told


@pytest.mark.parametrize(("form", "ending"), [("dt1", ".gps"), ("gp2", ".gp2"), ("dzt", ".dzg")])
def test_a_sentence_that_fails_its_checksum_is_not_used(form, ending, tmp_path):
    """A digit of the longitude changed: 7 m aside, within what a vehicle reaches."""
    lines = gps_lines(range(9), LATITUDE[:9], LONGITUDE[:9], form).split("\r\n")
    number = next(k for k, line in enumerate(lines) if "GGA" in line) + (1 if form == "gp2" else 0)
    place = lines[number].index(",E,") - 4
    digit = str((int(lines[number][place]) + 5) % 10)
    lines[number] = lines[number][:place] + digit + lines[number][place + 1 :]
    path = tmp_path / f"a{ending}"
    path.write_text("\r\n".join(lines))
    notes = []
    found = nmea_fixes(path, TRACES, notes)
    assert len(found.table) == 8
    np.testing.assert_allclose(
        found.table[:, 1], LONGITUDE[found.table[:, 0].astype(int)], atol=1e-8
    )
    assert f"1 of 9 sentences of a{ending} are left out" in "\n".join(notes)


@pytest.mark.parametrize("bad", [0, 11, 29])
def test_a_changed_digit_of_a_cor_does_not_turn_the_line(bad, tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS)
    rows = []
    for k in range(TRACES):
        latitude = 47 + 4e-7 * k + (3e-5 if k == bad else 0)
        rows.append(f"{k + 1}\td\t12:00:00\t{latitude:.9f}\tN\t{11 + 6e-7 * k:.9f}\tE\t0")
    path.with_suffix(".cor").write_text("\n".join(rows))
    section = read_gpr(path)
    anchor, notes = anchor_from_fixes(section.fixes[:, 1:], section.fixes[:, 0])
    assert np.degrees(anchor.azimuth) == pytest.approx(45.7, abs=0.5)
    assert "1 of 30 fixes are not plausible" in "\n".join(notes)
    run = gpr_run(section, anchor=anchor)
    np.testing.assert_allclose(run["pose"].values[:, 0], 0, atol=1e-3)
    assert "lie aside of a way that goes on behind them" in "\n".join(run.attrs["import_notes"])


def test_positions_name_the_traces_of_a_cut_line_by_their_own_numbers(tmp_path):
    """The first 20 traces were cut away: the others keep their numbers, and so do the positions."""
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "number", [21 + k for k in range(TRACES)])
    named = np.arange(20, 20 + TRACES, 5)
    lines = gps_lines(named, LATITUDE[named - 20], LONGITUDE[named - 20])
    path.with_suffix(".gps").write_text(lines)
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], named - 20)
    assert notes_with(read, "the traces' own numbers begin at 21: the positions of a.gps are put")
    set_dt1_words(path, "number", [1 + k for k in range(TRACES)])
    np.testing.assert_array_equal(read_gpr(path).fixes[:, 0], named[named < TRACES])


def test_a_position_that_is_written_until_the_next_one_comes_counts_once(tmp_path):
    """A receiver of one fix in five traces: in between they lie on the way, not at its steps."""
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    latest = np.arange(TRACES) // 5 * 5
    lines = []
    for trace, own in enumerate(latest):
        clock = f"12{own // 60:02d}{own % 60:02d}.00"
        lines += gps_lines([trace], [LATITUDE[own]], [LONGITUDE[own]], clock=clock).splitlines()
    path.with_suffix(".gps").write_text("\n".join(lines))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], np.unique(latest))
    assert notes_with(read, f"{TRACES - len(np.unique(latest))} positions repeat the one before")


def test_a_separation_that_some_positions_lack_is_that_of_the_others(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    lines = gps_lines(np.arange(9), LATITUDE[:9], LONGITUDE[:9]).splitlines()

    def with_separations(separations):
        stated = list(lines)
        for number, separation in enumerate(separations):
            cells = lines[2 * number + 1].split("*")[0].split(",")
            cells[11] = separation
            stated[2 * number + 1] = closed(",".join(cells))
        return read_gpr_with(path, stated)

    told = with_separations(["46.0"] * 9)
    assert told.fixes[0, 3] > 40
    lacking = with_separations(["46.0", "", *["46.0"] * 6, ""])
    np.testing.assert_allclose(lacking.fixes[:, 3], told.fixes[:, 3])
    assert notes_with(lacking, "2 of 9 positions tell no separation of the geoid")


def read_gpr_with(path, lines):
    path.with_suffix(".gps").write_text("\n".join(lines))
    return read_gpr(path)


def test_positions_that_scatter_are_told(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    lines = gps_lines(np.arange(TRACES), LATITUDE, LONGITUDE).splitlines()
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    still = gpr_run(read_gpr_with(path, lines), anchor=anchor).attrs["import_notes"]
    assert not any("positions scatter" in note for note in still)
    aside = 2e-2 / 111_000 * np.random.default_rng(1).normal(size=TRACES)
    lines = gps_lines(np.arange(TRACES), LATITUDE + aside, LONGITUDE + aside).splitlines()
    told = gpr_run(read_gpr_with(path, lines), anchor=anchor).attrs["import_notes"]
    assert any(note.startswith("positions scatter: from each to the next") for note in told)
