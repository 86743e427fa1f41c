"""Whatever is assumed, replaced or dropped of a recording is in the notes, with its count; what was measured stays.

The files are written here with damage and gaps that are drawn, so that it is known what each note must say.
"""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import FUZZ
from flgpr.formats import read_gpr
from io_gpr import (
    SAMPLES,
    STEP,
    WINDOW,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)  # fmt: skip
from io_notes import check_notes, if_any, some
from io_open import way, write_ogpr, write_su
from io_recordings import (
    ALONG,
    COUNTS,
    LATITUDE,
    LONGITUDE,
    TRACES,
    gps_lines,
    patched,
    segy_words,
    set_dt1_words,
)  # fmt: skip

pytestmark = pytest.mark.slow("many drawn files")

NO_ZERO = "tells no time zero"
CUT = "the last trace is cut off and left out"


def stated_note(stated, count):
    """Return what is noted where a header tells another number of traces than there are."""
    if stated and count < stated - 1:
        return f"truncated: the header tells {stated} traces, the file holds {count}"
    if stated and count > stated + 1:
        return f"the header tells {stated} traces, the file holds {count}, all of which are read"
    return None


def cut_short(path, wanted):
    """Take the last byte of a file away if that is wanted; return how many of the traces are whole."""
    if not wanted:
        return TRACES
    path.write_bytes(path.read_bytes()[:-1])
    return TRACES - 1


STATED = st.sampled_from([0, 10, TRACES, 99])


def holes(counts, traces):
    """Return counts of which some traces hold a value that is no number."""
    real = counts.astype(np.float32)
    for trace in traces:
        real[trace, 7] = np.nan
    return real


# --- Sensors & Software


@FUZZ
@given(
    metre=st.sampled_from([("m", 1.0), ("cm", 0.01), ("", 1.0)]),
    zero=st.sampled_from(["21", "0", ""]),
    real=st.sampled_from(["no", "flagged", "unflagged"]),
    stated=STATED,
    cut=st.booleans(),
    dead=some(2, 8),
    missing=some(9, 12),
    still=some(3, 6, 2),
    lost=some(14, 24),
    back=st.booleans(),
    topography=some(0, 29),
    fixes=some(0, 29),
    adjusted=some(0, 29),
    marks=some(0, 28),
    midnight=st.booleans(),
)
def test_dt1(
    metre, zero, real, stated, cut, dead, missing, still, lost, back, topography, fixes, adjusted, marks, midnight,
    tmp_path,
):  # fmt: skip
    unit, size = metre
    places = ALONG.copy()
    for trace in sorted(still):
        places[trace:] -= places[trace] - places[trace - 1]
    places[27:] -= 3 * STEP if back else 0.0
    measured = np.float32(places)
    missing = set() if real == "no" else missing - dead
    counts = COUNTS if real == "no" else holes(COUNTS, missing)
    entries = {"POSITION_UNITS": unit, "TIMEZERO_AT_POINT": zero, "NUMBER_OF_TRACES": stated or ""}
    if real == "unflagged":
        entries["DATA_TYPE"] = ""
    path = write_dt1(tmp_path / "a.dt1", counts, real=real != "no", **entries)
    width = 2 if real == "no" else 4
    written = measured.copy()
    written[list(lost)] = np.nan
    set_dt1_words(path, "position", written, width)
    if midnight:
        set_dt1_words(path, "second", [(86_390 + k) % 86_400 for k in range(TRACES)], width)
    record = 128 + width * SAMPLES
    patches = [(k * record + 4 * 21, "<f", 1.0) for k in dead]
    patches += [(k * record + 4 * 3, "<f", 2.5) for k in topography]
    patches += [(k * record + 4 * 8, "<d", 47.5) for k in fixes]
    patches += [(k * record + 4 * 20, "<f", -3.0) for k in adjusted]
    patches += [(k * record + 4 * 24, "<f", 1.0) for k in marks]
    patched(path, *patches)
    count = cut_short(path, cut)
    read = read_gpr(path)
    whole = {k for k in range(count)}
    stood = len(still)
    motion = None
    if stood or back:
        motion = f"{stood} traces stand where the one before was and {int(back)} lie behind it"
    check_notes(
        read.history,
        None if zero == "21" else "TIMEZERO AT POINT is 0" if zero else NO_ZERO,
        None if unit else "POSITION UNITS are not told: positions are taken as metres",
        "ANTENNA SEPARATION 0.2 is taken as metres" if unit == "cm" else None,
        "samples are read as 32 bit floating point" if real == "unflagged" else None,
        CUT if cut else None,
        stated_note(stated, count),
        if_any(dead & whole, f"{len(dead & whole)} traces without data, as their headers say"),
        if_any(
            missing & whole,
            f"{len(missing & whole)} of {count} traces hold samples that are no numbers",
        ),
        if_any(lost, f"{len(lost)} of {count} positions of the trace headers are no numbers"),
        motion,
        if_any(
            topography & whole,
            f"the topography (word 4) of {len(topography & whole)} traces is not used",
        ),
        if_any(
            fixes & whole, f"position (words 9 to 14) of {len(fixes & whole)} traces is not used"
        ),
        if_any(
            adjusted & whole,
            f"the adjustment of time zero (word 21) of {len(adjusted & whole)} traces is not used",
        ),
        "the clock passes midnight 1 times" if midnight else None,
    )
    kept = [k for k in range(count) if k not in dead]
    np.testing.assert_array_equal(read.traces[kept, 0], counts[kept])
    assert np.isnan(read.traces[sorted(dead & whole), 0]).all()
    known = [k for k in range(count) if k not in lost]
    np.testing.assert_array_equal(read.distance[known], measured[known].astype(float) * size)
    assert read.marks == tuple(sorted(marks & whole))


