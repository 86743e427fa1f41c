"""Files of other programs with a part that is no number, in another encoding, or in another order than ours."""

import json
import re

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import eye_array
from typer.testing import CliRunner

from bag import drive
from flgpr.commands.app import app
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file, propose_mapping
from flgpr.formats.mapped import import_mapped
from flgpr.store import open_run
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


# --- sweeps of a network analyser


def touchstone(frequencies, ports=2, noise=0, option="# MHz S RI R 50"):
    rows = []
    for f in frequencies:
        values = [f"{f / 1000 + k} {-k}" for k in range(ports**2)]
        rows.append(f"{f} " + " ".join(values) + " ! a tone")
    rows += [f"{100 + k} 1.0 0.5 10 0.2" for k in range(noise)]
    return "\n".join(["! made", option, *rows]) + "\n"


@pytest.mark.parametrize("ports", [1, 2, 3])
def test_a_sweep_from_high_to_low_loses_no_tone(ports, tmp_path):
    pytest.importorskip("skrf")
    up = [100, 200, 300, 400, 500]
    for name, frequencies in (("up", up), ("down", up[::-1]), ("mixed", [300, 100, 500, 200, 400])):
        path = tmp_path / f"{name}.s{ports}p"
        path.write_text(touchstone(frequencies, ports))
        opened = open_arrays(path)
        np.testing.assert_allclose(opened.read("frequency"), 1e6 * np.array(up))
        np.testing.assert_allclose(opened.read("s")[:, 0, 0].real, np.array(up) / 1000)
        assert bool(opened.notes) == (name != "up")
    assert opened.notes == ["its 5 tones do not rise: they are put in the order of frequency"]


def test_noise_behind_a_sweep_is_told_and_what_is_cut_off_refused(tmp_path):
    pytest.importorskip("skrf")
    path = tmp_path / "a.s2p"
    path.write_text(touchstone([500, 600], noise=3))
    opened = open_arrays(path)
    np.testing.assert_allclose(opened.read("frequency"), [5e8, 6e8])
    assert opened.notes == ["3 lines of noise parameters are not read"]
    path.write_text(touchstone([500, 600]).replace(" 3.6 -3", "", 1))
    with pytest.raises(ValueError, match="its numbers must be 9 for every tone of 2 ports, got 16"):
        open_arrays(path)
    path.write_bytes(touchstone([600, 500]).encode("utf-16"))
    assert "a.s2p is text in UTF-16" in open_arrays(path).notes


def test_version_2_says_itself_where_noise_begins(tmp_path):
    pytest.importorskip("skrf")
    keywords = (
        "[Version] 2.0\n# Hz S RI R 50\n[Number of Ports] 1\n[Number of Frequencies] 3\n[Network Data]\n"
        "1e9 0.1 0\n2e9 0.2 0\n3e9 0.3 0\n[End]\n"
    )
    path = tmp_path / "a.ts"
    path.write_text(keywords)
    np.testing.assert_allclose(open_arrays(path).read("frequency"), [1e9, 2e9, 3e9])
    path.write_text(keywords.replace("Frequencies] 3", "Frequencies] 4"))
    with pytest.raises(
        ValueError, match="it holds 4 tones, of which the scikit-rf library reads 3"
    ):
        open_arrays(path)


# --- merged results of gprMax


@pytest.fixture
def merged(tmp_path):
    """A B-scan laid out as gprMax's tools/outputfiles_merge.py writes it: 200 steps of 0.02 ns, 20 traces."""
    path = tmp_path / "model_merged.out"
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {"Title": "lane", "gprMax": "3.1.7", "Iterations": 200, "dt": 2e-11, "nrx": 1}
        )
        group = file.create_group("rxs/rx1")
        group.attrs["Name"] = "Rx(50,50,0)"
        for name in ("Ez", "Hx", "Hy"):
            group[name] = np.random.default_rng(1).normal(size=(200, 20)).astype(np.float32)
    return path


def test_a_merged_b_scan_is_told_and_imported_by_its_draft(merged, tmp_path):
    told = explain_file(merged)
    assert "merged B-scan of 20 traces x 200 steps of 0.02 ns" in told.lines
    assert 'variable = "rxs/rx1/Ez"\ndims = ["sample", "scan"]  # of 200 x 20' in told.mapping
    draft = told.mapping.replace("band = []", "band = [1.0, 5.0]").replace(
        'unit = "m?"', 'unit = "m"'
    )
    checked = re.sub(r'"([^"]*)\?"', lambda found: json.dumps(found[1] or "0"), draft)
    (tmp_path / "m.toml").write_text(checked)
    (tmp_path / "s.csv").write_text(
        "x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n"
        + "".join(f"0,{0.05 * k},0,0,0,0\n" for k in range(20))
    )
    words = ["import", "mapped", str(tmp_path / "m.toml"), "-o", str(tmp_path / "a.zarr")]
    done = CliRunner().invoke(app, [*words, "--survey", str(tmp_path / "s.csv")])
    assert done.exit_code == 0, done.output
    run = open_run(tmp_path / "a.zarr")
    assert run.sizes["scan"] == 20
    with h5py.File(merged) as file:
        trace = file["rxs/rx1/Ez"][:, 7]
    spectrum = np.fft.fft(trace.astype(np.float64))
    tones = np.fft.fftfreq(200, 2e-11)
    wanted = spectrum[np.isclose(tones[:, None], run["frequency"].values).any(axis=1)]
    np.testing.assert_allclose(run["signal"].values[7, 0, 0], wanted, rtol=1e-4, atol=1e-4)


