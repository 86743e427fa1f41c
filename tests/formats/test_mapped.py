import re
import sys

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from alone import needs
from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapped import import_mapped
from flgpr.model.track import make_track
from flgpr.store.extras import MissingExtraError

FREQUENCY = np.array([1.0e9, 1.1e9, 1.25e9, 1.3e9])
TX = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
RX = np.array([[0.0, 0, 0.2], [0.5, 0, 0.2], [0.7, 0.1, 0.2]])

MAPPING = """
title = "made up"
polarization = ["HH", "VV"]
[signal]
variable = "field"
dims = ["frequency", "rx", "tx", "polarization", "scan"]
[frequency]
variable = "f"
unit = "GHz"
[tx_position]
variable = "tx"
unit = "cm"
[rx_position]
variable = "rx"
unit = "cm"
[pose]
x = 0
y = "way"
z = 1.5
heading = 10
pitch = 0
roll = 0
unit = "m"
angle_unit = "deg"
[time]
variable = "t"
unit = "ms"
"""


@pytest.fixture
def field():
    rng = np.random.default_rng(2)
    return (rng.normal(size=(4, 3, 2, 2, 5)) + 1j * rng.normal(size=(4, 3, 2, 2, 5))).astype(
        np.complex64
    )


@pytest.fixture
def arrays(field):
    way = np.arange(5.0)
    stamp = 1000.0 * np.arange(5)
    return {
        "field": field,
        "f": FREQUENCY / 1e9,
        "tx": 100 * TX,
        "rx": 100 * RX,
        "way": way,
        "t": stamp,
    }


def write(arrays, path):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.name.endswith("v7.mat"):
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, value in arrays.items():
                value = np.asarray(value).T
                if np.iscomplexobj(value):
                    record = np.zeros(
                        value.shape, [("real", value.real.dtype), ("imag", value.real.dtype)]
                    )
                    record["real"] = value.real
                    record["imag"] = value.imag
                    value = record
                file[name] = value
                file[name].attrs["MATLAB_class"] = np.bytes_("single")
    elif path.suffix == ".mat":
        savemat(path, arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value
    return path


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["a.npz", "a.h5", "v5.mat", "a.v7.mat"])
def test_one_mapping_reads_every_container(arrays, field, name, tmp_path):
    file = write(arrays, tmp_path / name)
    run = import_mapped(put(MAPPING, tmp_path / "m.toml"), file).run
    assert run["signal"].shape == (5, 2, 6, 4)
    # pair = transmitter by transmitter
    np.testing.assert_array_equal(run["signal"].values[3, 1, 1 * 3 + 2], field[:, 2, 1, 1, 3])
    np.testing.assert_allclose(run["tx_position"].values[4], TX[1])
    np.testing.assert_allclose(run["rx_position"].values[4], RX[1])
    np.testing.assert_allclose(run["frequency"].values, FREQUENCY, rtol=1e-15)
    np.testing.assert_allclose(run["pose"].values[2], [0, 2, 1.5, np.deg2rad(10), 0, 0])
    np.testing.assert_allclose(run["time"].values, np.arange(5))


def test_byte_order_of_the_file_does_not_matter(arrays, tmp_path):
    swapped = {
        name: np.asarray(value).astype(np.asarray(value).dtype.newbyteorder(">"))
        for name, value in arrays.items()
    }
    one = import_mapped(put(MAPPING, tmp_path / "m.toml"), write(arrays, tmp_path / "a.npz")).run
    two = import_mapped(tmp_path / "m.toml", write(swapped, tmp_path / "b.npz")).run
    assert one.identical(two)


def test_falling_tones_are_sorted_and_said(arrays, field, tmp_path):
    arrays |= {"f": arrays["f"][::-1], "field": field[::-1]}
    arrived = import_mapped(put(MAPPING, tmp_path / "m.toml"), write(arrays, tmp_path / "a.npz"))
    np.testing.assert_array_equal(arrived.run["signal"].values[3, 1, 5], field[:, 2, 1, 1, 3])
    assert "sorted" in arrived.notes[0]
    assert arrived.run.attrs["import_notes"] == arrived.notes


