"""Recordings of commercial radars: every count, delay and place as written, and a run whose phases are the echoes'."""

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats import explain_file, gpr_run, read_gpr
from flgpr.geo import fit_anchor
from flgpr.store import open_run
from flgpr_exchange.commands.imports import import_gpr
from flgpr_exchange.gpr.files import NOT_READ
from io_geodesy import LANE, on_the_ellipsoid
from io_gpr import (
    INTERVAL,
    NOMINAL,
    SAMPLES,
    SEPARATION,
    STEP,
    ZERO,
    gga,
    ibm,
    section,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)  # fmt: skip

COUNTS = section()
DELAY = (np.arange(SAMPLES) - ZERO) * INTERVAL
ALONG = STEP * np.arange(len(COUNTS))
WRITERS = {
    "a.DT1": write_dt1,
    "f.dt1": lambda path, counts: write_dt1(path, counts, real=True),
    "big.dt1": lambda path, counts: write_dt1(path, counts, order=">"),
    "a.dzt": lambda path, counts: write_dzt(path, counts[:, None]),
    "w.DZT": lambda path, counts: write_dzt(path, counts[:, None], bits=32),
    "a.rd3": write_mala,
    "a.RD7": write_mala,
    "a.iprb": write_impulse,
    "w.iprb": lambda path, counts: write_impulse(path, counts, bits=32),
    "a.dt": write_ids,
    "u.DT": lambda path, counts: write_ids(path, counts, 2052, unsigned=32768),
    "a.sgy": write_segy,
    "i.sgy": lambda path, counts: write_segy(path, counts, code=1),
    "f.SEGY": lambda path, counts: write_segy(path, counts, code=5, order="<"),
    "l.sgy": lambda path, counts: write_segy(path, counts, code=2),
}


def written(name, folder, counts=COUNTS):
    return WRITERS[name](folder / name, counts)


@pytest.mark.parametrize("name", WRITERS)
def test_every_count_comes_back_at_its_delay_and_place(name, tmp_path):
    read = read_gpr(written(name, tmp_path))
    first = 2 if name.lower().endswith("dzt") else 0
    np.testing.assert_array_equal(read.traces[:, 0, first:], COUNTS[:, first:])
    knows_zero = name.split(".")[1].lower() in ("dt1", "dzt", "iprb")
    np.testing.assert_allclose(read.delay, DELAY if knows_zero else DELAY - DELAY[0], atol=1e-14)
    assert any("no time zero" in note for note in read.history) == (not knows_zero)
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-5)
    if name[-3:].lower() in ("dt1", "rd3", "rd7", "prb", ".dt"):
        assert read.frequencies == (NOMINAL,)
        assert read.separation == pytest.approx(SEPARATION)


def test_channels_of_a_dzt_are_apart(tmp_path):
    both = np.stack([COUNTS, -COUNTS], axis=1)
    read = read_gpr(write_dzt(tmp_path / "a.dzt", both, names=("50400S", "HS350US")))
    assert read.frequencies == (400e6, 350e6)
    np.testing.assert_array_equal(read.traces[..., 2:], both[..., 2:])
    assert read.marks == (5,)
    first = gpr_run(read, 0, band=(1e8, 1e9))
    second = gpr_run(read, 1, band=(1e8, 1e9))
    np.testing.assert_allclose(first["signal"].values, -second["signal"].values, rtol=1e-5)
    assert any("channel 1 of 2" in note for note in second.attrs["import_notes"])
    with pytest.raises(ValueError, match="channel must be from 0 to 1, got 2"):
        gpr_run(read, 2)


@pytest.mark.parametrize("kind", ["dt1", "dzt", "rd3", "iprb", "sgy"])
def test_positions_and_an_anchor_put_the_traces_in_the_lane(kind, tmp_path):
    """Fixes of every fourth trace from the third on, on the ellipsoid by geodesics, along a line askew in the lane."""
    traces = np.arange(2, 40, 4)
    lane = np.stack(
        [0.5 + 0.6 * STEP * np.arange(40), 3.0 + 0.8 * STEP * np.arange(40), np.zeros(40)], axis=1
    )
    lon, lat = on_the_ellipsoid(lane).T
    names = {"dt1": "a.DT1", "dzt": "a.dzt", "rd3": "a.rd3", "iprb": "a.iprb"}
    if kind == "sgy":
        places = np.round(np.stack([lon, lat], axis=1) * 3600 * 10000).astype(int)
        path = write_segy(tmp_path / "a.sgy", COUNTS, unit=2, scalar=-10000, place=places)
        traces = np.arange(40)
    else:
        path = written(names[kind], tmp_path)
    if kind == "dt1":
        lines = [f"Trace #{k + 1} at position {k * STEP}\n{gga(lat[k], lon[k], 0)}" for k in traces]
        path.with_suffix(".GPS").write_text(
            "\n".join([*lines, "Trace #9 at", "$GPGGA,,,,,,0,,,,,,,,*66"])
        )
    elif kind == "dzt":
        path.with_suffix(".DZG").write_text(
            "\n".join(f"$GSSIS,{k},{k}\n{gga(lat[k], lon[k], 0)}\n" for k in traces)
        )
    elif kind != "sgy":
        rows = [
            f"{k + 1}\t2024-04-04\t12:00:00\t{lat[k]:.9f}\tN\t{lon[k]:.9f}\tE\t0.0\tM\t1"
            for k in traces
        ]
        path.with_suffix(".cor").write_text(
            "\n".join([*rows, "99999\t-\t-\t1\tN\t1\tE\t0\tM\t1", "rubbish"])
        )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.fixes[:, 0], traces)
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    run = gpr_run(read, anchor=anchor, height=0.1)
    kept = np.arange(traces[0], traces[-1] + 1)
    near = 0.01 if kind == "sgy" else 1e-3  # SEG-Y holds whole units only
    np.testing.assert_allclose(run["pose"].values[:, :2], lane[kept, :2], atol=near)
    np.testing.assert_allclose(run["pose"].values[:, 2], 0.1)
    if kind != "sgy":
        np.testing.assert_allclose(run["pose"].values[:, 3], np.arctan2(0.6, 0.8), atol=0.01)


