import os
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import FUZZ, damaged, refusal
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file, propose_mapping
from flgpr.formats.mapped import import_mapped
from flgpr_exchange.sigmf.reading import _column_of
from io_sigmf import DWELL, TONES, digest, stepped, write

STEPPED = """
title = "stepped"
files.data = "a.sigmf-meta"
polarization = ["VV"]
[signal]
variable = "sweeps"
dims = ["scan", "frequency", "pair"]
[frequency]
variable = "tones"
unit = "Hz"
[antenna_position]
values = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]
unit = "m"
[pose]
position = {variable = "sweeps/rig:position", unit = "m"}
heading = 0
pitch = 0
roll = 0
angle_unit = "deg"
[time]
variable = "sweeps/time"
unit = "s"
"""


@pytest.mark.parametrize("order", ["le", "be"])
@pytest.mark.parametrize("kind", ["f32", "f64", "i32", "i16", "u32", "u16", "i8", "u8"])
@pytest.mark.parametrize("letter", ["c", "r"])
def test_every_number_of_every_datatype_is_read_exactly(letter, kind, order, tmp_path):
    number = np.dtype(f"{'>' if order == 'be' else '<'}{kind[0]}{int(kind[1:]) // 8}")
    rng = np.random.default_rng(1)
    values = np.frombuffer(rng.integers(0, 100, 48 * number.itemsize, dtype=np.uint8), number)
    datatype = f"{letter}{kind}" + ("" if number.itemsize == 1 else f"_{order}")
    opened = open_arrays(write(tmp_path, values.tobytes(), {"core:datatype": datatype}))
    samples = opened.read("samples")
    assert samples.dtype == np.dtype(opened.arrays["samples"].dtype)
    if letter == "c":
        np.testing.assert_array_equal(samples.real, values[::2])
        np.testing.assert_array_equal(samples.imag, values[1::2])
    else:
        np.testing.assert_array_equal(samples, values)
    has_midpoint = any("midpoint of unsigned" in note for note in opened.notes)
    assert has_midpoint == (kind[0] == "u")


def test_channels_are_interleaved_sample_by_sample(tmp_path):
    samples, captures = stepped()
    path = write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures)
    opened = open_arrays(path)
    np.testing.assert_array_equal(opened.read("samples"), samples)
    segments = samples.reshape(len(captures), DWELL, 2)
    np.testing.assert_array_equal(opened.read("segments"), segments)
    np.testing.assert_array_equal(opened.read("captures/sample_start"), DWELL * np.arange(8))
    assert opened.arrays["tones"].unit == "Hz"
    # Either of the two files stands for the recording.
    beside = open_arrays(tmp_path / "a.sigmf-data")
    np.testing.assert_array_equal(beside.read("samples"), samples)


def test_a_sweep_is_the_mean_of_each_dwell(tmp_path):
    samples, captures = stepped(sweeps=2, extra=1)
    opened = open_arrays(write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures))
    means = samples.astype(complex).reshape(9, DWELL, 2).mean(axis=1)[:8].reshape(2, 4, 2)
    np.testing.assert_allclose(opened.read("sweeps"), means, rtol=1e-6)
    np.testing.assert_array_equal(opened.read("tones"), TONES)
    np.testing.assert_array_equal(np.diff(opened.read("sweeps/time")), [4.0])
    assert any("last 1 captures are no complete sweep" in note for note in opened.notes)


@pytest.mark.parametrize("change", ["length", "frequency", "missing"])
def test_captures_that_differ_make_no_sweeps(change, tmp_path):
    samples, captures = stepped()
    if change == "length":
        captures[3]["core:sample_start"] -= 1
    elif change == "frequency":
        captures[6]["core:frequency"] += 1.0
    else:
        del captures[6]["core:frequency"]
    opened = open_arrays(write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures))
    assert "sweeps" not in opened.arrays
    assert ("segments" in opened.arrays) == (change != "length")
    assert np.isnan(opened.read("captures/frequency")).sum() == (change == "missing")


@pytest.mark.parametrize("value", ["1 GHz", [1e9, 2e9], True, None, {"a": 1}])
@pytest.mark.parametrize("key", ["core:frequency", "core:datetime", "core:geolocation"])
def test_values_of_another_kind_leave_the_samples_readable(key, value, tmp_path):
    samples, captures = stepped()
    for capture in captures:
        capture[key] = value
    opened = open_arrays(write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures))
    assert ("sweeps" in opened.arrays) == (key != "core:frequency")
    np.testing.assert_array_equal(opened.read("samples"), samples)


