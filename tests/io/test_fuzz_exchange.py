"""Every reader on damaged files: an import or one ValueError that names the file, nothing else."""

import warnings
from unittest import mock

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from flgpr.io.anchor import fit_anchor, read_anchor
from flgpr.io.arrays import open_arrays
from flgpr.io.explain import explain_file
from flgpr.io.mapping import parse_mapping
from flgpr.io.tracks import read_nmea, read_survey, read_track
from io_geodesy import LANE, on_the_ellipsoid

ARRAYS = {"field": np.arange(24).reshape(2, 3, 4) * (1 + 2j), "f": np.linspace(1, 2, 4), "tx": np.ones((3, 3))}
MODEST = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


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
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def damaged(data, draw):
    """Cut, flip, swap, overwrite or lengthen."""
    raw = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        what = draw(st.sampled_from(["cut", "flip", "write", "grow", "swap", "zero"]))
        at = draw(st.integers(0, max(len(raw) - 1, 0)))
        if what == "cut":
            del raw[at:]
        elif what == "flip" and raw:
            raw[at] ^= 1 << draw(st.integers(0, 7))
        elif what == "write":
            raw[at : at + 4] = draw(st.binary(min_size=1, max_size=8))
        elif what == "grow":
            raw += bytes(raw) * 9
        elif what == "swap":
            part = raw[at : at + 8]
            raw[at : at + 8] = part[::-1]
        else:
            raw[at : at + 16] = bytes(len(raw[at : at + 16]))
        if len(raw) > 200_000:
            break
    return bytes(raw)


NAMES = ["a.npz", "b.npz", "a.npy", "a.mat", "b.mat", "a.csv", "a.s2p"]


def refusal(call, *arguments, **options):
    """What a reader says, None if it reads; any other exception than ValueError goes on."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # parsers warn of what they then refuse
        try:
            call(*arguments, **options)
        except ValueError as error:
            return str(error)
    return None


def read_all(path):
    opened = open_arrays(path, limit=2**26)
    for array in opened.arrays:
        opened.read(array)


@pytest.mark.parametrize("name", NAMES)
@MODEST
@given(data=st.data())
def test_damaged_array_files(good, name, data, tmp_path):
    if name.endswith(".s2p"):
        pytest.importorskip("skrf")
    path = tmp_path / name
    path.write_bytes(damaged(good[name], data.draw))
    for call in (read_all, explain_file):
        said = refusal(call, path)
        assert said is None or (str(path) in said and "\n" not in said)


# Each file is looked at in a child process, which takes half a second.
@settings(MODEST, max_examples=10)
@given(data=st.data())
def test_damaged_hdf5(good, data, tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(damaged(good["a.h5"], data.draw))
    with mock.patch("flgpr.io.arrays._PATIENCE", 10.0):
        said = refusal(read_all, path)
    assert said is None or (str(path) in said and "\n" not in said)


@MODEST
@given(data=st.data())
def test_damaged_cphd(small_run, data, tmp_path):
    pytest.importorskip("sarkit")
    from flgpr.io.cphd import read_cphd, write_cphd

    whole = tmp_path / "whole.cphd"
    if not whole.exists():
        write_cphd(small_run, whole, fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02))
    path = tmp_path / "a.cphd"
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    for call in (read_cphd, explain_file):
        said = refusal(call, path)
        assert said is None or str(path) in said


TRACK = b"time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n0,1,2,3,0,0,0\n1,2,3,4,0,0,0\n"
NMEA = (
    b"$GPGGA,123519.25,4807.0380000,N,01131.0000000,E,4,08,0.9,545.4,M,46.9,M,,*5E\r\n"
    b"$GPHDT,274.07,T*03\r\n$GPGGA,123520.25,4807.0390000,N,01131.0000000,E,4,08,0.9,545.4,M,46.9,M,,*55\r\n"
)


@MODEST
@given(data=st.data())
def test_damaged_tracks(data, tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(damaged(TRACK, data.draw))
    for reader in (read_track, read_survey):
        said = refusal(reader, path)
        assert said is None or str(path) in said


@MODEST
@given(data=st.data())
def test_damaged_nmea(data, tmp_path):
    pytest.importorskip("pynmeagps")
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
MAPPING = b"""title = "x"
polarization = ["HH"]
[signal]
variable = "s"
dims = ["scan", "frequency"]
[frequency]
values = [1.0, 1.1]
unit = "GHz"
[antenna_position]
values = [[0, 0, 0]]
unit = "m"
"""


@MODEST
@given(data=st.data())
def test_damaged_toml(data, tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(damaged(ANCHOR, data.draw))
    said = refusal(read_anchor, path)
    assert said is None or str(path) in said
    text = damaged(MAPPING, data.draw).decode("utf-8", errors="replace")
    said = refusal(parse_mapping, text, "m.toml")
    assert said is None or "m.toml" in said
