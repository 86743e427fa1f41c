"""Every reader on damaged files: an import or one ValueError that names the file, nothing else."""

from importlib.util import find_spec
from unittest import mock

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from bag import drive
from damage import FUZZ, damaged, in_forks, refusal
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file
from flgpr.formats.mapping import parse_mapping
from flgpr.formats.tracks import read_nmea, read_survey, read_track
from flgpr.geo.anchor import fit_anchor, read_anchor
from flgpr.store.dialects import TableReading
from flgpr.store.tables import read_table
from flgpr_exchange.gpr.files import read_gpr
from flgpr_exchange.gpr.line_run import gpr_run
from io_geodesy import LANE, on_the_ellipsoid
from io_gpr import section, write_dt1, write_dzt, write_ids, write_impulse, write_mala, write_segy
from io_open import way, write_ogpr, write_su
from io_recordings import gps_lines, two_headers, with_extra_headers
from scans_mapping import line_mapping
from take import take_text

ARRAYS = {
    "field": np.arange(24).reshape(2, 3, 4) * (1 + 2j),
    "f": np.linspace(1, 2, 4),
    "tx": np.ones((3, 3)),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    np.savez(folder / "a.npz", **ARRAYS)
    np.savez_compressed(folder / "b.npz", **ARRAYS)
    np.save(folder / "a.npy", ARRAYS["field"])
    savemat(folder / "a.mat", {"data": ARRAYS})
    savemat(folder / "b.mat", ARRAYS, do_compression=True)
    with h5py.File(folder / "a.h5", "w") as file:
        for name, value in ARRAYS.items():
            file.create_dataset(f"g/{name}", data=value, compression="gzip")
            file[f"g/{name}"].attrs["units"] = "m"
    (folder / "a.csv").write_text("f;s\n1e9;1+2i\n2e9;-3-4.5i\n")
    (folder / "a.s2p").write_text("# MHz S RI R 50\n500 0.1 0 1 2 3 4 0 0\n600 0.1 0 1 2 3 4 0 0\n")
    (folder / "down.s2p").write_text(
        "# MHz S RI R 50\n600 0.1 0 1 2 3 4 0 0\n500 0.1 0 1 2 3 4 0 0\n300 1 1 1 1\n"
    )
    (folder / "vna.csv").write_text(
        "!CSV\nBEGIN CH1\nf,s(REAL),s(IMAG)\n1e9,1,2\n2e9,3,4\nEND\nBEGIN CH2\n1,2\nEND\n"
    )
    (folder / "wide.csv").write_bytes("fä;s\n1e9;1+2i\n2e9;-3-4,5i\n".encode("utf-16"))
    with h5py.File(folder / "merged.h5", "w") as file:
        file.attrs.update({"Title": "a", "gprMax": "3.1", "Iterations": 6, "dt": 2e-11, "nrx": 1})
        file["rxs/rx1/Ez"] = np.ones((6, 4), np.float32)
        file["rxs/rx1/label"] = "text"
    (folder / "commas.csv").write_text("f;s\n1e9;1,5+2i\n2e9;-3-4,5i\n")
    turned = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    (folder / "take.csv").write_text(take_text([0.0, 0.5, 1.0], np.ones((3, 3)), turned, lost=(1,)))
    if find_spec("mcap_ros2"):
        (folder / "a.mcap").write_bytes(drive(2, 2, crcs=False))
        (folder / "b.mcap").write_bytes(drive(1, 1, "none", crcs=False))
        # Damage to a chunk shows in its checksum.
        (folder / "c.mcap").write_bytes(drive(2, 9, "lz4"))
    return {path.name: path.read_bytes() for path in folder.iterdir()}


NAMES = [
    "a.npz", "b.npz", "a.npy", "a.csv", "commas.csv", "vna.csv", "wide.csv", "a.s2p", "down.s2p", "take.csv", "a.mcap",
    "b.mcap", "c.mcap",
]  # fmt: skip


def read_all(path):
    opened = open_arrays(path, limit=2**26)
    for array in opened.arrays:
        opened.read(array)


@pytest.mark.slow("draws many damaged files anew")
@pytest.mark.parametrize("name", NAMES)
@FUZZ
@given(data=st.data())
def test_damaged_array_files(good, name, data, tmp_path):
    pytest.importorskip({"s2p": "skrf", "mcap": "mcap_ros2"}.get(name.split(".")[1], "numpy"))
    path = tmp_path / name
    path.write_bytes(damaged(good[name], data.draw))
    for call in (read_all, explain_file):
        said = refusal(call, path)
        assert said is None or (str(path) in said and "\n" not in said)


GUARDED = ["a.h5", "merged.h5", "a.mat", "b.mat"]


@pytest.mark.slow("draws many damaged files anew, each read by a child")
@pytest.mark.parametrize("name", GUARDED)
@FUZZ
@given(data=st.data())
def test_damaged_files_that_a_child_reads(good, name, data, tmp_path):
    path = tmp_path / name
    path.write_bytes(damaged(good[name], data.draw))
    for call in (read_all, explain_file) if name == "merged.h5" else (read_all,):
        with in_forks(), mock.patch("flgpr.formats.arrays._PATIENCE", 5.0):
            said = refusal(call, path)
        assert said is None or (str(path) in said and "\n" not in said)


@pytest.mark.parametrize("name", GUARDED)
@in_forks()
def test_whole_files_are_read_in_forks(good, name, tmp_path):
    (tmp_path / name).write_bytes(good[name])
    read_all(tmp_path / name)


@pytest.mark.slow("draws many damaged files anew, each read by a child")
@pytest.mark.parametrize("name", ["a.h5", "a.mat"])
def test_damaged_files_in_a_real_child(good, name, tmp_path):
    for size in (400, len(good[name])):
        (tmp_path / name).write_bytes(good[name][:size])
        said = refusal(read_all, tmp_path / name)
        assert (said is None) == (size == len(good[name]))


@pytest.mark.slow("draws many damaged files anew")
@FUZZ
@given(data=st.data())
def test_damaged_cphd(small_run, data, tmp_path):
    pytest.importorskip("sarkit")
    from flgpr_exchange.cphd.phase_history import read_cphd, write_cphd

    whole = tmp_path / "whole.cphd"
    if not whole.exists():
        write_cphd(small_run, whole, fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02))
    path = tmp_path / "a.cphd"
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    for call in (read_cphd, explain_file):
        said = refusal(call, path)
        assert said is None or str(path) in said