def test_a_stepped_recording_becomes_a_run(tmp_path):
    samples, captures = stepped()
    content = {"core:num_channels": 2, "core:sha512": digest(samples.tobytes())}
    write(tmp_path, samples.tobytes(), content, captures)
    (tmp_path / "a.toml").write_text(STEPPED)
    arrived = import_mapped(tmp_path / "a.toml")
    means = samples.astype(complex).reshape(2, 4, DWELL, 2).mean(axis=2)
    signal = arrived.run["signal"].values[:, 0]
    np.testing.assert_allclose(signal, means.transpose(0, 2, 1), rtol=1e-6)
    np.testing.assert_allclose(arrived.run["pose"].values[:, 1], [0.0, 0.4])
    assert any("SHA-512 of the samples is that" in note for note in arrived.notes)


def test_a_draft_takes_the_sweeps(tmp_path):
    samples, captures = stepped()
    path = write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures)
    draft = propose_mapping(path)
    assert 'variable = "sweeps"' in draft
    assert 'variable = "tones"\nunit = "Hz"' in draft
    assert 'variable = "sweeps/time"\nunit = "s"' in draft
    assert '"sweeps/rig:position"' in draft
    assert "captures/" not in draft


def test_headers_and_other_bytes_of_a_foreign_file_are_left_out(tmp_path):
    values = (np.arange(6) + 1j).astype("<c8")
    first, second = values[:4].tobytes(), values[4:].tobytes()
    captures = [
        {"core:sample_start": 10, "core:header_bytes": 5},
        {"core:sample_start": 14, "core:header_bytes": 3},
    ]
    content = {"core:dataset": "raw.bin", "core:trailing_bytes": 2, "core:offset": 10}
    (tmp_path / "raw.bin").write_bytes(b"#####" + first + b"###" + second + b"##")
    opened = open_arrays(write(tmp_path, b"", content, captures))
    np.testing.assert_array_equal(opened.read("samples"), values)


def test_times_places_and_entries_of_extensions_are_arrays(tmp_path):
    point = {"type": "Point", "coordinates": [11.5, 48.1, 512.0]}
    captures = [
        {"core:sample_start": 0, "core:geolocation": point, "core:datetime": "yesterday"},
        {"core:sample_start": 2, "core:datetime": "1970-01-02T00:00:00Z", "rig:gain": 3},
        {"core:sample_start": 400},
    ]
    content = {
        "core:hw": "a\x1b[31m radio",
        "core:extensions": [{"name": "antenna", "version": "1.0.0", "optional": False}],
        "rig:labels": ["HH", "VV"],
        "rig:table": [[1.0, 2.0], [3.0, 4.5]],
        "rig:ragged": [[1.0], [2.0, 3.0]],
        "rig:infinite": 1e999,
    }
    path = write(tmp_path, np.ones(4, "<c8").tobytes(), content, captures)
    text = path.read_text().replace("Infinity", "1e999")
    path.write_text(text)
    opened = open_arrays(path)
    np.testing.assert_array_equal(opened.read("captures/longitude"), [11.5, np.nan])
    np.testing.assert_array_equal(opened.read("captures/height"), [512.0, np.nan])
    np.testing.assert_array_equal(opened.read("captures/time"), [np.nan, 86400.0])
    np.testing.assert_array_equal(opened.read("captures/rig:gain"), [np.nan, 3.0])
    np.testing.assert_array_equal(opened.read("global/rig:labels"), ["HH", "VV"])
    np.testing.assert_array_equal(opened.read("global/rig:table"), [[1.0, 2.0], [3.0, 4.5]])
    notes = "\n".join(opened.notes)
    assert "1 captures begin after the last sample and are ignored" in notes
    assert "core:datetime of 1 captures cannot be understood" in notes
    assert "extensions that are not known: 'antenna'" in notes
    lines = "\n".join(opened.about)
    assert "\x1b" not in lines
    assert "'global/rig:ragged': not read" in lines
    assert "'global/rig:infinite': not read" in lines
    assert "SHA-512 of the samples is not stated" in lines