# --- GSSI

NAMES = {
    "50400": "antenna '50400' is one of 400 MHz, by the table of models",
    "400MHz": None,
    "": "the header names no antenna: its frequency is unknown",
    "odd 7": "antenna 'odd 7' is in no table of models",
}


@FUZZ
@given(
    per_metre=st.sampled_from([20.0, -20.0, 0.0]),
    per_second=st.sampled_from([50.0, 0.0]),
    tag=st.sampled_from([0x00FF, 0x0700]),
    position=st.sampled_from([-4.0, 0.0]),
    name=st.sampled_from(sorted(NAMES)),
    cut=st.booleans(),
    marks=some(1, 28),
    good=some(0, 12, 6),
    null=some(13, 18),
    unfixed=some(19, 24),
    beyond=st.integers(0, 2),
)
def test_dzt(
    per_metre, per_second, tag, position, name, cut, marks, good, null, unfixed, beyond, tmp_path
):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None], names=(name,), per_metre=per_metre)
    start = 1024
    words = [(start + 2 * SAMPLES * k + 2, "<H", 3 if k in marks else 7) for k in range(TRACES)]
    patched(path, (0, "<H", tag), (10, "<f", per_second), (22, "<f", position), *words)
    lines = []
    for traces, options in ((good, {}), (null, {}), (unfixed, {"quality": 0})):
        lat = LATITUDE if traces is not null else 0 * LATITUDE
        lon = LONGITUDE if traces is not null else 0 * LONGITUDE
        order = sorted(traces)
        lines.append(gps_lines(order, lat[order], lon[order], "dzt", **options))
    far = [TRACES + 5 + k for k in range(beyond)]
    lines.append(gps_lines(far, LATITUDE[:beyond], LONGITUDE[:beyond], "dzt"))
    beside = path.with_suffix(".dzg")
    beside.unlink(missing_ok=True)
    sentences = len(good) + len(null) + len(unfixed) + beyond
    if sentences:
        beside.write_text("".join(lines))
    count = cut_short(path, cut)
    read = read_gpr(path)
    positions = len(good) + len(null) + beyond
    back = ", counted towards smaller positions" if per_metre < 0 else ""
    timed = not per_metre and per_second
    check_notes(
        read.history,
        "the first two samples of every trace are its number and marks",
        f"antennas {name!r}; the file tells no antenna separation",
        NAMES[name],
        None if tag == 0x00FF else "its tag is 0x0700",
        None if position else "the header puts time zero at the first sample",
        f"equal steps of {STEP:g} m, by {per_metre:g} scans per metre in the header{back}" if per_metre else None,
        "the traces' clock is that of 50 scans a second" if timed else None,
        CUT if cut else None,
        if_any(unfixed, f"{len(unfixed)} of {sentences} sentences of a.dzg tell no position"),
        if_any(null, f"{len(null)} of {positions} positions left out: 0 N 0 E"),
        if_any(far, f"{len(far)} of {positions} positions left out: no place on the Earth, or no trace"),
    )  # fmt: skip
    np.testing.assert_array_equal(read.traces[:, 0, 2:], COUNTS[:count, 2:])
    np.testing.assert_array_equal(read.fixes[:, 0], sorted(good))
    np.testing.assert_allclose(read.fixes[:, 2], LATITUDE[sorted(good)], atol=1e-8)
    assert read.marks == tuple(sorted(trace for trace in marks if trace < count))