COR = "".join(
    f"{k + 1}\t2024-04-04\t12:00:00\t{47.9 + k * 1e-6}\tN\t11.3\tE\t0.0\tM\t1\n" for k in range(6)
).encode()
FIX = "Trace #{0} at position 1\n$GSSIS,{0},0\n$GPGGA,120000.00,4754.0{0},N,1118.0,E,4,9,0.9,0.0,M,0.0,M,,*00\n"
GPS = "".join(FIX.format(k) for k in range(1, 6)).encode()
GP2 = gps_lines([0, 2, 5], [47.9, 47.90001, 47.90002], [11.3] * 3, "gp2").encode()
DZX = (
    b"<DZX><GlobalProperties><horizontalUnit>m</horizontalUnit><unitsPerScan>0.05</unitsPerScan></GlobalProperties>"
    b"<File><Profile><WayPt><scan>1</scan><mark>User</mark><distance>1</distance></WayPt><WayPt><scan>5</scan>"
    b"<distance>2</distance></WayPt></Profile></File></DZX>"
)
RECORDINGS = {
    "dt1": (write_dt1, ".hd", ".gps", GPS),
    "gp2.dt1": (
        lambda path, one: write_dt1(path, one, real=True, DATA_TYPE="", POSITION_UNITS="cm"),
        ".hd",
        ".gp2",
        GP2,
    ),
    "dzx.dzt": (two_headers, None, ".dzx", DZX),
    "new.sgy": (
        lambda path, one: with_extra_headers(write_segy(path, one, code=5), len(one), width=4),
        None,
        None,
        b"",
    ),
    "dzt": (
        lambda path, one: write_dzt(path, np.stack([one, one], 1), names=("50400", "")),
        None,
        ".dzg",
        GPS,
    ),
    "rd3": (write_mala, ".RAD", ".cor", COR),
    "rd7": (write_mala, ".RAD", ".cor", COR),
    "iprb": (write_impulse, ".iprh", ".cor", COR),
    "dt": (write_ids, None, None, b""),
    "sgy": (write_segy, None, None, b""),
    "segy": (lambda path, counts: write_segy(path, counts, code=1, unit=2), None, None, b""),
    "su": (write_su, None, None, b""),
    "ogpr": (
        lambda path, counts: write_ogpr(path, counts[:, None], places=way(len(counts))),
        None,
        None,
        b"",
    ),
}


