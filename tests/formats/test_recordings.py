"""Recordings as they really are: each fault that files of makers and users showed, with the right value.

What a file measured stays; what is replaced, left out or assumed is counted in the notes.
"""

import struct
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from damage import FUZZ
from flgpr.commands.app import app
from flgpr.formats import explain_file, gpr_run, read_gpr
from flgpr.formats.gpr_antennas import antenna_frequency
from flgpr.formats.gpr_positions import cor_fixes, nmea_fixes, read_dzx, settle_fixes
from flgpr.geo import fit_anchor
from flgpr.store import open_run
from io_geodesy import LANE, on_the_ellipsoid
from io_gpr import (
    INTERVAL,
    SAMPLES,
    SEPARATION,
    STEP,
    ZERO,
    gga,
    section,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)  # fmt: skip
from io_recordings import (
    dt1_at,
    gps_lines,
    patched,
    segy_words,
    set_dt1_words,
    two_headers,
    with_extra_headers,
)  # fmt: skip

COUNTS = section(30)
TRACES = len(COUNTS)
ALONG = STEP * np.arange(TRACES)
WAY = np.stack([np.zeros(TRACES), ALONG, np.zeros(TRACES)], axis=1)
LONGITUDE, LATITUDE = on_the_ellipsoid(WAY)[:, :2].T


def notes_with(read, words):
    return [note for note in read.history if words in note]


# --- measured places and clocks


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({11: 10, 12: 10}, "2 traces stand where the one before was and 0 lie behind it"),
        ({20: 18}, "0 traces stand where the one before was and 1 lie behind it"),
        ({29: 3000}, "jump 1 times, by up to 148.6 m (usually 0.05 m): kept as measured"),
    ],
)
def test_places_of_the_trace_headers_stay_as_they_were_measured(change, words, tmp_path):
    places = ALONG.copy()
    for trace, step in change.items():
        places[trace] = STEP * step
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    np.testing.assert_allclose(read.distance, places, rtol=1e-6)
    assert notes_with(read, words)
    np.testing.assert_allclose(gpr_run(read)["pose"].values[:, 1], places, rtol=1e-6)


def test_places_that_are_no_numbers_are_put_between_their_neighbours(tmp_path):
    places = ALONG.copy()
    places[[4, 5]] = np.nan
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-6)
    assert notes_with(read, f"2 of {TRACES} positions of the trace headers are no numbers")


def test_places_that_all_are_the_same_tell_nothing(tmp_path):
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, np.full(TRACES, 7.0)))
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "equal steps of 0.05 m, by STEP SIZE USED in the header")