@pytest.mark.parametrize(
    ("content", "captures", "rule"),
    [
        ({"core:datatype": "cf32"}, [], "core:datatype must be such as cf32_le"),
        ({"core:datatype": 7}, [], "core:datatype must be such as cf32_le"),
        ({"core:version": "2.0.0"}, [], "core:version must be at most 1.x"),
        ({"core:version": None}, [], "core:version must be such as"),
        ({"core:num_channels": 2**63 - 1}, [], "is it cut off"),
        ({"core:num_channels": 2**63}, [], "core:num_channels must be a whole number"),
        ({"core:num_channels": 3}, [], "is it cut off"),
        ({"core:num_channels": 0}, [], "core:num_channels must be a whole number"),
        ({"core:trailing_bytes": 2**62}, [], "is it cut off"),
        ({"core:sha512": "ab"}, [], "core:sha512 must be 128 hexadecimal digits"),
        ({"core:metadata_only": True}, [], "metadata alone"),
        ({}, [{"core:sample_start": -1}], "core:sample_start must be a whole number"),
        ({}, [{"core:sample_start": 10**250}], "core:sample_start must be a whole number"),
        ({}, [{"core:sample_start": True}], "core:sample_start must be a whole number"),
        ({}, [{}], "core:sample_start must be a whole number"),
        ({}, [{"core:sample_start": 0, "core:header_bytes": 2**62}], "is it cut off"),
        ({}, [{"core:sample_start": 2}, {"core:sample_start": 1}], "must be sorted"),
        ({"core:offset": 5}, [{"core:sample_start": 2}], "at least core:offset 5"),
        ({}, [[]], "each of captures must be an object"),
        ({"core:extensions": {}}, [], "core:extensions must be a list"),
    ],
)
def test_what_breaks_the_specification_is_named(content, captures, rule, tmp_path):
    path = write(tmp_path, np.ones(4, "<c8").tobytes(), content, captures)
    with pytest.raises(ValueError, match=rule) as caught:
        open_arrays(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("name", ["../secret.bin", "/etc/passwd", "sub/secret.bin", "..", "", 3])
def test_a_name_of_samples_that_leads_elsewhere_is_refused(name, tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(32))
    inner = tmp_path / "inner"
    (inner / "sub").mkdir(parents=True)
    (inner / "sub" / "secret.bin").write_bytes(bytes(32))
    path = write(inner, b"", {"core:dataset": name})
    with pytest.raises(ValueError, match=r"core:dataset must be|stay inside"):
        open_arrays(path)


def test_samples_behind_a_link_or_a_pipe_are_refused(tmp_path):
    path = write(tmp_path, np.ones(4, "<c8").tobytes())
    samples = tmp_path / "a.sigmf-data"
    samples.rename(tmp_path / "secret.bin")
    samples.symlink_to(tmp_path / "secret.bin")
    with pytest.raises(ValueError, match="symbolic link"):
        open_arrays(path)
    samples.unlink()
    if hasattr(os, "mkfifo"):
        os.mkfifo(samples)
        with pytest.raises(ValueError, match="a pipe"):
            open_arrays(path)
        samples.unlink()
    with pytest.raises(ValueError, match=r"a\.sigmf-data"):
        open_arrays(path)


def test_samples_of_another_digest_are_not_returned(tmp_path):
    data = np.ones(4, "<c8").tobytes()
    path = write(tmp_path, data, {"core:sha512": digest(data).upper()})
    assert open_arrays(path).read("samples").size == 4
    path = write(tmp_path, data[:-1] + b"\1", {"core:sha512": digest(data)})
    opened = open_arrays(path)
    assert "is checked when they are read" in opened.about[-1]
    with pytest.raises(ValueError, match="its SHA-512 is another"):
        opened.read("samples")


def test_samples_that_change_while_they_are_read_are_refused(tmp_path):
    path = write(tmp_path, np.ones(4, "<c8").tobytes())
    opened = open_arrays(path)
    (tmp_path / "a.sigmf-data").write_bytes(np.ones(2, "<c8").tobytes())
    with pytest.raises(ValueError, match="must stay as it is"):
        opened.read("samples")


def test_the_limit_is_on_what_samples_take_in_memory(tmp_path):
    captures = [
        {"core:sample_start": 1000 * number, "core:frequency": 1e9 + number} for number in range(2)
    ]
    path = write(tmp_path, bytes(4000), {"core:datatype": "ci8"}, captures)
    opened = open_arrays(path, limit=5000)
    for name in ("samples", "segments", "sweeps"):
        with pytest.raises(ValueError, match="at most"):
            opened.read(name)
    with pytest.raises(ValueError, match="at most"):
        open_arrays(path, limit=3000)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('{"global": {"core:x": NaN}}', "JSON, which has no NaN"),
        ('{"global": {"core:x": -Infinity}}', "JSON, which has no -Infinity"),
        ("[" * 100_000 + "]" * 100_000, "nested at most"),
        ('{"global": {"a:b": ' + "[" * 150 + "]" * 150 + "}}", "nested at most"),
        ("[1, 2]", "the metadata must be an object"),
        ('{"global": []}', "global must be an object"),
        ('{"global": {}}', "captures must be a list"),
        ('{"global": {"core:x": ' + "9" * 5000 + "}}", "cannot be read"),
        ("", "cannot be read"),
        ("\x00\x01", "cannot be read"),
    ],
)
def test_metadata_that_are_no_metadata_are_refused(text, rule, tmp_path):
    path = write(tmp_path, bytes(8))
    path.write_text(text)
    with pytest.raises(ValueError, match=rule) as caught:
        open_arrays(path)
    assert str(path) in str(caught.value)


