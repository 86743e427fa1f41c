"""Other programs as judges: what they write is read as they meant it, and what they read is read alike.

segyio, scikit-rf and mcap-ros2-support are used where they are installed. What readgssi computes of a DZT stands here
in our own words (``readgssi/dzt.py``, https://github.com/iannesbitt/readgssi), and what ridal computes of an RD3 and of
a DT1 (``src/io.rs``, https://github.com/erikmannerfelt/ridal), which is built from Rust and seldom installed.
"""

import io
import struct
import warnings

import numpy as np
import pytest

from bag import drive
from flgpr.formats import read_gpr
from flgpr.formats.arrays import open_arrays
from io_gpr import INTERVAL, STEP, write_dt1, write_dzt, write_mala, write_segy
from io_open import write_su
from io_recordings import (
    COUNTS,
    LATITUDE,
    LONGITUDE,
    TRACES,
    gps_lines,
    two_headers,
    with_extra_headers,
)

RNG = np.random.default_rng(9)


# --- segyio

PICOSECONDS = round(INTERVAL * 1e12)


def write_by_segyio(segyio, path, counts, code, field):
    """Write a line with coordinates in the two words that begin at ``field``, cm."""
    spec = segyio.spec()
    spec.format = code
    spec.samples = np.arange(counts.shape[1])
    spec.tracecount = len(counts)
    with segyio.create(str(path), spec) as file:
        file.bin.update(
            {segyio.BinField.Interval: PICOSECONDS, segyio.BinField.MeasurementSystem: 1}
        )
        for k, trace in enumerate(counts):
            file.trace[k] = trace.astype(file.dtype)
            file.header[k].update(
                {
                    segyio.TraceField.TRACE_SAMPLE_COUNT: counts.shape[1],
                    segyio.TraceField.TRACE_SAMPLE_INTERVAL: PICOSECONDS,
                    segyio.TraceField.SourceGroupScalar: -100,
                    segyio.TraceField.CoordinateUnits: 1,
                    field: 50_000_000 + round(100 * STEP * k),
                    field + 4: 530_000_000,
                }
            )
    return path


@pytest.mark.parametrize("code", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("field", [73, 81, 181])
def test_what_segyio_writes_is_read(code, field, tmp_path):
    segyio = pytest.importorskip("segyio")
    counts = COUNTS // 128 if code == 8 else COUNTS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = write_by_segyio(segyio, tmp_path / "a.sgy", counts, code, field)
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], counts)
    np.testing.assert_allclose(read.delay, INTERVAL * np.arange(counts.shape[1]))
    np.testing.assert_allclose(read.distance, STEP * np.arange(TRACES), atol=1e-6)


def test_segyio_reads_the_same_of_every_variant(tmp_path):
    segyio = pytest.importorskip("segyio")
    for name, path in {
        "extra headers": with_extra_headers(
            write_segy(tmp_path / "a.sgy", COUNTS), TRACES, b"\2\1", 1, ">h"
        ),
        "big": write_segy(tmp_path / "b.sgy", COUNTS, code=5),
        "ibm": write_segy(tmp_path / "d.sgy", COUNTS, code=1),
        "little": write_segy(tmp_path / "c.sgy", COUNTS, code=2, order="<"),
    }.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            endian = "little" if name == "little" else "big"
            try:
                opened = segyio.open(path, ignore_geometry=True, endian=endian)
            except RuntimeError:  # versions before 2.0 know no extra headers
                assert name == "extra headers"
                continue
            with opened:
                np.testing.assert_array_equal(read_gpr(path).traces[:, 0], opened.trace.raw[:])
                scalar = opened.attributes(segyio.TraceField.SourceGroupScalar)[:]
                place = opened.attributes(segyio.TraceField.SourceX)[:] / -scalar
                np.testing.assert_allclose(read_gpr(path).distance, place - place[0], atol=1e-9)