def test_a_cart_that_turned_round_went_the_whole_way(tmp_path):
    places = np.minimum(ALONG, ALONG[::-1])
    told = explain_file(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    assert f"length {np.abs(np.diff(places)).sum():.6g} m" in "\n".join(told.lines)


@pytest.mark.parametrize(
    ("unit", "metre"),
    [
        ("cm", 0.01),
        ("mm", 1e-3),
        ("in", 0.0254),
        ("Feet", 0.3048),
        ("metres", 1.0),
        ("yards", 0.9144),
    ],
)
def test_positions_are_in_the_unit_that_the_header_tells(unit, metre, tmp_path):
    read = read_gpr(
        dt1_at(
            tmp_path / "a.dt1",
            COUNTS,
            ALONG / metre,
            POSITION_UNITS=unit,
            ANTENNA_SEPARATION=0.2 / metre,
        )
    )
    np.testing.assert_allclose(read.distance, ALONG, rtol=1e-5)
    assert read.separation == pytest.approx(0.2)


def test_a_unit_that_is_not_known_places_nothing(tmp_path):
    read = read_gpr(write_dt1(tmp_path / "a.dt1", COUNTS, POSITION_UNITS="paces"))
    assert (read.distance, read.separation) == (None, None)
    assert notes_with(read, "POSITION UNITS are 'paces', which is no unit that is known")
    told = read_gpr(
        write_dt1(tmp_path / "b.dt1", COUNTS, POSITION_UNITS="cm", ANTENNA_SEPARATION=0.2)
    )
    assert told.separation == 0.2
    assert notes_with(told, "ANTENNA SEPARATION 0.2 is taken as metres")


def test_a_clock_goes_on_over_midnight_and_is_not_used_where_it_goes_back(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "second", [(86_390 + k) % 86_400 for k in range(TRACES)])
    read = read_gpr(path)
    np.testing.assert_allclose(read.time, 86_390 + np.arange(TRACES))
    assert notes_with(read, "the clock passes midnight 1 times")
    set_dt1_words(path, "second", [k if k != 9 else 3 for k in range(TRACES)])
    back = read_gpr(path)
    assert back.time is None
    assert notes_with(back, "the clock goes back 1 times, by up to 5 s: not used")


def test_a_signalling_nan_in_an_unused_word_warns_nobody(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "receiver", [b"\x01\x00\xa0\x7f"] * TRACES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_gpr(path).traces[:, 0], COUNTS)


# --- headers


@pytest.mark.parametrize("tag", [0x0700, 0x00FF, 0x07FF, 0x2064])
def test_a_dzt_may_begin_with_any_tag(tag, tmp_path):
    path = patched(write_dzt(tmp_path / "a.dzt", COUNTS[:, None]), (0, "<H", tag))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0, 2:], COUNTS[:, 2:])
    assert bool(notes_with(read, f"its tag is {tag:#06x}")) == (tag & 0xFF != 0xFF)


def test_a_wheel_that_turns_backwards_has_a_spacing(tmp_path):
    read = read_gpr(write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=-1 / STEP))
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "counted towards smaller positions")


def test_every_channel_has_its_own_window_and_zero(tmp_path):
    read = read_gpr(two_headers(tmp_path / "a.dzt", COUNTS))
    first = (np.arange(SAMPLES) - ZERO) * INTERVAL
    np.testing.assert_allclose(read.delay_of(0), first, atol=1e-16)
    np.testing.assert_allclose(
        read.delay_of(1), (np.arange(SAMPLES) - ZERO / 2) * INTERVAL / 2, atol=1e-16
    )
    assert read.frequencies == (300e6, 800e6)
    assert notes_with(
        read,
        "channel 1 has a header of its own: time window 25.6 ns, time zero 1 ns after its start",
    )
    run = gpr_run(read, 1, band=(1e8, 1e9))
    assert run.attrs["time_window_s"] == pytest.approx(SAMPLES * INTERVAL / 2)
    assert run.attrs["first_sample_s"] == pytest.approx(-ZERO * INTERVAL / 4)
    assert "channel 1 has a header of its own" in "\n".join(explain_file(tmp_path / "a.dzt").lines)