def test_a_long_text_does_not_make_every_row_as_long(tmp_path):
    captures = [{"core:sample_start": number, "rig:note": "b"} for number in range(500)]
    captures[0]["rig:note"] = "a" * 100_000
    opened = open_arrays(write(tmp_path, np.ones(500, "<c8").tobytes(), {}, captures))
    assert "captures/rig:note" not in opened.arrays
    assert "'captures/rig:note': not read: no numbers or short texts" in opened.about


@pytest.mark.parametrize("other", ["b", 1])
def test_a_long_text_takes_its_own_memory_alone(other):
    """NumPy gives every row the room of the longest text: 800 MB here."""
    column = [other] * 20_000
    column[7] = "a" * 10_000
    tracemalloc.start()
    assert _column_of(column) is None
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**23


def test_names_that_one_capture_alone_has_take_no_room_for_all(tmp_path):
    """The time and memory of a reader that takes every name of every capture grow with a square."""
    captures = [{"core:sample_start": n, f"rig:n{n}": n} for n in range(20_000)]
    opened = open_arrays(write(tmp_path, bytes(20_000 * 8), {}, captures))
    assert len(opened.arrays) < 450
    assert any("captures: 19601 names after the first 400: not read" in x for x in opened.about)


@pytest.mark.parametrize("name", ["a.sigmf", "a.sigmf-collection"])
def test_archives_and_collections_are_to_be_unpacked(name, tmp_path):
    (tmp_path / name).write_bytes(b"{}")
    with pytest.raises(ValueError, match=r"unpack it .* \.sigmf-meta of one recording"):
        open_arrays(tmp_path / name)


def read_all(path):
    opened = open_arrays(path, limit=2**20)
    for array in opened.arrays:
        opened.read(array)


@FUZZ
@given(data=st.data())
def test_damaged_metadata_are_read_or_refused(data, tmp_path):
    samples, captures = stepped()
    path = write(tmp_path, samples.tobytes(), {"core:num_channels": 2}, captures)
    path.write_bytes(damaged(path.read_bytes(), data.draw))
    for call in (read_all, explain_file):
        message = refusal(call, path)
        assert message is None or (str(path) in message and "\n" not in message)


def test_the_library_of_sigmf_writes_what_is_read(tmp_path):
    sigmf = pytest.importorskip("sigmf")
    samples, captures = stepped()
    (tmp_path / "a.sigmf-data").write_bytes(samples.tobytes())
    content = {"core:datatype": "cf32_le", "core:num_channels": 2, "core:author": "a person"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = sigmf.SigMFFile(data_file=str(tmp_path / "a.sigmf-data"), global_info=content)
        for capture in captures:
            metadata = {key: value for key, value in capture.items() if "start" not in key}
            recording.add_capture(capture["core:sample_start"], metadata=metadata)
        recording.tofile(str(tmp_path / "a.sigmf-meta"))
        of_library = sigmf.fromfile(str(tmp_path / "a.sigmf-meta")).read_samples()
    opened = open_arrays(tmp_path / "a.sigmf-meta")
    np.testing.assert_array_equal(opened.read("samples"), of_library)
    assert "is that of the metadata" in opened.notes[-1]
    assert opened.arrays["sweeps"].shape == (2, 4, 2)