@pytest.mark.parametrize("name", WRITERS)
def test_a_last_trace_that_is_cut_off_is_left_out(name, tmp_path):
    path = written(name, tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-10])
    read = read_gpr(path)
    assert len(read.traces) == len(COUNTS) - 1
    assert any("cut off" in note for note in read.history)
    path.write_bytes(whole[: len(whole) // 2])
    assert 1 < len(read_gpr(path).traces) < len(COUNTS)
    for size in (0, 1, 200):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=path.name):
            read_gpr(path)


def test_truncation_is_told(tmp_path):
    path = written("a.rd3", tmp_path)
    path.write_bytes(path.read_bytes()[: 20 * 2 * SAMPLES])
    assert any(
        "truncated: the header tells 40 traces, the file holds 20" in note
        for note in read_gpr(path).history
    )


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"NUMBER_OF_PTS/TRC": 10**9}, "NUMBER OF PTS/TRC must be a number from 2"),
        ({"NUMBER_OF_PTS/TRC": "many"}, "got 'many'"),
        ({"NUMBER_OF_PTS/TRC": 128}, "must have 128 points as a.hd says"),
        ({"TOTAL_TIME_WINDOW": 1e9}, "TOTAL TIME WINDOW"),
        ({"TOTAL_TIME_WINDOW": ""}, "must hold TOTAL TIME WINDOW"),
        ({"ANTENNA_SEPARATION": "nan"}, "ANTENNA SEPARATION"),
        ({"DATA_TYPE": "C*8"}, r"DATA TYPE must be I\*2 or F\*4, got 'C\*8'"),
    ],
)
def test_absurd_headers_are_refused(entries, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        read_gpr(write_dt1(tmp_path / "a.dt1", COUNTS, **entries))


def test_what_is_too_large_is_refused_before_it_is_read(tmp_path):
    for name in WRITERS:
        with pytest.raises(ValueError, match="must fit into"):
            read_gpr(written(name, tmp_path), max_memory=1000)
    with (tmp_path / "huge.rd3").open("wb") as file:
        file.truncate(2**33)  # a hole: no disk is taken
    (tmp_path / "huge.rad").write_text("SAMPLES:512\nFREQUENCY:5000\n")
    with pytest.raises(ValueError, match="must fit into 2 GB"):
        read_gpr(tmp_path / "huge.rd3")


def test_wrong_endings_and_foreign_files(tmp_path):
    for name in ("a.dzt", "a.sgy"):
        (tmp_path / name).write_bytes(b"\x01\x02" * 4000)
        with pytest.raises(ValueError, match=name):
            read_gpr(tmp_path / name)
    path = written("a.DT1", tmp_path)
    other = path.rename(tmp_path / "a.rd3")
    with pytest.raises(FileNotFoundError, match=r"a\.rad must lie beside it"):
        read_gpr(other)
    with pytest.raises(ValueError, match=r"give the \.dt1 file"):
        read_gpr(tmp_path / "a.hd")
    with pytest.raises(FileNotFoundError, match="not found"):
        read_gpr(tmp_path / "no.dt1")
    (tmp_path / "a.xyz").write_bytes(b"1")
    with pytest.raises(ValueError, match=r"ending must be one of \.dt1"):
        read_gpr(tmp_path / "a.xyz")
    with pytest.raises(ValueError, match="is the byte order wrong"):
        read_gpr(write_segy(tmp_path / "big.sgy", 1e33 * COUNTS, code=5))


@pytest.mark.parametrize("suffix", NOT_READ)
def test_what_cannot_be_read_is_named(suffix, tmp_path):
    path = tmp_path / f"a{suffix.upper()}"
    path.write_bytes(b"anything")
    told = explain_file(path)
    assert told.kind == f"{NOT_READ[suffix][0]} file"
    assert "cannot be read" in told.lines[0]
    with pytest.raises(ValueError, match=f"{told.kind}s cannot be read: .*(export|unzip)"):
        read_gpr(path)


def test_ibms_floating_point():
    """The worked example of the format: -118.625 is C276A000."""
    from flgpr_exchange.gpr.segy import _ibm

    values = np.array([-118.625, 0.0, 1.0, 12000.0, 2.0**-70])
    words = np.array([ibm(value) for value in values], dtype=">u4")
    assert words[0] == 0xC276A000
    np.testing.assert_array_equal(_ibm(words), values.astype(np.float32))


@pytest.mark.parametrize("name", ["a.DT1", "a.dzt", "a.rd3", "a.iprb", "a.dt", "a.sgy"])
def test_info_tells_and_the_command_it_names_imports(name, tmp_path, monkeypatch):
    written(name, tmp_path)
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(app, ["info", name])
    assert told.exit_code == 0, told.output
    assert "40 traces x 256 samples" in told.output
    assert "length 1.95 m, trace spacing 0.05 m" in told.output
    command = told.output.strip().splitlines()[-1].partition("flgpr ")[2].split()
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "note: impulse data taken to frequency" in done.output
    run = open_run("a.zarr")
    assert run.sizes["scan"] == 40
    assert run.attrs["source"].endswith(name)
    assert "exists already" in CliRunner().invoke(app, command).output
    assert CliRunner().invoke(app, [*command, "--height", "0.1"]).exit_code == 2
    assert "warning" not in CliRunner().invoke(app, ["info", "a.zarr"]).output


def test_info_without_the_header_names_it(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS, hd=False)
    assert explain_file(path).kind == "Sensors & Software DT1"
    assert explain_file(path).lines == ["its header a.hd must lie beside it, it does not"]
    done = CliRunner().invoke(app, ["import", "gpr", str(path), "-o", str(tmp_path / "a.zarr")])
    assert done.exit_code == 2
    assert "a.hd" in done.output
    assert not list(tmp_path.glob("*.zarr*"))


def test_units_of_the_command_line(tmp_path):
    path = written("a.rd3", tmp_path)
    store = tmp_path / "a.zarr"
    words = [
        "import",
        "gpr",
        str(path),
        "-o",
        str(store),
        "--time-zero",
        "4",
        "--step",
        "0.1",
        "--quiet",
    ]
    done = CliRunner().invoke(app, [*words, "--band", "2e8", "8e8"])
    assert (done.exit_code, done.output) == (0, "")
    run = open_run(store)
    assert run.attrs["first_sample_s"] == pytest.approx(-4e-9)
    assert 2e8 <= run["frequency"].values[0] < run["frequency"].values[-1] <= 8e8
    with pytest.raises(FileExistsError):
        import_gpr(path, store)


def test_segyio_writes_what_is_read(tmp_path):
    segyio = pytest.importorskip("segyio")
    spec = segyio.spec()
    spec.samples = np.arange(SAMPLES)
    spec.format = 1
    spec.tracecount = len(COUNTS)
    with segyio.create(tmp_path / "a.sgy", spec) as file:
        file.trace = COUNTS.astype(np.float32)
        file.bin[segyio.BinField.Interval] = 200
    read = read_gpr(tmp_path / "a.sgy")
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_allclose(read.delay, np.arange(SAMPLES) * INTERVAL, atol=1e-15)


def test_a_fix_that_no_vehicle_reaches_moves_no_trace(tmp_path):
    """A receiver that lost its satellites is anywhere: left out with a count, and traces lie between the others."""
    traces = np.arange(2, 40, 4)
    lane = np.stack([np.zeros(40), STEP * np.arange(40), np.zeros(40)], axis=1)
    lon, lat = on_the_ellipsoid(lane).T
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None])
    lines = [
        f"$GSSIS,{k},{k}\n{gga(10.5, 0, 0) if k == 18 else gga(lat[k], lon[k], 0)}\n"
        for k in traces
    ]
    path.with_suffix(".DZG").write_text("\n".join(lines))
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [0.0] * 4)
    run = gpr_run(read_gpr(path), anchor=anchor, height=0.1)
    np.testing.assert_allclose(run["pose"].values[:, :2], lane[2:39, :2], atol=1e-3)
    (note,) = [line for line in run.attrs["import_notes"] if "satellite receiver left out" in line]
    assert note.startswith(
        "1 of 10 positions of the satellite receiver left out, which no vehicle reaches"
    )
    assert "scan 18 after scan 14" in note


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.gps", "lies beside a recording and is read with it; give the .dt1 file"),
        ("a.DZX", "give the .dzt file"),
        ("a.cor", "give the .rd3, .rd7 or .iprb file"),
        ("a.sg2", "SEG-2 files cannot be read"),
    ],
)
def test_what_belongs_to_a_recording_or_is_known_is_told_so(name, words, tmp_path):
    (tmp_path / name).write_text("x")
    with pytest.raises(ValueError, match=words):
        read_gpr(tmp_path / name)