def test_headers_of_old_files_and_of_no_channel(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    raw = bytearray(path.read_bytes())
    struct.pack_into("<H", raw, 2, 512)
    path.write_bytes(bytes(raw[:512]) + bytes(raw[1024:]))
    old = read_gpr(path)
    np.testing.assert_array_equal(old.traces[:, 0, 2:], COUNTS[:, 2:])
    assert notes_with(old, "its header has 512 bytes")
    none = read_gpr(
        patched(write_dzt(tmp_path / "b.dzt", COUNTS[:, None]), (52, "<H", 0), (2, "<H", 1024))
    )
    np.testing.assert_array_equal(none.traces[:, 0, 2:], COUNTS[:, 2:])
    assert notes_with(none, "the header tells 0 channels")


def test_a_channel_without_a_header_is_told(tmp_path):
    path = write_dzt(
        tmp_path / "a.dzt", np.stack([COUNTS, COUNTS], axis=1), names=("400MHz", "400MHz")
    )
    read = read_gpr(patched(path, (1024 + 26, "<f", 0.0)))
    assert notes_with(read, "the header of channel 1 tells no time window")
    other = patched(path, (1024 + 26, "<f", 50.0), (1024 + 4, "<H", SAMPLES // 2))
    with pytest.raises(
        ValueError, match=f"channel 1 must have {SAMPLES} samples of 16 bits as the first"
    ):
        read_gpr(other)


@pytest.mark.parametrize("mode", ["CMP/WARR", "WARR", "Multi-offset", "Transillumination"])
def test_a_gather_is_no_line(mode, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE=mode)
    with pytest.raises(ValueError, match=f"its antennas move apart .{mode}"):
        gpr_run(read_gpr(path))
    assert (
        f"its antennas move apart ({mode}): it is no line of one offset" in explain_file(path).lines
    )
    assert explain_file(path).lines[-1].startswith("flgpr import gpr refuses it")


def test_places_of_the_antennas_tell_a_gather_too(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE="Reflection")
    set_dt1_words(path, "receiver", [0.5 + 0.1 * k for k in range(TRACES)])
    assert read_gpr(path).gather == "antennas 0.5 to 3.4 apart"
    set_dt1_words(path, "receiver", [0.5 + k % 3 for k in range(TRACES)])
    assert not read_gpr(path).gather
    assert notes_with(
        read_gpr(path), "the trace headers put the antennas 0.5 to 2.5 apart, which is not used"
    )
    assert not read_gpr(write_dt1(tmp_path / "b.dt1", COUNTS, SURVEY_MODE="Reflection")).gather
    assert notes_with(
        read_gpr(write_dt1(tmp_path / "c.dt1", COUNTS, SURVEY_MODE="walking")), "is not known"
    )


def test_the_size_of_the_samples_tells_their_type(tmp_path):
    real = write_dt1(tmp_path / "a.dt1", COUNTS + 0.25, real=True, DATA_TYPE="")
    np.testing.assert_array_equal(read_gpr(real).traces[:, 0], COUNTS + np.float32(0.25))
    assert notes_with(
        read_gpr(real), "read as 32 bit floating point, by their size (no DATA TYPE is told)"
    )
    wrong = write_dt1(tmp_path / "b.dt1", COUNTS, DATA_TYPE="F*4")
    np.testing.assert_array_equal(read_gpr(wrong).traces[:, 0], COUNTS)
    assert notes_with(read_gpr(wrong), "read as 16 bit, by their size (DATA TYPE is F*4)")
    big = write_dt1(tmp_path / "c.dt1", COUNTS, real=True, order=">", DATA_TYPE="")
    np.testing.assert_array_equal(read_gpr(big).traces[:, 0], COUNTS)


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
    unknown = read_gpr(write_mala(tmp_path / "b.rd3", COUNTS, ANTENNAS="prototype 7"))
    assert unknown.frequencies == (None,)
    assert notes_with(unknown, "antenna 'prototype 7' is in no table of models")
    assert any("by the sampling" in note for note in gpr_run(unknown).attrs["import_notes"])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("kind", ["dt1", "rd3", "iprb"])
def test_headers_in_other_encodings(kind, encoding, tmp_path):
    write, suffix = {
        "dt1": (write_dt1, ".hd"),
        "rd3": (write_mala, ".RAD"),
        "iprb": (write_impulse, ".iprh"),
    }[kind]
    path = write(tmp_path / f"a.{kind}", COUNTS, SITE="Grünfläche", OPERATOR="Öster")
    head = path.with_suffix(suffix)
    plain = head.read_text(encoding="utf-8")
    head.write_bytes(plain.encode(encoding))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert bool(notes_with(read, "is text in")) == (encoding != "utf-8-sig")
    if kind == "rd3":
        assert read.title == "Grünfläche"


# --- SEG-Y


@pytest.mark.parametrize(
    ("revision", "count", "form"),
    [(b"\2\0", 1, ">i"), (b"\2\0", 1, ">h"), (b"\2\1", 2, ">h"), (b"\2\1", 1, ">i")],
)
def test_extra_headers_of_revision_2_are_passed_over(revision, count, form, tmp_path):
    path = with_extra_headers(write_segy(tmp_path / "a.sgy", COUNTS), TRACES, revision, count, form)
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, f"every trace has {count} extra headers")
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-9)


def test_a_revision_that_does_not_exist_stays_readable(tmp_path):
    path = patched(
        write_segy(tmp_path / "a.sgy", COUNTS),
        (3500, ">H", 0x2425),
        (3504, ">h", 3),
        (3506, ">i", 77),
    )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, "its revision word is 36.37, which does not exist")
    assert notes_with(read, "its traces begin at byte 3600, not at 13200")