@pytest.mark.parametrize("order", ["<", ">"])
def test_segyio_reads_the_same_of_seismic_unix(order, tmp_path):
    su = pytest.importorskip("segyio.su")
    path = write_su(tmp_path / "a.su", COUNTS, order=order)
    endian = "little" if order == "<" else "big"
    with su.open(str(path), endian=endian, ignore_geometry=True) as opened:
        np.testing.assert_array_equal(read_gpr(path).traces[:, 0], opened.trace.raw[:])
        assert opened.header[3][su.dt] == round(read_gpr(path).delay[1] * 1e12)


# --- readgssi


def readgssi_formulae(path):
    """Return of each channel (sample, trace) the counts, and the line's facts, as readgssi computes them.

    The data begin at 1024 bytes times the header's second word, or times the number of channels where that word is no
    small number. The words of a scan are those of the channels one after the other; of 8 and 16 bits they are unsigned.
    """
    raw = path.read_bytes()
    start, samples, bits = struct.unpack_from("<3h", raw, 2)
    per_second, per_metre = struct.unpack_from("<2f", raw, 10)
    (window,) = struct.unpack_from("<f", raw, 26)
    (channels,) = struct.unpack_from("<h", raw, 52)
    begin = 1024 * (start if start < 1024 else channels)
    kind = {8: np.uint8, 16: np.uint16}.get(bits, np.int32)
    scans = np.frombuffer(raw, kind, offset=begin).reshape(-1, samples * channels).T
    apart = [scans[k * samples : (k + 1) * samples].astype(np.int64) for k in range(channels)]
    marks = np.flatnonzero(scans[1] != np.bincount(scans[1].astype(np.int64)).argmax())
    facts = {
        "seconds": scans.shape[1] / per_second,
        "metres": scans.shape[1] / per_metre,
        "nanoseconds": window,
        "marks": marks.tolist(),
    }
    return apart, facts


@pytest.mark.parametrize("bits", [8, 16, 32])
@pytest.mark.parametrize("channels", [1, 2, 4])
@pytest.mark.parametrize("data", [None, 2048, 7])
def test_a_dzt_has_the_counts_that_readgssi_computes(bits, channels, data, tmp_path):
    counts = RNG.integers(-100, 100, size=(TRACES, channels, 64))
    path = write_dzt(
        tmp_path / "a.dzt", counts, bits, ("400MHz",) * channels, data=None if data == 7 else data
    )
    if data == 7:  # a header that is longer than its channels' parts
        raw = bytearray(path.read_bytes())
        struct.pack_into("<h", raw, 2, 7)
        path.write_bytes(
            bytes(raw[: 1024 * channels]) + bytes(1024 * (7 - channels)) + raw[1024 * channels :]
        )
    wanted, facts = readgssi_formulae(path)
    read = read_gpr(path)
    zero = {8: 128, 16: 32768, 32: 0}[bits]
    for channel in range(channels):
        # Two samples of every scan are its number and marks; readgssi leaves them in.
        np.testing.assert_array_equal(read.traces[:, channel, 2:].T, wanted[channel][2:] - zero)
    interval = read.delay[1] - read.delay[0]
    assert interval * 64 * 1e9 == pytest.approx(facts["nanoseconds"])
    assert (read.distance[1] - read.distance[0]) * TRACES == pytest.approx(facts["metres"])
    assert list(read.marks) == facts["marks"]


def test_channels_with_headers_of_their_own_have_the_counts_that_readgssi_computes(tmp_path):
    path = two_headers(tmp_path / "a.dzt", COUNTS)
    wanted, _ = readgssi_formulae(path)
    for channel in range(2):
        read = read_gpr(path).traces[:, channel, 2:].T
        np.testing.assert_array_equal(read, wanted[channel][2:] - 32768)


# --- ridal


def ridal_header(path, mark):
    """Return the entries of a text header as ridal splits its lines, at the first ``mark``."""
    lines = (line.split(mark, 1) for line in path.read_text().splitlines() if mark in line)
    return {name.strip(): value.strip() for name, value in lines}


