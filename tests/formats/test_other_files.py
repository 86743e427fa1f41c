"""Files of other programs with a part that is no number, in another encoding, or in another order than ours."""

import re

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import eye_array

from alone import needs
from bag import drive
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file, propose_mapping
from flgpr.formats.mapped import import_mapped
from flgpr.store.text import decode_text
from flgpr.store.text_tables import read_text_table
from io_open import write_su

# --- one bad part never blocks the rest


@pytest.fixture
def odd_hdf5(tmp_path):
    """Numbers beside text, rows of different lengths, records, references and an array that is damaged."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["radar/data"] = np.arange(12.0).reshape(3, 4)
        file["radar/names"] = np.array(["left", "right"], dtype=h5py.string_dtype())
        file["radar/short"] = np.array([b"HH", b"VV"])
        file["radar/ragged"] = np.array(
            [np.arange(2), np.arange(3)], dtype=h5py.vlen_dtype(np.int32)
        )
        file["radar/table"] = np.zeros(3, dtype=[("time", "f8"), ("x", "f4")])
        file["radar/links"] = np.array([file["radar"].ref], dtype=h5py.ref_dtype)
        file["radar/pair"] = np.zeros(3, dtype=[("re", "f4"), ("im", "f4")])
        file.create_dataset(
            "radar/damaged", data=np.arange(1000.0), fletcher32=True, chunks=(1000,)
        )
    raw = path.read_bytes()
    at = raw.index(np.arange(1000.0).tobytes())
    path.write_bytes(raw[:at] + b"\x01" + raw[at + 1 :])
    return path


def test_parts_of_an_hdf5_that_are_no_numbers_are_named(odd_hdf5):
    told = "\n".join(explain_file(odd_hdf5).lines)
    for line in (
        "radar/data: 3 x 4 float64, 0 to 11",
        "radar/names: 2 text",
        "radar/ragged: not read: rows of different lengths",
        "radar/table: not read: records of time, x",
        "radar/links: not read: references to other parts of the file",
        "radar/damaged: not read: damaged (",
    ):
        assert line in told
    opened = open_arrays(odd_hdf5)
    np.testing.assert_array_equal(opened.read("radar/names"), ["left", "right"])
    np.testing.assert_array_equal(opened.read("radar/short"), ["HH", "VV"])
    assert opened.read("radar/pair").dtype == np.complex64
    np.testing.assert_array_equal(opened.read("radar/data"), np.arange(12.0).reshape(3, 4))


@needs("flgpr_exchange")
def test_a_file_without_a_signal_and_one_without_a_mapping_are_told_apart(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["names"] = np.array(["left", "right"], dtype=h5py.string_dtype())
        file["flags"] = np.array([True, False])
    with pytest.raises(ValueError, match="no array of this HDF5 file can be a signal"):
        propose_mapping(tmp_path / "a.h5")
    (tmp_path / "a.nmea").write_text("$GPGGA,123519.25,,,,,0,,,,M,,M,,*00\n")
    with pytest.raises(ValueError, match="a NMEA 0183 log is read without a mapping"):
        propose_mapping(tmp_path / "a.nmea")
    with pytest.raises(ValueError, match="a Seismic Unix is read without a mapping"):
        propose_mapping(write_su(tmp_path / "a.su", np.ones((4, 64))))


def test_members_of_an_archive_that_are_no_numbers_are_named(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.arange(3.0), boxes=np.array([{}, []], dtype=object))
    told = explain_file(tmp_path / "a.npz").lines
    assert "boxes: not read: Python objects" in told
    assert any(line.startswith("x: 3 float64") for line in told)


def test_variables_of_matlab_that_are_no_numbers_are_named(tmp_path):
    savemat(tmp_path / "a.mat", {"x": np.arange(3.0), "sparse": eye_array(3, format="csc")})
    told = "\n".join(explain_file(tmp_path / "a.mat").lines)
    assert "x: 1 x 3 float64" in told
    assert re.search(r"sparse: not read: csc_\w+", told)


def damaged_messages(path, *numbers, compression="none"):
    """Cut the arrays of some messages of /radar off: their lengths say more than there is."""
    raw = bytearray(drive(compression=compression, crcs=False))
    for number in numbers:
        content = (np.arange(12) + 100 * number).astype("<i2").tobytes()
        at = raw.index(content) - 4
        raw[at : at + 4] = (10**6).to_bytes(4, "little")
    path.write_bytes(raw)
    return path


@needs("flgpr_exchange")
def test_a_damaged_message_is_left_out_and_counted(tmp_path):
    pytest.importorskip("mcap_ros2")
    for numbers in ((2,), (0,), (0, 4)):
        path = damaged_messages(tmp_path / "a.mcap", *numbers)
        opened = open_arrays(path)
        rest = np.delete(np.arange(5), numbers)
        np.testing.assert_array_equal(opened.read("/radar/iq"), np.arange(12) + 100 * rest[:, None])
        assert opened.read("/radar@log_time").size == rest.size
        note = f"/radar: {len(numbers)} of 5 messages are damaged and left out"
        assert [line for line in opened.notes if line.startswith(note)]
        assert opened.read("/pose/pose.position.x").size == 40
    told = explain_file(path)
    assert any("are damaged and left out" in line for line in told.lines)
    lost = damaged_messages(tmp_path / "b.mcap", *range(5))
    assert "/radar/iq" not in open_arrays(lost).arrays
    assert open_arrays(lost).read("/pose/pose.position.x").size == 40


@needs("flgpr_exchange")
def test_an_import_keeps_the_notes_of_its_files(tmp_path):
    pytest.importorskip("mcap_ros2")
    from bag import MAPPING

    path = damaged_messages(tmp_path / "drive.mcap", 3)
    (tmp_path / "m.toml").write_text(MAPPING)
    arrived = import_mapped(tmp_path / "m.toml", path)
    assert arrived.run.sizes["scan"] == 4
    assert any(
        "/radar: 1 of 5 messages are damaged" in note for note in arrived.run.attrs["import_notes"]
    )


# --- encodings and dialects of text


@pytest.mark.parametrize(
    ("data", "text", "note"),
    [
        ("Länge".encode("utf-16"), "Länge", "a is text in UTF-16"),
        (
            "Länge;x".encode("utf-16-le") + b"\n\0",
            "Länge;x\n",
            "a is text in UTF-16 without a mark",
        ),
        ("\nLänge;x".encode("utf-16-be"), "\nLänge;x", "a is text in UTF-16 without a mark"),
        ("Länge".encode("utf-32"), "Länge", "a is text in UTF-32"),
        ("Länge".encode("utf-8-sig"), "Länge", None),
        ("Länge".encode(), "Länge", None),
        (
            "Länge".encode("latin-1"),
            "Länge",
            "a is text in Latin-1, which is assumed because it is no UTF-8",
        ),
        (b"", "", None),
    ],
)
def test_text_is_read_in_the_encoding_that_it_shows(data, text, note):
    notes = []
    assert decode_text(data, "a", notes) == text
    assert notes == ([note] if note else [])


def test_text_that_is_none_in_the_encoding_of_its_mark_is_refused():
    with pytest.raises(ValueError, match="a begins as UTF-16 and is none at byte"):
        decode_text(b"\xff\xfea\0\0", "a")


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "utf-8"])
def test_tables_in_every_encoding(encoding, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("Länge_m;re;im\r\n1;0,5;0,1\r\n2;0,4;0,2\r\n".encode(encoding))
    found = read_text_table(path)
    np.testing.assert_array_equal(found["Länge_m"], [1, 2])
    np.testing.assert_array_equal(found["im"], [0.1, 0.2])
    notes = open_arrays(path).notes
    assert any("is text in" in note for note in notes) == (encoding != "utf-8")
    assert "commas in numbers, such as 0,5, are read as decimal commas" in notes


VNA = "!CSV A.01.01\n!Agilent\nBEGIN CH1_DATA\nFreq(Hz),S21(REAL),S21(IMAG)\n1e9,0.1,0.2\n2e9,0.3,0.4\nEND\n"


@pytest.mark.parametrize("mark", [";", ","])
def test_a_mark_at_the_end_of_every_line_makes_no_column(mark, tmp_path):
    """Rohde & Schwarz analysers write tables so."""
    lines = ["freq[Hz];re:Trc1_S21;im:Trc1_S21;", "1e9;0.1;0.2;", "2e9;0.3;0.4;"]
    (tmp_path / "a.csv").write_text("\n".join(lines).replace(";", mark) + "\n")
    opened = open_arrays(tmp_path / "a.csv")
    assert list(opened.arrays) == ["table", "freq[Hz]", "re:Trc1_S21", "im:Trc1_S21"]
    np.testing.assert_array_equal(opened.read("table"), [[1e9, 0.1, 0.2], [2e9, 0.3, 0.4]])


def test_a_network_analysers_table(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(VNA)
    found = read_text_table(path)
    np.testing.assert_array_equal(found["Freq(Hz)"], [1e9, 2e9])
    np.testing.assert_array_equal(found["S21(IMAG)"], [0.2, 0.4])
    draft = propose_mapping(path)
    assert 'variable = "S21(REAL)"\nimaginary = "S21(IMAG)"' in draft
    assert 'variable = "Freq(Hz)"' in draft
    path.write_text(VNA + VNA.replace("CH1", "CH2").replace("0.4", "0.8"))
    both = read_text_table(path)
    assert both["CH1_DATA/S21(IMAG)"][1] == 0.4
    assert both["CH2_DATA/S21(IMAG)"][1] == 0.8
    path.write_text(VNA.replace("END\n", "END\nleft over\n"))
    notes = []
    read_text_table(path, notes)
    assert notes == ["1 lines outside BEGIN and END are not read"]


def test_a_zip_is_to_be_unzipped(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match="unzip it, and give one of them"):
        open_arrays(tmp_path / "a.zip")