# --- MALÅ and ImpulseRadar

ANTENNAS = {
    "500 MHz shielded": None,
    "500_shielded_0.18": "is one of 500 MHz, by the number that its name begins with",
    "GX450 HDR": "is one of 450 MHz, by the table of models",
    "": "the header names no antenna",
    "prototype 7": "is in no table of models",
}


def cor_row(trace, latitude, longitude, height):
    cells = [
        trace + 1,
        "2020-01-02",
        f"12:00:{trace:02d}",
        f"{latitude:.9f}",
        "N",
        f"{longitude:.9f}",
        "E",
    ]
    return "\t".join(
        map(str, [*cells, *([f"{height:.3f}", "M", "1.0"] if height is not None else [])])
    )


@pytest.mark.parametrize("ending", ["rd3", "rd7"])
@FUZZ
@given(
    wheel=st.booleans(),
    interval=st.sampled_from([STEP, 0.0]),
    timed=st.booleans(),
    antenna=st.sampled_from(sorted(ANTENNAS)),
    stated=STATED,
    cut=st.booleans(),
    good=some(0, 9, 6),
    flat=some(10, 15),
    null=some(16, 20),
    strange=st.integers(0, 3),
)
def test_mala(
    ending, wheel, interval, timed, antenna, stated, cut, good, flat, null, strange, tmp_path
):
    path = write_mala(
        tmp_path / f"a.{ending}",
        COUNTS,
        DISTANCE_FLAG=int(wheel),
        DISTANCE_INTERVAL=interval,
        TIME_FLAG=int(timed),
        ANTENNAS=antenna,
        LAST_TRACE=stated or "",
    )
    rows = [cor_row(k, LATITUDE[k], LONGITUDE[k], 400.0) for k in sorted(good)]
    rows += [cor_row(k, LATITUDE[k], LONGITUDE[k], None) for k in sorted(flat)]
    rows += [cor_row(k, 0.0, 0.0, 0.0) for k in sorted(null)]
    rows += [f"{22 + k}\tnothing" for k in range(strange)]
    beside = path.with_suffix(".cor")
    beside.unlink(missing_ok=True)
    if rows:
        beside.write_text("\n".join(rows))
    count = cut_short(path, cut)
    read = read_gpr(path)
    placed = wheel and interval
    check_notes(
        read.history,
        NO_ZERO,
        ANTENNAS[antenna],
        f"equal steps of {STEP:g} m, by DISTANCE INTERVAL in the header" if placed else None,
        "DISTANCE FLAG is 0: no wheel was used" if interval and not wheel else None,
        "a trace every 0.1 s, by TIME INTERVAL in the header" if timed else None,
        CUT if cut else None,
        stated_note(stated, count),
        f"{strange} of {len(rows)} lines of a.cor were not understood" if strange else None,
        if_any(null, f"{len(null)} of {len(rows) - strange} positions left out: 0 N 0 E"),
        if_any(flat, f"{len(flat)} of {len(good | flat)} positions tell no height: 0 m is taken"),
    )
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS[:count])
    np.testing.assert_array_equal(read.fixes[:, 0], sorted(good | flat))
    assert (read.time is not None) == timed


