import struct

import numpy as np
import pytest

from flgpr.live.senders import FrameStream, largest_frame
from flgpr.store import ScanFileError, describe_for_live, encode_frame, encode_scan
from flgpr.store.scan_file import LARGEST_FRAME, MAGIC
from live_lane import make_lane_run

"""Frames are cut out of the bytes of a socket: bounded, and on after a bad one."""


RUN = make_lane_run(scans=2)


DESCRIPTION = describe_for_live(RUN)


DESCRIBED = encode_frame("run", DESCRIPTION.as_json())


SCAN = encode_scan(0, RUN["signal"].values[0], np.zeros(6), 0.0, DESCRIPTION.run_id)


def stated(size):
    """The head of a frame of that many bytes in all."""
    return struct.pack("<8sIQ", MAGIC, 0, size - 24)


@pytest.mark.parametrize(
    ("described", "most"), [(False, 2**22 + 2**10), (True, largest_frame(DESCRIPTION))]
)
def test_a_frame_that_is_larger_than_any_of_the_run_is_not_waited_for(described, most):
    stream = FrameStream(most if described else None)
    assert list(stream.take(stated(most), False)) == []
    stream = FrameStream(most if described else None)
    (arrival,) = stream.take(stated(most + 1), False)
    assert str(arrival.value) == f"frame must have at most {most} bytes, got {most + 1}"
    assert stream.waiting < 24
    assert [one.data for one in stream.take(SCAN, False)] == [SCAN]


def test_scans_may_be_as_large_as_their_own_description_makes_them():
    large = DESCRIPTION.as_json() | {"frequency_hz": list(np.linspace(1e9, 2e9, 200_000))}
    stream = FrameStream()
    (arrival,) = stream.take(encode_frame("run", large), False)
    assert arrival.kind == "run"
    size = 8 * 200_000 * len(large["polarization"]) * len(large["tx_m"])
    assert 2**22 < size < LARGEST_FRAME
    assert list(stream.take(stated(size), False)) == []


def test_a_frame_full_of_beginnings_costs_little(monkeypatch):
    """Each could be that of the next good frame; they are not all tried again with every part that comes."""
    tried = []
    monkeypatch.setattr(
        "flgpr.live.senders.decode_frame", lambda data: tried.append(1) or _no_frame()
    )
    stream = FrameStream(2**20)
    stream._usual = 100
    beginnings = struct.pack("<8sIQ", MAGIC, 10, 50_000) * 100
    for part in [stated(2**20), *[beginnings] * 20]:
        assert list(stream.take(part, False)) == []
    assert 0 < len(tried) <= 21 * 16


def _no_frame():
    raise ScanFileError("no frame")


def test_a_length_that_is_too_large_costs_no_frame_that_follows():
    """A sender that never pauses: what follows the bad frame comes as it is sent, not when the length is filled."""
    samples = RUN["signal"].values[0]
    frames = []
    for number in range(40):
        frames.append(encode_scan(number, samples, np.zeros(6), 0.0, DESCRIPTION.run_id))
    head = bytearray(frames[5])
    struct.pack_into("<Q", head, 12, struct.unpack_from("<Q", head, 12)[0] + 30 * len(frames[0]))
    stream = FrameStream()
    kinds = []
    for sent, frame in enumerate([*frames[:5], bytes(head), *frames[6:]]):
        kinds += ["bad" if one.value is not None else one.kind for one in stream.take(frame, False)]
        assert sent < 7 or len(kinds) >= sent
    assert kinds == ["frame"] * 5 + ["bad"] + ["frame"] * 34