def test_samples_and_interval_of_the_trace_headers(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, samples=(114, ">H", SAMPLES), interval=(116, ">H", 200))
    read = read_gpr(patched(path, (3220, ">H", 0), (3216, ">H", 0)))
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_allclose(read.delay, np.arange(SAMPLES) * INTERVAL, atol=1e-16)
    assert notes_with(read, f"the number of samples, {SAMPLES}, is that of the trace headers")
    assert notes_with(read, "the sample interval, 200, is that of the first trace header")
    wrong = read_gpr(patched(path, (3220, ">H", 100), (3216, ">H", 200)))
    np.testing.assert_array_equal(wrong.traces[:, 0], COUNTS)
    bare = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3220, ">H", 0))
    with pytest.raises(ValueError, match="it must tell the number of samples"):
        read_gpr(bare)
    with pytest.raises(ValueError, match="it must tell the sample interval"):
        read_gpr(patched(write_segy(tmp_path / "c.sgy", COUNTS), (3216, ">H", 0)))


@pytest.mark.parametrize(("name", "offset"), [("source", 72), ("group", 80), ("CDP", 180)])
def test_coordinates_wherever_they_stand(name, offset, tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS, place=[(0, 0)] * TRACES)
    segy_words(
        path,
        TRACES,
        x=(offset, ">i", lambda k: 50_000_000 + round(100 * STEP * k)),
        y=(offset + 4, ">i", 5),
    )
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-6)
    assert notes_with(read, f"{name} coordinates (bytes {offset + 1}-{offset + 8})")


def test_source_and_group_tell_the_separation(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, x=(80, ">i", lambda k: round(100 * STEP * k)), y=(84, ">i", 20))
    read = read_gpr(path)
    assert read.separation == pytest.approx(0.2)
    assert notes_with(read, "the antennas' separation is the distance of source and group")


def test_words_that_change_the_meaning_of_a_trace_are_told(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(
        path, TRACES, dead=(28, ">h", lambda k: 2 if k == 3 else 1), offset=(36, ">i", lambda k: k)
    )
    read = read_gpr(path)
    assert np.isnan(read.traces[3]).all()
    np.testing.assert_array_equal(
        np.delete(read.traces[:, 0], 3, axis=0), np.delete(COUNTS, 3, axis=0)
    )
    assert notes_with(read, "1 traces without data")
    assert notes_with(read, "the distance from source to receiver (bytes 37-40) goes from 0 to 29")
    odd = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3254, ">H", 9), (3600 + 88, ">h", 1))
    assert notes_with(read_gpr(odd), "its measurement system is 9, which does not exist")


@pytest.mark.parametrize(("unit", "scalar"), [(2, 1000), (3, 10_000), (4, 1000)])
def test_positions_of_segy_in_every_angular_unit(unit, scalar, tmp_path):
    degrees = np.stack([11 + np.arange(TRACES) / 3600, np.full(TRACES, 47.5125)], axis=1)
    values = degrees * (3600 if unit == 2 else 1)
    if unit == 4:  # 47 degrees, 30 minutes and 45 seconds are 473045
        whole = np.floor(degrees)
        minutes = degrees % 1 * 60
        values = (
            whole * 10_000
            + np.floor(minutes + 1e-9) * 100
            + (minutes - np.floor(minutes + 1e-9)) * 60
        )
    place = np.round(values * scalar).astype(int)
    read = read_gpr(write_segy(tmp_path / "a.sgy", COUNTS, unit=unit, scalar=-scalar, place=place))
    np.testing.assert_allclose(read.fixes[:, 1:3], degrees, atol=1e-4 if unit == 3 else 1e-6)
    assert notes_with(read, f"{TRACES} of {TRACES} positions tell no height: 0 m is taken")


