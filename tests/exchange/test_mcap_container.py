"""MCAP files with a damaged part: what is whole is read, and what is lost is counted."""

import io
import struct
from collections import Counter

import numpy as np
import pytest

from bag import drive
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file
from flgpr_exchange.bags.container import McapContainer

pytest.importorskip("mcap_ros2")

MAGIC = b"\x89MCAP0\r\n"
CHUNK, INDEX, DATA_END = 6, 7, 15
POSES = 40
STEP = 0.2  # m of the drive from pose to pose


def chunks_of(data):
    """Return of each chunk the place and size of its packed data, and its messages as (topic, log time), by mcap."""
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import StreamReader, breakup_chunk

    topics = {}
    found = []
    at = 0
    for record in StreamReader(io.BytesIO(data), emit_chunks=True).records:
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        if not isinstance(record, Chunk):
            continue
        messages = []
        for inner in breakup_chunk(record):
            if isinstance(inner, Channel):
                topics[inner.id] = inner.topic
            if isinstance(inner, Message):
                messages.append((topics[inner.channel_id], inner.log_time))
        place = data.index(record.data, at)
        at = place + len(record.data)
        found.append((place, len(record.data), messages))
    return found


def with_damage(data, *numbers):
    """Turn a byte round in the middle of some chunks; return the file and the messages that are lost."""
    raw = bytearray(data)
    chunks = chunks_of(data)
    lost = []
    for number in numbers:
        place, size, messages = chunks[number]
        raw[place + size // 2] ^= 0xFF
        lost += messages
    return bytes(raw), lost


@pytest.mark.parametrize("compression", ["none", "zstd", "lz4"])
@pytest.mark.parametrize("numbers", [(3,), (2, 5)])
def test_a_damaged_chunk_costs_its_own_messages_alone(compression, numbers, tmp_path):
    data, lost = with_damage(drive(compression=compression), *numbers)
    (tmp_path / "a.mcap").write_bytes(data)
    opened = open_arrays(tmp_path / "a.mcap")
    (note,) = opened.notes
    counts = Counter(topic for topic, _ in lost)
    assert note.startswith(f"{len(numbers)} of {len(chunks_of(data_of(compression)))} chunks")
    assert f"with {len(lost)} messages" in note
    for topic, count in counts.items():
        assert f"{count} of {topic}" in note
    times = sorted(log for topic, log in of_all(compression) if topic == "/pose")
    left = [k for k, log in enumerate(times) if ("/pose", log) not in lost]
    assert len(left) == POSES - counts["/pose"]
    np.testing.assert_allclose(opened.read("/pose/pose.position.x"), STEP * np.array(left))
    assert opened.read("/tf/map>base/transform.translation.x").size == POSES - counts["/tf"]
    assert opened.notes == [note]  # told once, however often the file is gone through
    assert note in explain_file(tmp_path / "a.mcap").lines


def data_of(compression):
    return drive(compression=compression)


def of_all(compression):
    return [message for _, _, messages in chunks_of(data_of(compression)) for message in messages]


def test_the_summary_stands_in_for_declarations_in_a_damaged_chunk(tmp_path):
    """Schemas and channels are declared in the first chunk, and repeated behind the data."""
    data, lost = with_damage(drive(), 0)
    (tmp_path / "a.mcap").write_bytes(data)
    opened = open_arrays(tmp_path / "a.mcap")
    counts = Counter(topic for topic, _ in lost)
    assert counts["/pose"]
    assert opened.read("/pose/pose.position.x").size == POSES - counts["/pose"]
    np.testing.assert_array_equal(opened.read("/radar/iq")[:, 0], 100 * np.arange(5))
    assert f"with {len(lost)} messages" in opened.notes[0]
    end = next(begin for kind, begin in records_of(data) if kind == DATA_END)
    (tmp_path / "b.mcap").write_bytes(data[: end + 13])
    bare = open_arrays(tmp_path / "b.mcap")
    (count,) = (note.split()[0] for note in bare.notes if "that nothing declares" in note)
    read = sum(shape[0] for name, shape in shapes(bare) if name.endswith("@log_time"))
    assert int(count) == len(of_all("zstd")) - len(lost) - read


def shapes(opened):
    return [(name, info.shape) for name, info in opened.arrays.items()]


def test_records_up_to_the_damage_of_a_chunk_without_a_checksum_are_read(tmp_path):
    """The length of the last record in a chunk is wrong: that one message is lost, and the index tells so."""
    data = drive(compression="none", crcs=False)
    place, size, messages = chunks_of(data)[2]
    chunk = data[place : place + size]
    at = 0
    last = 0
    while at < size:
        last = at
        at += 9 + int.from_bytes(chunk[at + 1 : at + 9], "little")
    raw = bytearray(data)
    raw[place + last + 1 : place + last + 9] = (10**6).to_bytes(8, "little")
    (tmp_path / "a.mcap").write_bytes(raw)
    opened = open_arrays(tmp_path / "a.mcap")
    topic = messages[-1][0]
    assert opened.notes[0].endswith(
        f"with 1 messages: 1 of {topic} (a record goes beyond the end of its chunk)"
    )


def test_messages_that_no_index_counts_are_told_so(tmp_path):
    data, _ = with_damage(drive(), 3)
    raw = bytearray(data)
    for kind, begin in records_of(data):
        if kind == INDEX:
            raw[begin] = 0x80  # a record that readers pass over
    (tmp_path / "a.mcap").write_bytes(raw)
    assert "with messages that no index counts" in open_arrays(tmp_path / "a.mcap").notes[0]


def records_of(data):
    """Return kind and place of the records at the top of a file."""
    at = 8
    found = []
    while at + 9 <= len(data) - 8:
        found.append((data[at], at))
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return found


@pytest.mark.parametrize("share", [0.4, 0.7])
def test_a_recording_that_breaks_off_is_read_up_to_there(share, tmp_path):
    """As a recorder leaves it whose power fails: without an end, a summary, and the rest of a chunk."""
    data = drive()
    last = next(begin for kind, begin in records_of(data) if kind == DATA_END)
    stop = int(share * last)
    (tmp_path / "a.mcap").write_bytes(data[:stop])
    chunks = [begin for kind, begin in records_of(data) if kind == CHUNK]
    complete = sum(
        begin + 9 + int.from_bytes(data[begin + 1 : begin + 9], "little") <= stop
        for begin in chunks
    )
    messages = [one for _, _, inside in chunks_of(data)[:complete] for one in inside]
    poses = [log for topic, log in messages if topic == "/pose"]
    opened = open_arrays(tmp_path / "a.mcap")
    np.testing.assert_allclose(opened.read("/pose/pose.position.x"), STEP * np.arange(len(poses)))
    assert len(poses) > 5
    assert [note for note in opened.notes if "cut off before the end of its data" in note]


def test_a_recording_of_which_nothing_can_be_read_is_refused(tmp_path):
    data = drive()
    every, _ = with_damage(data, *range(len(chunks_of(data))))
    (tmp_path / "a.mcap").write_bytes(every)
    with pytest.raises(ValueError, match="holds no message that can be read"):
        open_arrays(tmp_path / "a.mcap")


def test_stray_and_short_messages_are_counted(tmp_path):
    data = drive(compression="none", crcs=False)
    stray = struct.pack("<HIQQ", 999, 0, 1, 1) + b"what"
    more = struct.pack("<BQ", 5, len(stray)) + stray + struct.pack("<BQ", 5, 3) + b"abc"
    bad_channel = struct.pack("<BQ", 4, 2) + b"\1\0"
    (tmp_path / "a.mcap").write_bytes(MAGIC + first(data) + more + bad_channel + rest(data))
    notes = open_arrays(tmp_path / "a.mcap").notes
    assert "1 messages without a whole head are left out" in notes
    assert "1 messages of channels that nothing declares are left out" in notes
    assert "1 records of schemas and channels are damaged" in notes


def first(data):
    """Return the header record of a file."""
    size = int.from_bytes(data[9:17], "little")
    return data[8 : 17 + size]


def rest(data):
    return data[len(MAGIC) + len(first(data)) :]


def test_records_are_those_of_the_library(tmp_path):
    data = drive()
    (tmp_path / "a.mcap").write_bytes(data)
    container = McapContainer(tmp_path / "a.mcap", 2**20)
    count = sum(kind == 5 for kind, _ in container.records())
    assert count == len(of_all("zstd"))
    assert container.damage.chunks == len(chunks_of(data))
    assert not container.damage.reason
