"""A few bytes that would take any amount of memory or time when they are read are refused before.

Every bomb is a real one, or its small sister with a lowered budget. Memory is measured.
"""

import gzip
import io
import json
import struct
import time
import tracemalloc
from contextlib import contextmanager, nullcontext

import h5py
import numpy as np
import pytest

from flgpr import budget, toml_text
from flgpr.budget import Budget
from flgpr.formats import child
from flgpr.formats.arrays import check_dataset, open_arrays
from flgpr.json_text import parse_json
from flgpr.live.recording import read_recording
from flgpr.live.senders import FrameStream
from flgpr.recipe.schema import parse_recipe
from flgpr.store import ScanFileError, parse_description, scan_file
from flgpr.store.scan_file import encode_frame
from flgpr.toml_text import parse_toml
from flgpr_exchange.bags import cdr, recording
from flgpr_exchange.bags.cdr import message_decoder
from flgpr_exchange.bags.container import McapContainer
from flgpr_exchange.bags.recording import Recording
from flgpr_exchange.gpr import dzx
from flgpr_exchange.gpr.dzx import read_dzx


@contextmanager
def within(megabytes, seconds=20.0):
    """Check that no more memory and time is taken."""
    begin = time.process_time()
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < megabytes * 1e6, f"{peak / 1e6:.0f} MB"
    assert time.process_time() - begin < seconds


def test_a_budget_counts_what_is_spent():
    budget = Budget("a thing", 1000)
    budget.spend_values(9)
    budget.spend(100)
    with pytest.raises(
        ValueError, match=r"a thing would take 0.001001 MB .* and may take 0.001 MB"
    ):
        budget.spend(1)


def mcap(path, encoding, data, definition="", topic="/a"):
    """Write a recording of one message."""
    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("made/A", "ros2msg", definition.encode()) if definition else 0
    channel = writer.register_channel(topic, encoding, schema)
    writer.add_message(channel, 1, data, 1)
    writer.finish()
    path.write_bytes(out.getvalue())
    return path


def fault_of(path):
    """Return why the messages of a recording are not read."""
    opened = Recording(path, 2 * 10**9)
    return " ".join([*opened.lines, *opened.notes])


def nested(levels, leaf):
    """Return a definition of types that each hold the next one twice."""
    text = "A1 a\nA1 b\n"
    for level in range(1, levels):
        text += f"===\nMSG: made/A{level}\nA{level + 1} a\nA{level + 1} b\n"
    return text + f"===\nMSG: made/A{levels}\n{leaf}\n"


@pytest.mark.parametrize("leaf", ["float64[0] none", "uint8 one", ""])
def test_a_definition_that_nests_38_types_is_refused(leaf, tmp_path):
    path = mcap(tmp_path / "a.mcap", "cdr", b"\0\1\0\0" + bytes(100), nested(38, leaf))
    with within(20):
        assert "must hold at most 100000 fields" in fault_of(path)


def test_fields_of_no_bytes_are_counted():
    """A type of many fields, none of which takes a byte, may not be much larger than its message."""
    decode = message_decoder("made/A", nested(14, "float64[0] none"))
    with within(5), pytest.raises(ValueError, match="a message of 4 bytes would take"):
        decode(b"\0\1\0\0")


def test_millions_of_empty_messages_in_one_are_refused(tmp_path):
    definition = "Empty[] all\n===\nMSG: made/Empty\n"
    count = 60_000_000
    content = b"\0\1\0\0" + struct.pack("<I", count) + bytes(count)
    path = mcap(tmp_path / "a.mcap", "cdr", content, definition)
    assert path.stat().st_size < 20_000
    with within(4 * count / 1e6 + 20):  # the chunk, its record and the message itself
        assert "would take 6000 MB of memory or more" in fault_of(path)


def test_records_without_content_take_little_memory(tmp_path, monkeypatch):
    """Nine bytes of a chunk are a record: millions of them are nothing."""
    data = (b"\5" + bytes(8)) * 20_000
    container = McapContainer(tmp_path, len(data))
    monkeypatch.setattr(container, "_unpacked", lambda content: data)
    with within(1):
        count = sum(1 for _ in container._chunk(b""))
    assert (count, container.damage.damaged_chunks) == (20_000, 0)