def test_files_continue_one_another(arrays, field, tmp_path):
    for part, scans in (("a", slice(0, 2)), ("b", slice(2, 5))):
        cut = {"field": field[..., scans], "way": arrays["way"][scans], "t": arrays["t"][scans]}
        write(arrays | cut, tmp_path / f"{part}.npz")
    whole = import_mapped(
        put(MAPPING, tmp_path / "m.toml"), write(arrays, tmp_path / "whole.npz")
    ).run
    parts = import_mapped(tmp_path / "m.toml", [tmp_path / "a.npz", tmp_path / "b.npz"]).run
    assert whole.identical(parts)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"f": FREQUENCY}, ["frequency", "1e+12", "unit"]),
        ({"f": FREQUENCY / 1e13}, ["frequency", "hertz"]),
        ({"f": FREQUENCY[:3] / 1e9}, ["frequency", "4 tones"]),
        ({"tx": np.full((2, 3), np.nan)}, ["tx_position", "finite"]),
        ({"way": np.array([0, 1, np.nan, 3, 4])}, ["pose", "scan 2"]),
        ({"rx": RX[:2]}, ["rx_position", "3 antennas"]),
        ({"tx": TX * (1 + 1j)}, ["tx_position", "real"]),
        ({"tx": (100 * TX).astype(">f8").view("<f8")}, ["tx_position", "byte order"]),
        ({"field": None}, ["signal", "field", "one of"]),
        ({"way": None}, ["pose.y", "way"]),
        ({"t": np.arange(4.0)}, ["time", "scan"]),
        ({"way": np.arange(50.0)}, ["pose.y", "5 values", "50"]),
    ],
)
def test_what_does_not_fit_is_named(arrays, change, words, tmp_path):
    changed = {name: value for name, value in (arrays | change).items() if value is not None}
    with pytest.raises(ValueError) as error:
        import_mapped(put(MAPPING, tmp_path / "m.toml"), write(changed, tmp_path / "a.npz"))
    for word in words:
        assert word in str(error.value)


def test_sweeps_with_nan_are_kept_and_flagged(arrays, field, tmp_path):
    field[1, 2, 0, 1, 4] = np.nan
    run = import_mapped(put(MAPPING, tmp_path / "m.toml"), write(arrays, tmp_path / "a.npz")).run
    assert np.argwhere(~run["valid"].values).tolist() == [[4, 1, 2]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('unit = "GHz"', 'unit = "GHz?"', ["frequency.unit", "guess"]),
        ('unit = "GHz"', 'unit = "furlong"', ["frequency.unit", "Hz, kHz"]),
        ('unit = "GHz"', "", ["frequency.unit", "missing"]),
        ('variable = "f"', 'variable = "f"\nspeed = 3', ["frequency.speed", "no such entry"]),
        ("[pose]", "[posing]", ["posing"]),
        ("z = 1.5", "", ["pose: z", "missing"]),
        ('[tx_position]\nvariable = "tx"\nunit = "cm"', "", ["geometry is missing"]),
        ('"frequency", "rx"', '"frequency", "pair"', ["dims"]),
        ('"polarization", "scan"]', '"scan"]', ["dims", "5 axes"]),
        ("title =", "title", ["TOML"]),
    ],
)
def test_mappings_that_lack_something_are_refused(arrays, old, new, words, tmp_path):
    assert old in MAPPING
    with pytest.raises(ValueError) as error:
        import_mapped(
            put(MAPPING.replace(old, new), tmp_path / "m.toml"), write(arrays, tmp_path / "a.npz")
        )
    for word in words:
        assert word in str(error.value)


def test_a_mapping_without_poses_says_what_to_give(arrays, tmp_path):
    text = re.sub(r"\[pose\].*?\n\[time\]", "[time]", MAPPING, flags=re.S)
    put(text, tmp_path / "m.toml")
    file = write(arrays, tmp_path / "a.npz")
    with pytest.raises(ValueError, match="give pose, or track, or positions"):
        import_mapped(tmp_path / "m.toml", file)
    pose = np.zeros((5, 6))
    pose[:, 1] = np.arange(5) + 0.5
    np.testing.assert_array_equal(
        import_mapped(tmp_path / "m.toml", file, pose=pose).run["pose"].values, pose
    )
    track = make_track([100.0, 110.0], [[0, 0, 1], [0, 20, 1]])
    run = import_mapped(tmp_path / "m.toml", file, track=track, clock_offset=102.0).run
    np.testing.assert_allclose(run["pose"].values[:, 1], 4 + 2 * np.arange(5))
    with pytest.raises(ValueError, match="give one"):
        import_mapped(tmp_path / "m.toml", file, pose=pose, track=track)


def test_a_scan_in_a_gap_of_a_track_beside_the_mapping_is_refused(arrays, tmp_path):
    text = re.sub(r"\[pose\].*?\n\[time\]", "[time]", MAPPING, flags=re.S)
    put(text, tmp_path / "m.toml")
    file = write(arrays, tmp_path / "a.npz")
    time = np.array([*np.arange(100, 103.5, 0.5), 106.5, *np.arange(107, 112, 0.5)])
    track = make_track(time, np.column_stack([0 * time, 2 * (time - 100), 0 * time + 1]))
    run = import_mapped(tmp_path / "m.toml", file, track=track, clock_offset=102.0, max_gap=4.0).run
    np.testing.assert_allclose(run["pose"].values[:, 1], 4 + 2 * np.arange(5))
    with pytest.raises(ValueError, match=r"no gap over 1 s, got 3\.5 s at scan 2"):
        import_mapped(tmp_path / "m.toml", file, track=track, clock_offset=102.0)