@FUZZ
@given(
    own=st.booleans(),
    time=st.booleans(),
    zero=st.booleans(),
    version=st.booleans(),
    antenna=st.sampled_from(["500 MHz", "", "CO4080"]),
    stated=STATED,
    cut=st.booleans(),
)
def test_iprb(own, time, zero, version, antenna, stated, cut, tmp_path):
    entries = {"USER_DISTANCE_INTERVAL": 2 * STEP} if own else {}
    entries |= {"TRIG_SOURCE": "time"} if time else {}
    entries |= {} if zero else {"ZERO_LEVEL": ""}
    entries |= {} if version else {"DATA_VERSION": ""}
    path = write_impulse(
        tmp_path / "a.iprb", COUNTS, ANTENNA=antenna, LAST_TRACE=stated or "", **entries
    )
    count = cut_short(path, cut)
    read = read_gpr(path)
    name = "USER DISTANCE INTERVAL" if own else "DISTANCE INTERVAL"
    step = 2 * STEP if own else STEP
    check_notes(
        read.history,
        None if zero else NO_ZERO,
        None if version else "the header tells no DATA VERSION: samples are read as 16 bit",
        {"": "names no antenna", "CO4080": "is in no table of models"}.get(antenna),
        f"TRIG SOURCE is time: no wheel was used, and {name}" if time else None,
        None if time else f"equal steps of {step:g} m, by {name} in the header",
        CUT if cut else None,
        stated_note(stated, count),
    )
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS[:count])
    if time:
        assert read.distance is None
    else:
        np.testing.assert_allclose(read.distance, step * np.arange(count))


# --- IDS


@FUZZ
@given(
    unsigned=st.sampled_from([0, 20_000]),
    lost=st.one_of(st.none(), st.integers(0, TRACES - 2)),
    stated=STATED,
    cut=st.booleans(),
)
def test_ids(unsigned, lost, stated, cut, tmp_path):
    path = write_ids(tmp_path / "a.dt", COUNTS, unsigned=unsigned, lost=lost, traces=stated)
    count = cut_short(path, cut)
    read = read_gpr(path)
    check_notes(
        read.history,
        "the layout of IDS files is not published",
        f"counts taken as {'unsigned' if unsigned else 'signed'}, by their smaller leaps",
        NO_ZERO,
        f"equal steps of {STEP:g} m, by the header's step",
        "two numbers of H may be the distance of the traces",
        None if lost is None else "1 traces without data, as their marks say",
        CUT if cut else None,
        stated_note(stated, count),
    )
    kept = [k for k in range(count) if k != lost]
    np.testing.assert_array_equal(read.traces[kept, 0], COUNTS[kept])


# --- SEG-Y and Seismic Unix

COORDINATES = {
    "source": (72, "source coordinates (bytes 73-80)"),
    "group": (80, "group coordinates (bytes 81-88)"),
    "cdp": (180, "CDP coordinates (bytes 181-188)"),
}
FAR = 50_000_000  # cm of a map's coordinate
TRACE_WORDS = {
    "dead": some(2, 8),
    "missing": some(9, 12),
    "late": some(0, 29),
    "weighted": some(0, 29),
    "paced": some(1, 29),
    "counted_otherwise": some(1, 29),
    "gather": st.booleans(),
    "where": st.sampled_from([*COORDINATES, "none", "same"]),
    "also": st.booleans(),
    "receiver": st.sampled_from(["untold", "beside", "moving"]),
    "nowhere": some(12, 20),
    "unit": st.sampled_from([1, 0]),
    "cut": st.booleans(),
}