@pytest.mark.parametrize("as_list", [False, True])
def test_paths_of_json_that_take_the_square_are_refused(as_list, tmp_path, monkeypatch):
    """Every number below a long name has that name in its path."""
    monkeypatch.setattr(recording, "MOST_MESSAGE", 20 * 10**6)
    leaves = {str(number): number for number in range(2_000)}
    content = {"k" * 100_000: [leaves] if as_list else leaves}
    if as_list:
        content = [content]
        content = {"all": content}
    path = mcap(tmp_path / "a.mcap", "json", json.dumps(content).encode())
    assert path.stat().st_size < 30_000
    with within(60):
        assert "the fields of a message would take" in fault_of(path)


def test_the_message_of_the_attack_is_refused_with_its_own_budget(tmp_path):
    content = {"k" * 1_000_000: {str(number): number for number in range(9_000)}}
    path = mcap(tmp_path / "a.mcap", "json", json.dumps(content).encode())
    with within(300):
        assert "the fields of a message would take" in fault_of(path)


def test_json_of_too_many_values_or_levels_in_a_message_is_damage(tmp_path):
    for data in (b"[" * 200 + b"]" * 200, b'{"a": "\\ud800"}'):
        path = mcap(tmp_path / "a.mcap", "json", data)
        assert "1 of 1 messages are damaged" in fault_of(path)


def test_half_a_character_and_numbers_without_end_are_no_json():
    assert parse_json('{"a": "\\ud83d\\ude00"}') == {"a": "\U0001f600"}
    assert parse_json("[" + "7" * 299 + "]") == [int("7" * 299)]
    assert parse_json('["' + "7" * 4000 + '"]') == ["7" * 4000]
    halves = [b'["\\ud800"]', b'{"\\uDFFF": 1}', b'["\xed\xa0\x80"]', '["\ud800"]']
    halves += [b'["\\ud800"]'.decode().encode("utf-16"), '["\\uDC00"]'.encode("utf-16-le")]
    for text in halves:
        with pytest.raises(ValueError, match=r"must be of whole characters, got half of one, U\+D"):
            parse_json(text)
    for digits in (400, 5000):
        with pytest.raises(ValueError, match=f"at most 300 digits, got {digits}"):
            parse_json("[" + "7" * digits + "]")
    assert cdr.MOST_MESSAGE < 10**9


def hdf5(path, shape, chunks, **options):
    """Write an HDF5 array of zeros that may grow."""
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "a", shape, "f8", chunks=chunks, maxshape=(None,), compression="gzip", **options
        )[:] = 0.0
    return path


