"""Frames of scans: what comes back, and that anything else is an error."""

import json
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flgpr.store import (
    ScanFileError,
    as_run,
    decode_frame,
    describe_for_live,
    encode_frame,
    encode_scan,
    parse_description,
    read_description,
    scan_of,
    write_description,
)
from flgpr.store.scan_file import MAGIC, TruncatedFrameError, pose_fault, stored_scan
from live_lane import make_lane_run

POSE = [1.0, 2.0, 1.5, 0.1, 0.0, -0.02]


@pytest.fixture
def description(small_run):
    return describe_for_live(small_run)


def test_a_scan_comes_back_as_it_was(small_run, description):
    signal = small_run["signal"].values[2]
    frame = encode_scan(17, signal, POSE, 4.25, description.run_id)
    scan = scan_of(decode_frame(frame), description)
    assert (scan.number, scan.time) == (17, 4.25)
    np.testing.assert_array_equal(scan.signal, signal)
    np.testing.assert_array_equal(scan.pose, POSE)
    run = as_run(description, scan)
    np.testing.assert_array_equal(run["signal"].values[0], signal)
    np.testing.assert_array_equal(run["frequency"].values, small_run["frequency"].values)


def test_the_layout_is_the_documented_one(small_run, description):
    """Built by hand from the documentation, not with our own writer."""
    signal = small_run["signal"].values[0].astype("<c8")
    header = json.dumps({"kind": "scan", "scan": 3, "time": None, "pose": POSE}).encode()
    body = b"FLGPRSC1" + struct.pack("<IQ", len(header), signal.nbytes) + header + signal.tobytes()
    scan = scan_of(decode_frame(body + struct.pack("<I", zlib.crc32(body))), description)
    assert scan.number == 3
    assert np.isnan(scan.time)
    np.testing.assert_array_equal(scan.signal, signal)


def test_the_description_comes_back(small_run, description, tmp_path):
    assert read_description(tmp_path) is None
    write_description(description, tmp_path)
    again = read_description(tmp_path)
    assert again.run_id == description.run_id
    assert again.shape == small_run["signal"].shape[1:]
    np.testing.assert_array_equal(again.tx_position, small_run["tx_position"].values)


def test_every_damaged_byte_and_every_cut_is_an_error(small_run, description):
    frame = encode_scan(1, small_run["signal"].values[0], POSE, 0.5, description.run_id)
    for at in range(0, len(frame), 3):
        with pytest.raises(ScanFileError):
            decode_frame(frame[:at] + bytes([frame[at] ^ 0x41]) + frame[at + 1 :])
    for cut in range(0, len(frame) - 1, 5):
        with pytest.raises(TruncatedFrameError):
            decode_frame(frame[:cut])
    with pytest.raises(ScanFileError, match="must end"):
        decode_frame(frame + b"x")


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=80), st.booleans())
def test_bytes_that_are_no_frame_are_errors(data, magic):
    with pytest.raises(ScanFileError):
        decode_frame(MAGIC * magic + data)


def test_a_frame_of_a_size_no_scan_has_is_refused_before_it_is_read():
    with pytest.raises(ScanFileError, match="which no scan has"):
        decode_frame(MAGIC + struct.pack("<IQ", 10, 2**60))


@pytest.mark.parametrize(
    ("header", "payload", "words"),
    [
        ({"scan": -1}, None, "number"),
        ({"scan": True}, None, "number"),
        ({"scan": 2**60}, None, "number"),
        ({"scan": 1, "run": "other"}, None, "another run"),
        ({"scan": 1}, b"12345678", "bytes of samples"),
    ],
)
def test_what_a_scan_must_hold(small_run, description, header, payload, words):
    samples = small_run["signal"].values[0].astype("<c8").tobytes() if payload is None else payload
    with pytest.raises(ScanFileError, match=words):
        scan_of(decode_frame(encode_frame("scan", header, samples)), description)


@pytest.mark.parametrize(
    "pose",
    [
        None,
        "north",
        [1, 2],
        [1, 2, 3, 99, 0, 0],
        [0, 0, 0, 0, 2.0, 0],
        [1e9, 0, 0, 0, 0, 0],
        [None] * 6,
    ],
)
def test_a_pose_that_makes_no_sense_is_none(small_run, description, pose):
    samples = small_run["signal"].values[0].astype("<c8").tobytes()
    frame = encode_frame("scan", {"scan": 1, "pose": pose, "time": "noon"}, samples)
    scan = scan_of(decode_frame(frame), description)
    assert scan.pose is None
    assert np.isnan(scan.time)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ("north", "pose must be six numbers, got 'north'"),
        ([1, 2], "pose must be six numbers, got [1, 2]"),
        ([None] * 6, "pose must be six finite numbers, got [None, None, "),
        ([1e9, 0, 0, 0, 0, 0], "pose must have coordinates below 1e+07 m, got [1000000000.0, 0"),
        ([1, 2, 3, 99, 0, 0], "pose must have a heading within a full turn, got [1, 2, 3, 99"),
        ([0, 0, 0, 0, 2.0, 0], "pose must have pitch and roll within a quarter turn, got [0, 0"),
        ([0] * 50_000, "pose must be six numbers, got [0, 0, 0"),
    ],
)
def test_what_makes_a_pose_none_is_told_in_few_words(small_run, pose, words):
    samples = small_run["signal"].values[0].astype("<c8").tobytes()
    fault = pose_fault(decode_frame(encode_frame("scan", {"scan": 1, "pose": pose}, samples)))
    assert fault.startswith(words)
    assert len(fault) < 200


@pytest.mark.parametrize("header", [{}, {"pose": None}, {"pose": [0, 0, 2, 0, 0, 0]}])
def test_a_pose_that_is_unknown_or_right_is_no_fault(header):
    assert pose_fault(decode_frame(encode_frame("scan", {"scan": 1, **header}))) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "x"}, "format"),
        ({"polarization": ["HH", "XX"]}, "polarization"),
        ({"frequency_hz": [1.0, 2.0]}, "hertz"),
        ({"frequency_hz": []}, "at least one tone"),
        ({"tx_m": [[0, 0, 0]]}, "tx_position|rx_position"),
        ({"tx_m": "left"}, "description"),
        ({"rx_m": [1, 2]}, "description"),
    ],
)
def test_a_description_that_breaks_a_rule(description, change, words):
    with pytest.raises(ScanFileError, match=words):
        parse_description(description.as_json() | change)


def test_a_description_that_cannot_be_read_names_its_file(description, tmp_path):
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(ScanFileError, match=r"run\.json"):
        read_description(tmp_path)
    value = description.as_json()
    del value["tx_m"]
    (tmp_path / "run.json").write_text(json.dumps(value))
    with pytest.raises(ScanFileError, match=r"run\.json.*tx_m"):
        read_description(tmp_path)


def test_a_stored_scan_is_as_it_would_arrive_and_changes_nothing():
    run = make_lane_run(scans=4)
    scan = stored_scan(run, 2)
    assert (scan.number, scan.time) == (2, float(run["time"][2]))
    np.testing.assert_array_equal(scan.pose, run["pose"].values[2])
    np.testing.assert_array_equal(scan.signal, run["signal"].values[2])
    scan.pose[1] += 1.0
    scan.signal[0, 0] = np.nan
    assert np.isfinite(run["signal"].values).all()
    assert run["pose"].values[2, 1] == scan.pose[1] - 1.0