def test_coordinates_that_never_change_are_told(tmp_path):
    read = read_gpr(write_segy(tmp_path / "a.sgy", COUNTS, place=[(7, 9)] * TRACES))
    assert read.distance is None
    assert notes_with(
        read, "source coordinates (bytes 73-80) are the same in all traces: they are not used"
    )


def test_segyio_reads_the_same_of_every_variant(tmp_path):
    segyio = pytest.importorskip("segyio")
    for name, path in {
        "extra headers": with_extra_headers(
            write_segy(tmp_path / "a.sgy", COUNTS), TRACES, b"\2\1", 1, ">h"
        ),
        "big": write_segy(tmp_path / "b.sgy", COUNTS, code=5),
        "little": write_segy(tmp_path / "c.sgy", COUNTS, code=2, order="<"),
    }.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                opened = segyio.open(
                    path, ignore_geometry=True, endian="little" if name == "little" else "big"
                )
            except RuntimeError:  # versions before 2.0 know no extra headers
                continue
            with opened:
                np.testing.assert_array_equal(read_gpr(path).traces[:, 0], opened.trace.raw[:])


# --- companions


@pytest.mark.parametrize(
    ("mark", "comma"),
    [("\t", "."), ("\t", ","), (";", ","), (";", "."), (" ", "."), (", ", "."), (",", ".")],
)
@pytest.mark.parametrize("height", ["{:.3f}{m}M", "{:.3f}M"])
def test_every_dialect_of_a_cor(mark, comma, height, tmp_path):
    rows = ["Trace\tDate\tTime\tLatitude\tN\tLongitude\tE"] if mark == "\t" else []
    for k in range(0, TRACES, 5):
        cells = [
            str(k + 1),
            "2020-01-02",
            f"12:00:{k:02d}",
            f"{LATITUDE[k]:.9f}",
            "N",
            f"{LONGITUDE[k]:.9f}",
            "E",
        ]
        text = mark.join([*cells, height.format(400.5, m=mark), "1.0"])
        rows.append(text.replace(".", ",") if comma == "," else text)
    path = tmp_path / "a.cor"
    path.write_text("\r\n".join([*rows, f"40{mark}nothing"]))
    notes = []
    found = cor_fixes(path, TRACES, notes)
    np.testing.assert_array_equal(found.table[:, 0], np.arange(0, TRACES, 5))
    np.testing.assert_allclose(found.table[:, 1], LONGITUDE[::5], atol=1e-8)
    np.testing.assert_allclose(found.table[:, 2], LATITUDE[::5], atol=1e-8)
    np.testing.assert_allclose(found.table[:, 3], 400.5)
    np.testing.assert_allclose(found.time, 43_200 + np.arange(0, TRACES, 5))
    assert [note for note in notes if "1 of 7 lines of a.cor were not understood" in note]


def test_angles_of_a_cor_with_signs_letters_and_minutes(tmp_path):
    path = tmp_path / "a.cor"
    path.write_text(
        "1 d t 47:30:36 S 11:15:00 W 1\n2 d t -47.51 11.25 2\n3 d t 47.51S 11.25W 3\n4 d t S47.51 W11.25 4\n"
    )
    found = cor_fixes(path, 9, [])
    np.testing.assert_allclose(found.table[:, 1], [-11.25, 11.25, -11.25, -11.25])
    np.testing.assert_allclose(found.table[:, 2], -47.51)
    np.testing.assert_allclose(found.table[:, 3], [1, 2, 3, 4])


