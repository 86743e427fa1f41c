"""Header words that change the meaning, and headers in other layouts and encodings."""

import re
import struct

import numpy as np
import pytest

from flgpr.formats import explain_file, gpr_run, read_gpr
from io_gpr import (
    INTERVAL,
    SAMPLES,
    STEP,
    ZERO,
    write_dt1,
    write_dzt,
    write_impulse,
    write_mala,
)
from io_recordings import (
    ALONG,
    COUNTS,
    TRACES,
    notes_with,
    patched,
    set_dt1_words,
    two_headers,
)


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


@pytest.mark.parametrize(
    "mode",
    [
        "CMP/WARR",
        "WARR",
        "Multi-offset",
        "Transillumination",
        "Common Mid-Point",
        "common midpoint",
        "Wide Angle Reflection and Refraction",
        "C.M.P.",
    ],
)
def test_a_gather_is_no_line(mode, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE=mode)
    with pytest.raises(ValueError, match=f"its antennas move apart .{re.escape(mode)}"):
        gpr_run(read_gpr(path))
    assert (
        f"its antennas move apart ({mode}): it is no line of one offset" in explain_file(path).lines
    )
    assert explain_file(path).lines[-1].startswith("flgpr import gpr refuses it")


def test_places_of_the_antennas_tell_a_gather_too(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, SURVEY_MODE="Reflection")
    set_dt1_words(path, "receiver", [0.5 + 0.1 * k for k in range(TRACES)])
    assert read_gpr(path).gather == "antennas 0.5 to 3.4 apart"
    set_dt1_words(path, "receiver", [3.4 - 0.1 * k for k in range(TRACES)])
    assert read_gpr(path).gather == "antennas 0.5 to 3.4 apart"
    set_dt1_words(path, "receiver", [0.5 + k % 3 for k in range(TRACES)])
    assert not read_gpr(path).gather
    assert notes_with(
        read_gpr(path), "the trace headers put the antennas 0.5 to 2.5 apart, which is not used"
    )
    for line in ("Reflection", "Common-Offset", "common offset", "PROFILE"):
        read = read_gpr(write_dt1(tmp_path / "b.dt1", COUNTS, SURVEY_MODE=line))
        assert not read.gather
        assert not notes_with(read, "SURVEY MODE")
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