@pytest.mark.slow("draws many damaged files anew")
@pytest.mark.parametrize("kind", RECORDINGS)
@FUZZ
@given(data=st.data())
def test_damaged_recordings(kind, data, tmp_path):
    """Damage to the recording, its header or its positions; what can still be read makes a run or is refused."""
    write, header, positions, places = RECORDINGS[kind]
    folder = tmp_path / "damaged"
    good = tmp_path / "good"
    path = folder / f"a.{kind.rpartition('.')[2]}"
    if not good.exists():
        folder.mkdir()
        good.mkdir()
        write(good / path.name, section(8))
        if positions:
            (good / f"a{positions}").write_bytes(places)
    names = [path.name, *(f"a{suffix}" for suffix in (header, positions) if suffix)]
    worst = data.draw(st.sampled_from(names))
    for name in names:
        raw = (good / name).read_bytes()
        (folder / name).write_bytes(damaged(raw, data.draw) if name == worst else raw)
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    for call in (
        explain_file,
        lambda one: gpr_run(read_gpr(one)),
        lambda one: gpr_run(read_gpr(one), anchor=anchor),
    ):
        said = refusal(call, path)
        assert said is None or "\n" not in said


TRACK = b"time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n0,1,2,3,0,0,0\n1,2,3,4,0,0,0\n"
TAKE = (
    take_text([0.0, 0.5], np.ones((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
    .replace("Pole", "")
    .encode()
)
NMEA = (
    b"$GPGGA,123519.25,4807.0380000,N,01131.0000000,E,4,08,0.9,545.4,M,46.9,M,,*5E\r\n"
    b"$GPHDT,274.07,T*03\r\n$GPGGA,123520.25,4807.0390000,N,01131.0000000,E,4,08,0.9,545.4,M,46.9,M,,*55\r\n"
)


@pytest.mark.slow("draws many damaged files anew")
@FUZZ
@given(data=st.data())
def test_damaged_tracks(data, tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(damaged(TRACK, data.draw))
    for reader in (read_track, read_survey):
        said = refusal(reader, path)
        assert said is None or str(path) in said
    path.write_bytes(damaged(TAKE, data.draw))
    said = refusal(read_track, path, "column", None, ("x", "-z", "y"))
    assert said is None or str(path) in said


LIST = "# ours\nNr;quer [cm];längs;Wertung\n1;25;3,5;7\n2;-5;10,25;9\n".encode("latin-1")


@pytest.mark.slow("draws many damaged files anew")
@FUZZ
@given(data=st.data())
def test_damaged_lists_of_alarms(data, tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(damaged(LIST, data.draw))
    for reading in (None, TableReading({"confidence": "Wertung"})):
        said = refusal(read_table, path, "alarms", reading)
        assert said is None or str(path) in said


@pytest.mark.slow("draws many damaged files anew")
@FUZZ
@given(data=st.data())
def test_damaged_nmea(data, tmp_path):
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    path = tmp_path / "t.nmea"
    path.write_bytes(damaged(NMEA, data.draw))
    said = refusal(read_nmea, path, anchor)
    assert said is None or str(path) in said


ANCHOR = b"""crs = "EPSG:32632"
accuracy = 0.02
[[point]]
lane = [0.0, 0.0]
easting = 500000.0
northing = 5300000.0
[[point]]
lane = [0.0, 50.0]
easting = 500000.0
northing = 5300049.98
"""
MAPPING = line_mapping(tones="values = [1.0, 1.1]").encode()


@pytest.mark.slow("draws many damaged files anew")
@FUZZ
@given(data=st.data())
def test_damaged_toml(data, tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(damaged(ANCHOR, data.draw))
    said = refusal(read_anchor, path)
    assert said is None or str(path) in said
    text = damaged(MAPPING, data.draw).decode("utf-8", errors="replace")
    said = refusal(parse_mapping, text, "m.toml")
    assert said is None or "m.toml" in said