def segy_like(path, start, order, width, drawn):
    """Set words of the trace headers of a SEG-Y or SU as drawn; return the notes that tell of them."""
    d = drawn
    record = 240 + width * SAMPLES
    at = [start + k * record for k in range(TRACES)]
    patches = []

    def put(traces, offset, form, value):
        patches.extend(
            (at[k] + offset, order + form, value(k) if callable(value) else value) for k in traces
        )

    every = range(TRACES)
    for offset, _ in COORDINATES.values():
        put(every, offset, "i", 0)
        put(every, offset + 4, "i", 0)
    put(every, 70, "h", -100)
    put(every, 88, "h", d["unit"])
    placed = d["where"] in COORDINATES
    nowhere = d["nowhere"] if placed else set()
    if d["where"] == "same":
        put(every, 72, "i", FAR)
    if placed:
        offset, _ = COORDINATES[d["where"]]
        put(set(every) - nowhere, offset, "i", lambda k: FAR + round(100 * STEP * k))
    also = placed and d["also"] and d["where"] != "cdp"
    if also:
        put(every, 180, "i", lambda k: FAR + 7 * k)
    paired = d["where"] == "source" and d["receiver"] != "untold"
    if paired:
        moving = d["receiver"] == "moving"
        put(set(every) - nowhere, 80, "i", lambda k: FAR + round(100 * STEP * k))
        put(set(every) - nowhere, 84, "i", lambda k: 50 + 10 * k if moving else 50)
    put(d["dead"], 28, "h", 2)
    put(d["late"], 108, "h", 40)
    put(d["weighted"], 168, "h", 3)
    put(d["paced"], 116, "H", 333)
    put(d["counted_otherwise"], 114, "H", 99)
    if d["gather"]:
        put(every, 36, "i", lambda k: k)
    patched(path, *patches)
    count = cut_short(path, d["cut"])
    read_traces = set(range(count))
    dead = d["dead"] & read_traces
    late = d["late"] & read_traces
    weighted = d["weighted"] & read_traces
    paced = d["paced"] & read_traces
    other = d["counted_otherwise"] & read_traces
    name = COORDINATES[d["where"]][1] if placed else ""
    notes = [
        NO_ZERO,
        "the sample interval is taken as picoseconds",
        CUT if d["cut"] else None,
        if_any(dead, f"{len(dead)} traces without data, as their headers say"),
        if_any(late, f"the delay of the recording of {len(late)} traces is not applied"),
        if_any(weighted, f"the weighting factors of {len(weighted)} traces"),
        if_any(paced, f"{len(paced)} trace headers tell another sample interval"),
        if_any(other, f"{len(other)} trace headers tell 99 to 99 samples: all traces are read"),
        f"goes from 0 to {count - 1}: it is not used" if d["gather"] else None,
        "source coordinates (bytes 73-80) are the same in all traces"
        if d["where"] == "same"
        else None,
        f"the traces' coordinates, the {name}" if placed else None,
        "the unit of its coordinates is 0: they are taken as lengths"
        if placed and d["unit"] == 0
        else None,
        if_any(nowhere, f"{len(nowhere)} of {count} traces are at 0, 0, far from all others"),
        "the CDP coordinates (bytes 181-188) are not used" if also else None,
        "the antennas' separation is the distance of source" if paired and not moving else None,
        "the group coordinates (bytes 81-88) are not used" if paired and moving else None,
        "its antennas move apart (antennas 0.5 to" if paired and moving else None,
    ]
    return count, notes


def check_segy_like(read, counts, count, drawn):
    kept = [k for k in range(count) if k not in drawn["dead"]]
    np.testing.assert_array_equal(read.traces[kept, 0], counts[kept])
    assert np.isnan(read.traces[[k for k in drawn["dead"] if k < count], 0]).all()
    paired = drawn["where"] == "source" and drawn["receiver"] != "untold"
    assert read.separation == (0.5 if paired and drawn["receiver"] == "beside" else None)
    assert bool(read.gather) == (paired and drawn["receiver"] == "moving")
    if drawn["where"] in COORDINATES:
        np.testing.assert_allclose(read.distance, ALONG[:count], atol=1e-6)
    else:
        assert read.distance is None