def ridal_facts(header, samples, megahertz):
    """Return what ridal takes from a header: the delays, s, the antenna's frequency, Hz, and separation, m."""
    return {
        "delay": np.arange(samples) / (megahertz * 1e6),
        "separation": float(header["ANTENNA SEPARATION"]),
        "traces": int(header["NUMBER OF TRACES" if "NUMBER OF TRACES" in header else "LAST TRACE"]),
    }


def ridal_mala(path):
    """Return the counts (trace, sample) and the facts of an RD3: words of 16 bits, SAMPLES of them a trace."""
    header = ridal_header(path.with_suffix(".RAD"), ":")
    samples = int(header["SAMPLES"])
    words = np.frombuffer(path.read_bytes(), "<i2")
    width = words.size // samples
    facts = ridal_facts(header, samples, float(header["FREQUENCY"]))
    facts["frequency"] = 1e6 * float(header["ANTENNAS"].split("MHz")[0])
    return words[: width * samples].reshape(width, samples), facts


def ridal_cor(path):
    """Return trace (from 0), longitude, latitude and height of every line of a COR that has its ten columns."""
    rows = []
    for line in path.read_text().splitlines():
        cells = line.split()
        if len(cells) < 10:
            continue
        latitude = float(cells[3]) * (-1 if cells[4] == "S" else 1)
        longitude = float(cells[5]) * (-1 if cells[6] == "W" else 1)
        rows.append([int(cells[0]) - 1, longitude, latitude, float(cells[7])])
    return np.array(rows)


def ridal_dt1(path):
    """Return the counts (trace, sample) and the facts of a DT1: words of 16 bits behind 128 bytes of header."""
    header = ridal_header(path.with_suffix(".hd"), "=")
    samples = int(header["NUMBER OF PTS/TRC"])
    facts = ridal_facts(header, samples, 1000 * samples / float(header["TOTAL TIME WINDOW"]))
    facts["frequency"] = 1e6 * float(header["NOMINAL FREQUENCY"])
    record = np.dtype([("header", "V128"), ("samples", "<i2", samples)])
    return np.frombuffer(path.read_bytes(), record, facts["traces"])["samples"], facts


def ridal_gp2(path):
    """Return trace (from 0), longitude, latitude and height of a GP2, the first line of every trace."""
    rows = []
    for line in path.read_text().splitlines():
        if line.startswith((";", "traces")):
            continue
        trace, _, _, _, sentence = line.split(",", 4)
        if rows and rows[-1][0] == int(trace) - 1:
            continue
        cells = sentence.split(",")
        latitude = float(cells[2][:2]) + float(cells[2][2:]) / 60
        longitude = float(cells[4][:3]) + float(cells[4][3:]) / 60
        latitude *= -1 if cells[3] == "S" else 1
        longitude *= -1 if cells[5] == "W" else 1
        rows.append([int(trace) - 1, longitude, latitude, float(cells[9])])
    return np.array(rows)


def check_by_ridal(read, counts, facts, fixes):
    """Compare a line with what ridal computes of it; ridal puts time zero at the first sample."""
    np.testing.assert_array_equal(read.traces[:, 0], counts)
    np.testing.assert_allclose(read.delay - read.delay[0], facts["delay"], rtol=1e-9)
    assert len(read.traces) == facts["traces"]
    assert read.separation == facts["separation"]
    assert read.frequencies == (facts["frequency"],)
    np.testing.assert_allclose(read.fixes, fixes, atol=1e-9)


SIDES = [(LATITUDE, LONGITUDE), (-LATITUDE, LONGITUDE - 90)]
"""North and east, south and west."""