def test_positions_in_the_lane_frame_give_the_poses(arrays, field, tmp_path):
    moves = np.array([[0.1 * k, 2.0 * k, 1.5] for k in range(5)])
    arrays |= {"tx": TX + moves[:, None], "rx": RX + moves[:, None]}
    text = re.sub(r"\[pose\].*?\n\[time\]", "[time]", MAPPING, flags=re.S).replace(
        '"cm"', '"m"\nframe = "lane"'
    )
    run = import_mapped(put(text, tmp_path / "m.toml"), write(arrays, tmp_path / "a.npz")).run
    world = run["pose"].values[:, None, :3] + run["rx_position"].values
    np.testing.assert_allclose(world[:, :3], RX + moves[:, None], atol=1e-12)
    arrays["rx"][3, 1, 0] += 0.01
    with pytest.raises(ValueError, match="keep their form"):
        import_mapped(tmp_path / "m.toml", write(arrays, tmp_path / "a.npz"))


IMPULSE = """
title = "pulses"
polarization = ["VV"]
[signal]
variable = "trace"
dims = ["scan", "sample"]
[samples]
variable = "t"
unit = "ns"
meaning = "delay"
band = [0.8, 2.4]
band_unit = "GHz"
[antenna_position]
values = [[0, 0, 0]]
unit = "m"
[pose]
x = 0
y = 0
z = 1
heading = 0
pitch = 0
roll = 0
unit = "m"
angle_unit = "rad"
"""


def test_an_impulse_at_a_delay_has_the_phase_of_its_path(tmp_path):
    start = 4e-9
    step = 0.1e-9
    count = 400
    time = start + step * np.arange(count)
    delays = np.array([9.13e-9, 17.7e-9])
    arg = (time - delays[:, None]) / 0.25e-9
    pulse = (1 - 2 * arg**2) * np.exp(-(arg**2))
    np.savez(tmp_path / "p.npz", trace=pulse, t=time * 1e9)
    run = import_mapped(put(IMPULSE, tmp_path / "m.toml"), tmp_path / "p.npz").run
    tones = run["frequency"].values
    assert 0.8e9 <= tones[0] <= tones[-1] <= 2.4e9
    expected = np.exp(-2j * np.pi * tones * delays[:, None])
    got = run["signal"].values[:, 0, 0]
    # The Ricker pulse is even, so its spectrum is real and positive: only the delay turns the
    # phase.
    np.testing.assert_allclose(got / np.abs(got), expected, atol=2e-3)


def test_negative_frequencies_of_complex_samples_without_a_carrier_are_told(tmp_path):
    time = 4e-9 + 0.1e-9 * np.arange(400)
    ahead = np.exp(2j * np.pi * 1.5e9 * time)
    behind = np.exp(-2j * np.pi * 1.5e9 * time)  # whole periods, so that no power leaks
    np.savez(tmp_path / "p.npz", trace=np.array([2 * ahead, ahead + behind]), t=time * 1e9)
    imported = import_mapped(put(IMPULSE, tmp_path / "m.toml"), tmp_path / "p.npz")
    [note] = [line for line in imported.notes if "carrier" in line]
    assert "taken as analytic signals, and 16.7 % of their power, at negative" in note
    np.savez(tmp_path / "real.npz", trace=np.array([ahead, behind]).real, t=time * 1e9)
    imported = import_mapped(put(IMPULSE, tmp_path / "m.toml"), tmp_path / "real.npz")
    assert not [line for line in imported.notes if "carrier" in line]


def test_conjugated_recorders_and_path_offsets(tmp_path):
    path = 12.3
    offset = 8.0
    np.savez(
        tmp_path / "p.npz",
        s=np.exp(2j * np.pi * FREQUENCY * (path - offset) / 299_792_458.0)[None],
        f=FREQUENCY,
    )
    text = IMPULSE.replace('"trace"', '"s"\nconjugate = true').replace('"sample"', '"frequency"')
    text = re.sub(
        r"\[samples\].*?\[antenna",
        '[frequency]\nvariable = "f"\nunit = "Hz"\n[antenna',
        text,
        flags=re.S,
    )
    text += '[path_offset]\nvalues = 4.0\nunit = "m"\nmeaning = "range"\n'
    run = import_mapped(put(text, tmp_path / "m.toml"), tmp_path / "p.npz").run
    expected = np.exp(-2j * np.pi * FREQUENCY * path / 299_792_458.0)
    np.testing.assert_allclose(run["signal"].values[0, 0, 0], expected, atol=1e-6)