@FUZZ
@given(
    code=st.sampled_from([2, 3, 5]),
    system=st.sampled_from([0, 1, 9]),
    drawn=st.fixed_dictionaries(TRACE_WORDS),
)
def test_segy(code, system, drawn, tmp_path):
    missing = drawn["missing"] if code == 5 else set()
    counts = holes(COUNTS, missing) if code == 5 else COUNTS
    path = write_segy(tmp_path / "a.sgy", counts, code=code)
    patched(path, (3254, ">H", system))
    width = 2 if code == 3 else 4
    if drawn["cut"]:
        # A file that is no whole number of traces needs its trace headers to tell the samples.
        segy_words(path, TRACES, width=width, samples=(114, ">H", SAMPLES))
    count, expected = segy_like(path, 3600, ">", width, drawn)
    read = read_gpr(path)
    check_notes(
        read.history,
        *expected,
        "its measurement system is 9, which does not exist" if system == 9 else None,
        if_any(missing, f"{len(missing)} of {count} traces hold samples that are no numbers"),
    )
    check_segy_like(read, counts, count, drawn)


@FUZZ
@given(order=st.sampled_from("<>"), drawn=st.fixed_dictionaries(TRACE_WORDS))
def test_su(order, drawn, tmp_path):
    drawn = drawn | {"cut": False}  # the byte order shows in a whole number of traces
    counts = holes(COUNTS, drawn["missing"])
    path = write_su(tmp_path / "a.su", counts, order=order)
    count, expected = segy_like(path, 0, order, 4, drawn)
    read = read_gpr(path)
    check_notes(
        read.history,
        *expected,
        f"the byte order is taken as {'big' if order == '>' else 'little'}-endian",
        if_any(
            drawn["missing"],
            f"{len(drawn['missing'])} of {count} traces hold samples that are no numbers",
        ),
    )
    check_segy_like(read, counts, count, drawn)


# --- OpenGPR


@FUZZ
@given(
    placed=st.booleans(),
    srs=st.sampled_from([32632, 0]),
    lost=some(1, TRACES - 2),
    missing=some(0, TRACES - 1),
    kind=st.sampled_from(["<f4", "<i2"]),
    channels=st.sampled_from([1, 3]),
)
def test_ogpr(placed, srs, lost, missing, kind, channels, tmp_path):
    missing = missing if kind == "<f4" else set()
    counts = np.stack([holes(COUNTS, missing)] * channels, axis=1) if kind == "<f4" else None
    counts = np.stack([COUNTS] * channels, axis=1) if counts is None else counts
    places = way(TRACES)
    places[sorted(lost), 0] = np.nan
    path = write_ogpr(tmp_path / "a.ogpr", counts, kind, places if placed else None, srs)
    read = read_gpr(path)
    known = [k for k in range(TRACES) if k not in lost]
    check_notes(
        read.history,
        NO_ZERO,
        "blocks found and not understood: Markers",
        "polarization 'horizontal' of the descriptor is not used",
        "the propagation velocity 1e+08 m/s of the descriptor is not used",
        None if placed else f"equal steps of {STEP:g} m, by samplingStep_m",
        "the distance along the line is that of the traces' coordinates" if placed else None,
        if_any(lost, f"{len(lost)} of {TRACES} Sample Geolocations are no places")
        if placed
        else None,
        "name no reference system" if placed and not srs else None,
        "heights are taken as ellipsoidal" if placed and srs else None,
        if_any(missing, f"{len(missing)} of {TRACES} traces hold samples that are no numbers"),
    )
    np.testing.assert_array_equal(read.traces, counts)
    assert read.fixes[:, 0].tolist() == (known if placed and srs else [])
    if placed:
        np.testing.assert_allclose(read.distance, 0.5 * np.arange(TRACES), atol=1e-6)


def test_offsets_of_words_are_those_of_the_reader(tmp_path):
    """A word that these tests set wrongly would be one that no note can tell of."""
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    record = 128 + 2 * SAMPLES
    patched(path, (record + 4 * 21, "<f", 1.0))
    assert np.flatnonzero(np.isnan(read_gpr(path).traces[:, 0, 0])).tolist() == [1]
    assert struct.unpack_from("<f", path.read_bytes(), 4 * 6)[0] == np.float32(WINDOW)
