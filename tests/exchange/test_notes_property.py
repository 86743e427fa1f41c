"""Whatever is assumed, replaced or dropped of other programs' files is in the notes; what was measured stays.

The recordings of commercial radars have their properties in ``test_gpr_notes_property.py``.
"""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from damage import CASES, FUZZ, in_forks
from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapped import import_mapped
from flgpr.formats.tracks import read_nmea, read_track
from flgpr.geo.anchor import fit_anchor
from flgpr_exchange.gprmax.files import GprmaxSetup, import_gprmax_files
from io_geodesy import LANE, on_the_ellipsoid
from io_notes import check_notes, if_any, some
from scans_mapping import TIME, line_mapping

pytestmark = pytest.mark.slow("many drawn files")

GUARDED = settings(FUZZ, max_examples=max(CASES // 4, 1))
"""Of files that a child process reads, which takes its time."""
RNG = np.random.default_rng(11)
SCANS = 12
TONES = 6
SIGNAL = (RNG.normal(size=(SCANS, TONES)) + 1j * RNG.normal(size=(SCANS, TONES))).astype(
    np.complex64
)


# --- arrays by a mapping


def write_arrays(path, arrays):
    """Write named arrays as NumPy, MATLAB or HDF5, the latter two with a text beside, HDF5 with ragged rows, too."""
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        savemat(path, arrays | {"remark": "by hand"})
    else:
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
            file["remark"] = "by hand"
            file["ragged"] = np.array([np.arange(2), np.arange(3)], dtype=h5py.vlen_dtype(np.int32))
    return path


TRACK = """[track]
time = {variable = "clock", unit = "s"}
position = {variable = "place", unit = "m"}
heading = "course"
pitch = 0
roll = 0
angle_unit = "deg"
clock_offset = 0.0
max_gap = 9.0
"""


@pytest.mark.parametrize("ending", ["npz", "mat", "h5"])
@GUARDED
@given(
    falling=st.booleans(),
    conjugate=st.booleans(),
    missing=some(0, SCANS - 2),
    lost=some(1, 18),
    raster=st.booleans(),
)
def test_mapped_arrays(ending, falling, conjugate, missing, lost, raster, tmp_path):
    signal = SIGNAL.copy()
    signal[sorted(missing), 2] = np.nan
    tones = np.linspace(1.0, 1.5, TONES)
    stored = signal.conj() if conjugate else signal
    stored = stored[:, ::-1] if falling else stored
    clock = np.arange(20.0)
    place = np.stack([0 * clock, 0.5 * clock, 0 * clock + 1], axis=1)
    place[sorted(lost), 1] = np.nan
    arrays = {
        "s": stored.reshape(3, 4, TONES) if raster else stored,
        "f": tones[::-1] if falling else tones,
        "t": np.arange(SCANS) + 3.0,
        "clock": clock,
        "place": place,
    }
    path = write_arrays(tmp_path / f"a.{ending}", arrays)
    text = line_mapping(path.name, TIME, TRACK, tones='variable = "f"')
    if conjugate:
        text = text.replace("[frequency]", "conjugate = true\n[frequency]")
    if raster:
        text = text.replace('["scan", "frequency"]', '["scan", "scan", "frequency"]')
    (tmp_path / "m.toml").write_text(text)
    with in_forks():
        arrived = import_mapped(tmp_path / "m.toml")
    check_notes(
        arrived.run.attrs["import_notes"],
        "poses from the track at 0 s + 1 · radar time",
        "tones sorted by frequency" if falling else None,
        "phases turned round" if conjugate else None,
        "3 x 4 positions made 12 scans" if raster else None,
        if_any(missing, f"{len(missing)} of {SCANS} sweeps hold values that are no numbers"),
        if_any(lost, f"{len(lost)} of 20 fixes of the track not finite, bridged"),
    )
    np.testing.assert_array_equal(arrived.run["signal"].values[:, 0, 0], signal)
    assert np.flatnonzero(~arrived.run["valid"].values[:, 0, 0]).tolist() == sorted(missing)
    np.testing.assert_allclose(arrived.run["pose"].values[:, 1], 0.5 * (np.arange(SCANS) + 3))


@pytest.mark.parametrize(("ending", "unread"), [("mat", ()), ("h5", ("ragged",))])
def test_what_is_no_array_of_numbers_is_named(ending, unread, tmp_path):
    opened = open_arrays(write_arrays(tmp_path / f"a.{ending}", {"s": SIGNAL}))
    for name in unread:
        assert any(line.startswith(f"{name}: not read") for line in opened.about)
    assert opened.arrays["remark"].dtype in ("text", "<U7")


# --- gprMax

FIELDS = ("Ex", "Ey", "Ez", "Hx")
STEPS = 64


def write_model(path, receivers, names, kind, samples):
    """Write a result of gprMax: ``receivers`` tell the fields of each, and which of them hold a value that is none."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"gprMax": "3.1", "Title": "made", "Iterations": STEPS, "dt": 2e-11})
        file.attrs["dx_dy_dz"] = (0.01, 0.01, 0.01)
        source = file.create_group("srcs/src1")
        source.attrs.update({"Type": kind, "Position": np.array([1.0, 1.0, 1.0])})
        if samples:
            group = source.create_group("excitation")
            group["samples"] = np.hanning(STEPS)
            group.attrs.update({"Units": "A", "TimeSampleOffset": 0.0, "SpatialScale": 0.01})
        for n, (fields, bad) in enumerate(receivers):
            group = file.create_group(f"rxs/rx{n + 1}")
            group.attrs.update({"Name": names[n], "Position": np.array([1.0 + 0.1 * n, 1.0, 1.0])})
            for name in fields:
                values = np.hanning(STEPS) * (n + 1)
                values[5] = np.nan if bad else values[5]
                group[name] = values
    return path


@GUARDED
@given(
    more=st.lists(
        st.tuples(st.sets(st.sampled_from(FIELDS[1:])), st.booleans()), min_size=2, max_size=3
    ),
    same=st.booleans(),
    dipole=st.booleans(),
    samples=st.booleans(),
)
def test_gprmax(more, same, dipole, samples, tmp_path):
    receivers = [({"Ex", *fields}, bad and n > 0) for n, (fields, bad) in enumerate(more)]
    names = ["Rx"] * len(more) if same else [f"Rx{n}" for n in range(len(more))]
    kind = "HertzianDipole" if dipole else "VoltageSource"
    path = write_model(tmp_path / "a.out", receivers, names, kind, samples)
    told = GprmaxSetup((2e9, 5e9), "H", 0.5, waveform=None if samples else ("ricker", 1.5e9))
    with in_forks():
        run = import_gprmax_files([path], told)
    used = ["Ex", *(["Ez"] if all("Ez" in fields for fields, _ in receivers) else [])]
    unused = {name: sum(name in fields for fields, _ in receivers) for name in FIELDS}
    bad = sum(bad for _, bad in receivers) * len(used)
    count = len(receivers)
    check_notes(
        run.attrs["import_notes"],
        "the direct wave stays in the data",
        "H is taken as the component x, V as z",
        "the ground is put at a height of 0.5 m",
        "places are those of the nodes: field components lie up to 5 mm further",
        None if samples else "waveform is taken as ricker of 1.5 GHz and unit amplitude",
        None if dipole else "the source is of type VoltageSource",
        f"{bad} of {count * len(used)} fields hold values that are no numbers" if bad else None,
        *(
            f"{name} of {times} of {count} receivers is not used" if times else None
            for name, times in unused.items()
            if name not in used
        ),
    )
    assert run.sizes["pair"] == count
    first = run["signal"].values[0, 0]
    valid = run["valid"].values[0, 0]
    ratio = first[valid] / first[0]  # each receiver's field is so many times the first one's
    wanted = np.flatnonzero(valid)[:, None] + 1.0
    np.testing.assert_allclose(ratio, np.broadcast_to(wanted, ratio.shape), rtol=1e-3)


# --- tracks

ROWS = 20


@FUZZ
@given(
    lost=some(1, ROWS - 2),
    encoding=st.sampled_from(["utf-8", "latin-1", "utf-16"]),
    comma=st.booleans(),
    angles=st.sets(st.sampled_from(["pitch", "roll"])),
    remarks=some(0, ROWS - 1),
)
def test_tracks(lost, encoding, comma, angles, remarks, tmp_path):
    columns = ["time_s", "x_m", "y_m", "z_m", *(f"{name}_deg" for name in sorted(angles))]
    lines = [";".join([*columns, "Bemerkung für später"])]
    for k in range(ROWS):
        values = [0.25 * k, 1.5, "" if k in lost else 2.0 * k, 0.5, *([3.0] * len(angles))]
        cells = [str(value).replace(".", ",") if comma else str(value) for value in values]
        lines.append(";".join([*cells, "Kurve" if k in remarks else ""]))
    path = tmp_path / "t.csv"
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    track = read_track(path, "course", max_gap=9.0)
    flat = [name for name in ("pitch", "roll") if name not in angles]
    coding = {"latin-1": "is text in Latin-1", "utf-16": "is text in UTF-16"}.get(encoding)
    check_notes(
        track.attrs["notes"],
        coding,
        "read as decimal commas" if comma else None,
        if_any(
            remarks,
            f"column 'Bemerkung für später' is not read: {len(remarks)} of its {ROWS} cells",
        ),
        if_any(flat, f"no column tells {' and '.join(flat)}: 0 is taken"),
        if_any(lost, f"{len(lost)} of {ROWS} fixes of the track not finite, bridged"),
    )
    rows = [k for k in range(ROWS) if k not in lost]
    np.testing.assert_allclose(track["y"], 2.0 * np.array(rows))
    np.testing.assert_allclose(track["time"], 0.25 * np.array(rows))


def with_checksum(sentence):
    total = 0
    for letter in sentence:
        total ^= ord(letter)
    return f"${sentence}*{total:02X}"


@FUZZ
@given(poor=some(1, ROWS - 2), repeated=some(1, ROWS - 2), turned=st.booleans())
def test_nmea(poor, repeated, turned, tmp_path):
    lines = []
    good = 0
    for k in range(ROWS):
        quality = 1 if k in poor else 4
        minutes = 7.038 + 1e-4 * k
        place = f"48{minutes:010.7f},N,01131.0000000,E,{quality},08,0.9,545.4,M,46.9,M,,"
        fix = with_checksum(f"GPGGA,1235{k:02d}.00,{place}")
        lines += [fix] * (2 if k in repeated else 1)
        good += quality == 4
        if turned:
            lines.append(with_checksum("GPHDT,10.00,T"))
    path = tmp_path / "t.nmea"
    path.write_text("\r\n".join(lines) + "\r\n")
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    track = read_nmea(path, anchor)
    unused = len(poor) + len(poor & repeated)
    fixes = ROWS + len(repeated)
    again = len(repeated - poor)
    check_notes(
        track.attrs["notes"],
        "pitch and roll are taken as 0, which NMEA does not tell",
        "HDT states no time: a heading has that of the position before it"
        if turned
        else "no sentence tells a heading: it is the direction of the way",
        f"{unused} of {fixes} fixes are not of quality (4,) and not used" if unused else None,
        f"{again} fixes whose time does not go on are not used" if again else None,
    )
    assert len(track) == good
    kept = np.array([k for k in range(ROWS) if k not in poor])
    np.testing.assert_allclose(np.diff(track["time"]), np.diff(kept))


# --- Touchstone


@FUZZ
@given(
    order=st.permutations(range(5)),
    noise=st.integers(0, 3),
    encoding=st.sampled_from(["utf-8", "latin-1", "utf-16"]),
    second=st.booleans(),
)
def test_touchstone(order, noise, encoding, second, tmp_path):
    pytest.importorskip("skrf")
    if second:  # of version 2, which says itself what is noise, and must rise
        order = list(range(5))
    rows = [f"{1 + k}00 " + " ".join(f"{k}.{n} -{n}" for n in range(4)) for k in order]
    dirt = [f"{100 + 50 * k} 1.0 0.5 10 0.2" for k in range(noise)]
    lines = ["! gemessen für später", "# MHz S RI R 50", *rows, *dirt]
    if second:
        behind = ["[Noise Data]", *dirt] if noise else []
        lines = [
            "! gemessen für später", "[Version] 2.0", "# MHz S RI R 50", "[Number of Ports] 2",
            "[Two-Port Data Order] 21_12", "[Number of Frequencies] 5",
            *([f"[Number of Noise Frequencies] {noise}"] if noise else []),
            "[Network Data]", *rows, *behind, "[End]",
        ]  # fmt: skip
    path = tmp_path / ("a.ts" if second else "a.s2p")
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    opened = open_arrays(path)
    coding = {"latin-1": "is text in Latin-1", "utf-16": "is text in UTF-16"}.get(encoding)
    check_notes(
        opened.notes,
        coding,
        None if list(order) == sorted(order) else "its 5 tones do not rise",
        f"{noise} lines of noise parameters are not read" if noise else None,
    )
    np.testing.assert_allclose(opened.read("frequency"), 1e8 * np.arange(1, 6))
    for n, name in enumerate(("s11", "s21", "s12", "s22")):
        np.testing.assert_allclose(opened.read(name), np.arange(5) + 0.1 * n - 1j * n)
