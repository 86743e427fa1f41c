"""GSSI's DZT: tags, channels with headers of their own, old headers, and types of samples."""

import struct

import numpy as np
import pytest

from flgpr.formats import explain_file, gpr_run, read_gpr
from io_gpr import (
    INTERVAL,
    SAMPLES,
    STEP,
    ZERO,
    section,
    write_dzt,
)
from io_recordings import (
    ALONG,
    COUNTS,
    notes_with,
    patched,
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


def test_eight_bits_and_offsets_of_the_data(tmp_path):
    small = section(scale=40)
    read = read_gpr(write_dzt(tmp_path / "a.dzt", small[:, None], bits=8))
    np.testing.assert_array_equal(read.traces[:, 0, 2:], small[:, 2:])
    moved = write_dzt(
        tmp_path / "b.dzt", small[:, None], data=2048
    )  # no multiple of 1024: channels tell
    np.testing.assert_array_equal(read_gpr(moved).traces[:, 0, 2:], small[:, 2:])


def test_a_header_of_two_channels_before_traces_of_one(tmp_path):
    """The second header has no room, and the traces are counted on."""
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    patched(path, (52, "<H", 2))
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0, 2:], COUNTS[:, 2:])
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "the header tells 2 channels, has no room for their headers")
    assert not notes_with(read, "channel 1")


def test_traces_whose_numbers_stand_twice_are_told(tmp_path):
    both = write_dzt(tmp_path / "a.dzt", np.stack([COUNTS, -COUNTS], axis=1), names=("50400",) * 2)
    raw = both.read_bytes()
    path = tmp_path / "b.dzt"
    path.write_bytes(raw[:1024] + raw[2048:])
    patched(path, (52, "<H", 1), (2, "<H", 1))
    assert notes_with(read_gpr(path), "every trace number stands 2 times")
    assert not notes_with(read_gpr(both), "every trace number stands")