def number_of_an_odd_type():
    """Return a type of floating point with an exponent's bias that no type of NumPy has."""
    kind = h5py.h5t.IEEE_F64LE.copy()
    kind.set_ebias(20_000)
    return kind


def text_of_two_lines():
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(8)
    return kind


@pytest.mark.parametrize("kind", [number_of_an_odd_type, text_of_two_lines])
def test_a_merged_b_scan_whose_step_is_no_number_is_named(kind, merged):
    """What h5py raises on such an attribute is a ValueError that names no file."""
    with h5py.File(merged, "r+") as file:
        del file.attrs["dt"]
        scalar = h5py.h5s.create(h5py.h5s.SCALAR)
        attribute = h5py.h5a.create(file.id, b"dt", kind(), scalar)
        attribute.write(np.array(b"two\nway"), attribute.get_type())
    with pytest.raises(ValueError, match=re.escape(str(merged))) as caught:
        explain_file(merged)
    assert "\n" not in str(caught.value)


# --- axes of a draft


def test_the_axes_of_a_profile_are_not_swapped(tmp_path):
    """The layout of MCoRDS files: samples x scans, a fast time and the clock of the scans."""
    fast = np.linspace(0, 50e-9, 200)[:, None]
    slow = np.linspace(0, 10, 41)[None]
    savemat(tmp_path / "a.mat", {"Data": np.ones((200, 41)), "GPS_time": slow, "Time": fast})
    draft = propose_mapping(tmp_path / "a.mat")
    assert 'dims = ["sample", "scan"]' in draft
    assert '[samples]\nvariable = "Time"\nunit = "s?"' in draft
    assert '[time]\nvariable = "GPS_time"' in draft


def test_a_draft_takes_longitude_and_latitude_where_a_file_has_no_places_in_the_lane(tmp_path):
    scans = np.arange(41)
    arrays = {
        "Data": np.random.default_rng(3).normal(size=(200, 41)),
        "Time": np.linspace(0, 50e-9, 200)[:, None],
        "GPS_time": scans[None] / 4.0,
        "Latitude": (60 + scans * 1e-5)[None],
        "Longitude": np.full((1, 41), 8.0),
    }
    savemat(tmp_path / "a.mat", arrays)
    draft = propose_mapping(tmp_path / "a.mat").replace("band = []", "band = [0.1, 1.0]")
    (tmp_path / "m.toml").write_text(re.sub(r'\?"', '"', draft))
    run = import_mapped(tmp_path / "m.toml", anchor_from_track=True).run
    way = run["pose"].values[:, 1]
    np.testing.assert_allclose(np.diff(way), 1e-5 * 111_412, rtol=1e-3)  # m of a degree at 60 N


def test_axes_of_one_length_are_both_guesses(tmp_path):
    fast, slow = np.linspace(0, 50e-9, 200), np.linspace(0, 10, 200)
    np.savez(tmp_path / "a.npz", data=np.ones((200, 200)), time=fast, gps_time=slow)
    draft = propose_mapping(tmp_path / "a.npz")
    assert 'dims = ["scan?", "sample?"]' in draft


def test_a_time_of_the_samples_is_no_clock_of_the_scans(tmp_path):
    """Two times as long as the samples, as ImpDAR keeps them, and none as long as the scans."""
    arrays = {"data": np.ones((200, 41)), "twtt": np.linspace(0, 5e-8, 200)}
    savemat(tmp_path / "a.mat", arrays | {"travel_time": np.linspace(0, 0.05, 200)})
    draft = propose_mapping(tmp_path / "a.mat")
    assert 'dims = ["sample", "scan?"]' in draft
    assert "[time]" not in draft


@pytest.mark.parametrize("turned", [False, True])
def test_a_time_that_may_be_either_is_a_guess(turned, tmp_path):
    data = np.ones((41, 20)).T if turned else np.ones((41, 20))
    np.savez(tmp_path / "a.npz", data=data, time=np.linspace(0, 10, 41))
    draft = propose_mapping(tmp_path / "a.npz")
    assert '"sample?"' in draft
    assert 'variable = "time?"' in draft
    np.savez(tmp_path / "b.npz", data=data, time=np.linspace(0, 5e-8, 41))
    assert '"sample"' in propose_mapping(tmp_path / "b.npz")


def test_a_zip_is_to_be_unzipped(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match="unzip it, and give one of them"):
        open_arrays(tmp_path / "a.zip")