def test_text_tables(tmp_path):
    table = open_arrays(put("f;s\n1e9;1+2i\n2e9;-3-4.5i\n", tmp_path / "a.csv"))
    np.testing.assert_array_equal(table.read("s"), [1 + 2j, -3 - 4.5j])
    assert table.read("table").shape == (2, 2)
    for text in ("f;s\n1,5;1,25-2i\n-2,5e3;,5\n", "f\ts\n1,5\t1,25-2i\n-2,5e3\t0,5\n"):
        commas = open_arrays(put(text, tmp_path / "d.csv"))
        np.testing.assert_array_equal(commas.read("table"), [[1.5, 1.25 - 2j], [-2500, 0.5]])
    plain = open_arrays(put("# made by hand\n1 2 3\n4 5 nan\n", tmp_path / "b.txt")).read("table")
    np.testing.assert_array_equal(plain, [[1, 2, 3], [4, 5, np.nan]])
    for text, words in (
        ("1,2\n3\n", "line 2 must have 2 cells"),
        ("1.5;2\n3,5;4\n", "line 2 .* decimal commas .* '3,5'"),
        ("1,5 2,5\n3,5 4,5\n", "decimal commas .* semicolons"),
        ("x,y\n1,5,2,5\n", "2 cells .* semicolons"),
        ("", "no line with values"),
        ("a,b\n", "no line with values"),
        ("a,a\n1,2\n", "different columns"),
        ("x\0y\n", "zero bytes"),
    ):
        with pytest.raises(ValueError, match=words):
            open_arrays(put(text, tmp_path / "c.csv"))


def test_arrays_over_the_limit_are_not_read(arrays, tmp_path):
    write(arrays, tmp_path / "a.h5")
    with h5py.File(tmp_path / "huge.h5", "w") as file:
        file.create_dataset("field", (1 << 20, 1 << 20), chunks=(1024, 1024), dtype="f8")
    with pytest.raises(ValueError, match="at most 2 GB"):
        open_arrays(tmp_path / "huge.h5").read("field")
    with pytest.raises(ValueError, match="at most"):
        open_arrays(tmp_path / "a.h5", limit=100)


def test_files_beside_the_mapping_are_found_too(arrays, tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "data").mkdir()
    np.savez(tmp_path / "maps" / "antennas.npz", tx=arrays.pop("tx"), rx=arrays.pop("rx"))
    text = MAPPING.replace('variable = "tx"', 'file = "antennas"\nvariable = "tx"')
    text = text.replace('variable = "rx"', 'file = "antennas"\nvariable = "rx"')
    text = text.replace("[signal]", '[files]\nantennas = "antennas.npz"\n[signal]', 1)
    mapping = put(text, tmp_path / "maps" / "m.toml")
    run = import_mapped(mapping, write(arrays, tmp_path / "data" / "a.npz")).run
    np.testing.assert_allclose(run["rx_position"].values[1], RX[1])
    (tmp_path / "maps" / "antennas.npz").unlink()
    with pytest.raises(FileNotFoundError, match=r"files\.antennas: no file in .*data or .*maps"):
        import_mapped(mapping, tmp_path / "data" / "a.npz")


@pytest.mark.parametrize(("name", "library"), [("a.h5", "HDF5"), ("a.mat", "MATLAB")])
@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("while True: pass", "did not come to an end"),
        ("import os; os.abort()", "the {} library crashes"),
    ],
)
def test_files_that_hang_or_crash_a_library_are_refused(
    arrays, name, library, code, words, tmp_path, monkeypatch
):
    monkeypatch.setattr("flgpr.formats.arrays._CHILD", put(code, tmp_path / "child.py"))
    monkeypatch.setattr("flgpr.formats.arrays._PATIENCE", 0.5)
    with pytest.raises(ValueError, match=words.format(library)):
        open_arrays(write(arrays, tmp_path / name))


@needs("flgpr_exchange")
def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "skrf", None)
    with pytest.raises(MissingExtraError, match=r"flgpr\[vna\]"):
        open_arrays(put("# MHz S RI R 50\n500 0 0 0 0 0 0 0 0\n", tmp_path / "a.s2p"))


def test_unknown_endings_and_absent_files(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"b\.h5"):
        open_arrays(tmp_path / "b.h5")
    with pytest.raises(ValueError, match="ending"):
        open_arrays(put("x", tmp_path / "a.docx"))
    with pytest.raises(ValueError, match="HDF5 signature"):
        open_arrays(put("x", tmp_path / "a.h5"))