def test_a_gp2_is_read_and_the_first_of_many_positions_is_used(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    traces = np.arange(0, TRACES, 3)
    text = gps_lines(traces, LATITUDE[traces], LONGITUDE[traces], "gp2")
    path.with_suffix(".GP2").write_text(text + text.splitlines()[-1] + "\r\n")
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], traces)
    np.testing.assert_allclose(read.fixes[:, 1], LONGITUDE[traces], atol=1e-8)
    assert notes_with(read, "1 positions are further ones of the same trace")
    path.with_suffix(".gps").write_text(
        gps_lines(traces[:4], LATITUDE[traces[:4]], LONGITUDE[traces[:4]])
    )
    assert len(read_gpr(path).fixes) == 4
    assert notes_with(read_gpr(path), "a.GP2 lies beside it and is not read, because a.gps is")


DZX = """<?xml version="1.0" encoding="UTF-8"?>
<DZX xmlns="www.geophysical.com/DZX/1.02"><GlobalProperties><horizontalUnit>{unit}</horizontalUnit>
<unitsPerScan>{per_scan}</unitsPerScan></GlobalProperties>{group}<File><Profile>
<WayPt><scan>7</scan><mark>User</mark><name>Mark1</name></WayPt>
<WayPt><scan>9</scan><mark>Dist</mark>{first}</WayPt><WayPt><scan>19</scan>{second}</WayPt>
</Profile></File>{end}</DZX>"""


def dzx(path, unit="m", per_scan=STEP, group=False, first="", second=""):
    wrapped = ("<ProfileGroup>", "</ProfileGroup>") if group else ("", "")
    text = DZX.format(
        unit=unit, per_scan=per_scan, group=wrapped[0], end=wrapped[1], first=first, second=second
    )
    path.with_suffix(".DZX").write_text(text)
    return path


@pytest.mark.parametrize("group", [False, True])
def test_marks_and_spacing_of_a_dzx(group, tmp_path):
    path = dzx(
        write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=0.0), "cm", 100 * STEP, group
    )
    read = read_gpr(path)
    assert read.marks == (5, 7)  # that of the samples, too
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "unitsPerScan of the DZX")


def test_distances_of_a_dzx_and_one_that_contradicts_itself(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=0.0)
    dzx(path, first="<distance>1.0</distance>", second="<distance>2.0</distance>")
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, 0.1 * np.arange(TRACES) + 0.1)
    assert notes_with(read, "2 distances of the DZX are used")
    dzx(path, first="<localCoords>0,0,0</localCoords>", second="<localCoords>0,5,0</localCoords>")
    assert read_gpr(path).distance is None
    assert notes_with(
        read_gpr(path), "contradicts itself: its scans are 0.05 m apart by unitsPerScan and 0.5 m"
    )


@pytest.mark.parametrize(
    "text", ["<DZX>", "<!DOCTYPE x [<!ENTITY a 'b'>]><DZX>&a;</DZX>", "\x00\x00"]
)
def test_a_companion_that_is_damaged_keeps_no_recording_from_being_read(text, tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    path.with_suffix(".DZX").write_text(text)
    assert notes_with(read_gpr(path), "a.DZX was found and not understood")
    path.with_suffix(".DZG").write_bytes(b"\xff\xfe\x00")
    assert notes_with(read_gpr(path), "a.DZG was found and not understood")


def test_files_beside_a_recording_that_are_not_read_are_named(tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS)
    path.with_suffix(".mrk").write_text("1")
    assert notes_with(read_gpr(path), "a.mrk lies beside it and is not read")
    assert read_dzx(None, 3, []).marks == ()


# --- positions of a satellite receiver


def test_a_receiver_without_a_fix_is_told(tmp_path):
    path = tmp_path / "a.dzg"
    path.write_text(gps_lines(range(9), LATITUDE[:9], LONGITUDE[:9], "dzt", quality=0))
    notes = []
    assert len(nmea_fixes(path, TRACES, notes).table) == 0
    assert notes == ["9 of 9 sentences of a.dzg tell no position (the receiver had no fix)"]


def test_zero_north_zero_east_is_no_place(tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    lines = gps_lines([0, 10, 20], LATITUDE[[0, 10, 20]], LONGITUDE[[0, 10, 20]], "dzt")
    path.with_suffix(".dzg").write_text(lines + f"$GSSIS,25,-1\n{gga(0, 0, 0, quality=1)}\n")
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], [0, 10, 20])
    assert notes_with(read, "1 of 4 positions left out: 0 N 0 E")