@pytest.mark.parametrize("count", [10, 400_000])
def test_a_chunk_of_an_array_that_is_larger_than_it_is_not_unpacked(count, tmp_path, monkeypatch):
    monkeypatch.setattr(child, "_MOST_CHUNK", 2**17)
    small = hdf5(tmp_path / "a.h5", (max(count // 100, 1),), (2 * count,))
    is_refused = 16 * count > 2**17  # a small chunk may be of any array
    expected = pytest.raises(ValueError, match=r"a cannot be read: its .* bytes lie in chunks of")
    with within(20), h5py.File(small) as file, expected if is_refused else nullcontext():
        check_dataset("a", file["a"])
    with h5py.File(hdf5(tmp_path / "b.h5", (2 * count,), (2 * count,))) as file:
        assert check_dataset("a", file["a"]) is None


def test_an_hdf5_file_with_such_a_chunk_says_so_and_reads_the_rest(tmp_path):
    path = hdf5(tmp_path / "a.h5", (10,), (10,))
    with h5py.File(path, "a") as file:
        # Nothing of it is written: it takes a kilobyte.
        file.create_dataset("bomb", (10,), "f8", chunks=(490_000_000,), maxshape=(None,))
    opened = open_arrays(path)
    assert list(opened.arrays) == ["a"]
    [line] = opened.about
    assert line.startswith("bomb: not read: its 80 bytes lie in chunks of 3920000000")


def test_one_text_that_many_places_name_does_not_get_their_room(tmp_path, monkeypatch):
    """HDF5 shares texts, NumPy gives each the room of the longest."""
    monkeypatch.setattr(budget, "MOST_MEMORY", 10**6)
    texts = np.array(["x" * 1000] + ["y"] * 999, dtype=object)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["texts"] = texts
        file["few"] = texts[1:]
    opened = open_arrays(tmp_path / "a.h5")
    assert opened.read("few").shape == (999,)
    with within(3), pytest.raises(ValueError, match="the texts texts would take 4 MB"):
        opened.read("texts")


def test_a_recording_of_events_unpacks_to_what_it_states(tmp_path):
    parts = gzip.compress(b" " * 10**7) + gzip.compress(b"{}\n")
    (tmp_path / "a.gz").write_bytes(parts)
    with within(2), pytest.raises(ValueError, match="must unpack to the 3 bytes that it states"):
        read_recording(tmp_path / "a.gz")


def test_an_xml_of_millions_of_elements_is_not_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr(dzx, "_MOST_MEMORY", 10**6)
    few = tmp_path / "few.dzx"
    few.write_text("<DZX><unitsPerScan>0.02</unitsPerScan>" + "<a/>" * 900 + "</DZX>")
    notes: list[str] = []
    assert read_dzx(few, 10, notes).spacing == 0.02
    many = tmp_path / "many.dzx"
    many.write_text("<DZX><unitsPerScan>0.02</unitsPerScan>" + "<a/>" * 31_000 + "</DZX>")
    with within(2):
        assert read_dzx(many, 10, notes).spacing is None
    [note] = notes
    assert "many.dzx was found and not understood: its XML would take 3.1" in note


def description(polarizations=1, pairs=1, tones=1):
    """Return a description of a run of so many."""
    return {
        "format": "flgpr-live-run",
        "version": 1,
        "polarization": ["HH"] * polarizations,
        "frequency_hz": [1e9 + number for number in range(tones)],
        "tx_m": [[0, 0, 0]] * pairs,
        "rx_m": [[0, 0, 0]] * pairs,
    }


@pytest.mark.parametrize(
    ("counts", "rule"),
    [
        ((800, 500), "got 800 polarizations of 500 pairs and 1 tones, 3200000 bytes"),
        ((1, 700), "at most 512 pairs"),
        ((1, 400, 1_000), "3200000 bytes"),
        ((2, 60), "must name 2 different polarizations"),
    ],
)
def test_a_description_of_a_scan_that_no_radar_sends_is_refused(counts, rule, monkeypatch):
    monkeypatch.setattr(scan_file, "LARGEST_FRAME", 2**20)
    monkeypatch.setattr(scan_file, "_MOST_PAIRS", 2**9)
    content = description(*counts)
    with within(2), pytest.raises(ScanFileError, match=rule):
        parse_description(content)
    frame = encode_frame("run", content)
    with within(4):
        [arrival] = FrameStream().take(frame, True)
    assert arrival.kind == "run"


def test_a_scan_is_at_most_a_frame():
    assert scan_file.LARGEST_FRAME == 2**28
    assert scan_file._MOST_PAIRS == 2**16


def test_thousands_of_faults_are_counted_and_the_first_are_told():
    text = "".join(f"[unknown-table-{number}]\na = 1\n" for number in range(500))
    with within(100, seconds=20), pytest.raises(ValueError, match="and 488 more faults") as error:
        parse_recipe(text)
    assert len(str(error.value)) < 8000
    text = "".join(f"a{number} = 1\n" for number in range(500))
    with within(100, seconds=20), pytest.raises(ValueError, match=r"and .* more faults") as error:
        parse_recipe(f'[[clutter]]\nstage = "masks"\n{text}')
    assert len(str(error.value)) < 12_000


def test_long_names_and_values_are_shown_in_part():
    with pytest.raises(ValueError, match=r"xxx\.\.\.: no such entry") as error:
        parse_recipe("x" * 10**6 + " = 1\n")
    assert len(str(error.value)) < 2000
    with pytest.raises(ValueError, match=r"yyy\.\.\.'") as error:
        parse_recipe('image = "' + "y" * 10**6 + '"\n')
    assert len(str(error.value)) < 2000


def test_a_file_of_too_many_entries_is_no_toml(monkeypatch):
    assert toml_text._MOST_ENTRIES == 100_000
    monkeypatch.setattr(toml_text, "_MOST_ENTRIES", 1000)
    with within(1), pytest.raises(ValueError, match="at most 1000 entries and tables, got 1001"):
        parse_toml("".join(f"a{number}=1\n" for number in range(1001)))
    with within(1), pytest.raises(ValueError, match="at most 1000 entries and tables"):
        parse_toml("[[a]]\n" * 1003)
    assert len(parse_toml("a = [" + "1," * 2000 + "]")["a"]) == 2000