@pytest.mark.parametrize(("latitude", "longitude"), SIDES)
def test_an_rd3_and_its_cor_are_those_that_ridal_computes(latitude, longitude, tmp_path):
    path = write_mala(tmp_path / "a.rd3", COUNTS)
    lines = ["trace date time latitude"]
    for k in range(0, TRACES, 4):
        place = f"{abs(latitude[k]):.9f}\t{'N' if latitude[k] > 0 else 'S'}\t"
        place += f"{abs(longitude[k]):.9f}\t{'E' if longitude[k] > 0 else 'W'}"
        lines.append(f"{k + 1}\t2024-04-04\t9:00:{k:02d}\t{place}\t{400 + k / 8}\tM\t1")
    path.with_suffix(".cor").write_text("\n".join(lines))
    fixes = ridal_cor(path.with_suffix(".cor"))
    assert len(fixes) == 8
    check_by_ridal(read_gpr(path), *ridal_mala(path), fixes)


@pytest.mark.parametrize(("latitude", "longitude"), SIDES)
def test_a_dt1_and_its_gp2_are_those_that_ridal_computes(latitude, longitude, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    traces = np.array([0, 5, 5, 9, 20])
    lines = gps_lines(traces, latitude[traces + [0, 0, 1, 0, 0]], longitude[traces], "gp2")
    path.with_suffix(".gp2").write_text(lines.replace('"', ""))
    fixes = ridal_gp2(path.with_suffix(".gp2"))
    assert fixes[:, 0].tolist() == [0, 5, 9, 20]
    check_by_ridal(read_gpr(path), *ridal_dt1(path), fixes)


# --- scikit-rf


@pytest.mark.parametrize("ports", [1, 2, 3, 4])
@pytest.mark.parametrize("form", ["ri", "ma", "db"])
def test_what_scikit_rf_writes_is_read(ports, form, tmp_path):
    skrf = pytest.importorskip("skrf")
    tones = np.linspace(0.5e9, 3e9, 11)
    s = 0.3 * (RNG.normal(size=(11, ports, ports)) + 1j * RNG.normal(size=(11, ports, ports)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        frequency = skrf.Frequency.from_f(tones / 1e9, unit="GHz")
        skrf.Network(frequency=frequency, s=s, z0=50).write_touchstone(
            filename="a", dir=str(tmp_path), form=form
        )
    opened = open_arrays(tmp_path / f"a.s{ports}p")
    np.testing.assert_allclose(opened.read("frequency"), tones)
    np.testing.assert_allclose(opened.read("s"), s, rtol=1e-9, atol=1e-12)
    for a in range(ports):
        for b in range(ports):
            np.testing.assert_allclose(opened.read(f"s{a + 1}{b + 1}"), s[:, a, b], atol=1e-12)
    assert opened.notes == []


# --- mcap-ros2-support


def numbers_of(message, path=""):
    """Go through the numbers of a message that mcap-ros2-support has decoded: their path and value."""
    for name in message.__slots__:
        value = getattr(message, name)
        label = f"{path}.{name}" if path else name
        if hasattr(value, "__slots__"):
            yield from numbers_of(value, label)
        elif isinstance(value, int | float):
            yield label, value
        elif (
            isinstance(value, list | tuple | bytes) and value and isinstance(value[0], int | float)
        ):
            yield label, np.array(value)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_messages_are_those_that_mcap_ros2_support_decodes(compression, tmp_path):
    reader = pytest.importorskip("mcap_ros2.reader")
    data = drive(compression=compression)
    (tmp_path / "a.mcap").write_bytes(data)
    opened = open_arrays(tmp_path / "a.mcap")
    wanted = {}
    topics = ["/pose", "/fix", "/radar"]
    for one in reader.read_ros2_messages(io.BytesIO(data), topics=topics):
        topic = one.channel.topic
        wanted.setdefault(f"{topic}@log_time", []).append(one.log_time_ns / 1e9)
        for label, value in numbers_of(one.ros_msg):
            if not label.startswith("header.stamp."):  # which come as one number of seconds
                wanted.setdefault(f"{topic}/{label}", []).append(value)
    assert len(wanted) > 15
    for name, values in wanted.items():
        np.testing.assert_allclose(opened.read(name), np.array(values), err_msg=name)