def test_rmc_serves_where_there_is_no_gga(tmp_path):
    path = tmp_path / "a.dzg"
    path.write_text(
        "$GSSIS,3,-1\n$GPRMC,120000.00,A,4700.0000,N,01100.0000,E,0.0,0.0,010120,,*00\n"
    )
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
            gga(lat, LONGITUDE[trace], 0).replace("120000", f"1200{second:02d}"),
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


def test_a_line_that_was_triggered_by_time_has_a_clock(tmp_path):
    read = read_gpr(write_mala(tmp_path / "a.rd3", COUNTS, DISTANCE_FLAG=0, TIME_FLAG=1))
    np.testing.assert_allclose(read.time, 0.1 * np.arange(TRACES))
    assert notes_with(read, "a trace every 0.1 s, by TIME INTERVAL in the header")
    assert notes_with(read, "DISTANCE FLAG is 0: no wheel was used")


def test_a_spacing_that_the_receiver_contradicts_is_told(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, step=1.0)
    lat = LATITUDE[0] + np.arange(TRACES) * 20 / 111_000
    path.with_suffix(".gps").write_text(
        gps_lines(range(TRACES), lat, np.full(TRACES, LONGITUDE[0]))
    )
    told = "\n".join(explain_file(path).lines)
    assert "where the traces' own distance is 29 m: is their spacing right?" in told


# --- nothing is assumed without a note

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


@FUZZ
@given(
    step=st.sampled_from([STEP, -STEP, 0.0]),
    still=st.booleans(),
    back=st.booleans(),
    lost=st.booleans(),
    unit=st.sampled_from(["m", "cm", "", "paces"]),
    zero=st.booleans(),
    midnight=st.booleans(),
)
def test_what_differs_from_the_file_is_in_the_notes(
    step, still, back, lost, unit, zero, midnight, tmp_path
):
    """Every place that is given differs from the words in the file only where a note says so."""
    places = step * np.arange(TRACES)
    places[12] = places[11] if still else places[12]
    places[20] = places[18] if back else places[20]
    places[25] = np.nan if lost else places[25]
    entries = {"POSITION_UNITS": unit} | ({} if zero else {"TIMEZERO_AT_POINT": ""})
    path = dt1_at(tmp_path / "a.dt1", COUNTS, places, **entries)
    if midnight:
        set_dt1_words(path, "second", [(86_395 + k) % 86_400 for k in range(TRACES)])
    read = read_gpr(path)
    said = "\n".join(read.history)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    metre = {"cm": 0.01, "paces": None}.get(unit, 1.0)
    if metre is None:
        assert read.distance is None
        assert "POSITION UNITS" in said
    elif read.distance is None or not np.array_equal(
        read.distance, np.float32(places) * np.float64(metre)
    ):
        assert (
            any(
                word in said
                for word in ("no numbers", "no places", "fall from trace", "equal steps")
            )
            or step == 0
        )
    assert ("stand where the one before was" in said) == (
        metre is not None and step != 0 and (still or back)
    )
    assert ("POSITION UNITS are not told" in said) == (unit == "")
    assert ("no time zero" in said) == (not zero)
    assert ("midnight" in said) == midnight


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
