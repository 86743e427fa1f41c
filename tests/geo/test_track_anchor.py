"""A lane that follows from a track itself: for lines of commercial radars and for runs of a vehicle."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from alone import needs
from flgpr.commands.app import app
from flgpr.formats import nmea_places
from flgpr.geo import anchor_from_fixes
from flgpr.store import open_run
from io_gpr import gga, section, write_mala
from scans_mapping import line_mapping

# degrees per metre at 50 N and 400 m, within 0.02 %
NORTH = 1 / 111_236.0
EAST = 1 / 71_700.0


def fixes_along(azimuth, lengths, height=400.0):
    """Fixes at 50 N 8 E, lengths (m) along a straight course, with their heights."""
    turn = np.radians(azimuth)
    along = np.asarray(lengths, dtype=float)
    lon = 8 + along * np.sin(turn) * EAST
    lat = 50 + along * np.cos(turn) * NORTH
    return np.stack([lon, lat, np.full(along.size, height)], axis=-1)


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("azimuth", [0.0, 37.0, 90.0, 200.0, 350.0])
def test_the_first_fix_is_the_origin_and_the_course_is_y(azimuth):
    fixes = fixes_along(azimuth, np.linspace(0, 60, 25))
    anchor, notes = anchor_from_fixes(fixes)
    lane = anchor.from_geodetic(fixes)
    np.testing.assert_allclose(lane[0], 0, atol=1e-6)
    np.testing.assert_allclose(lane[:, 0], 0, atol=2e-3)
    np.testing.assert_allclose(lane[:, 1], np.linspace(0, 60, 25), rtol=2e-3)
    assert anchor.georeference()["azimuth"] % 360 == pytest.approx(azimuth, abs=0.1)
    assert notes[0].startswith(
        "the lane follows from the track: its origin is the first fix, 50.0000000 N 8.0000000 E"
    )
    assert np.isnan(anchor.uncertainty(0.0, 0.0))  # nobody surveyed it


def test_fixes_that_no_vehicle_reaches_do_not_place_the_lane():
    fixes = fixes_along(30.0, np.linspace(0, 60, 25))
    wrong = fixes.copy()
    wrong[0] = 0.0, 0.0, 0.0  # before the receiver knew
    wrong[9] = np.nan
    anchor, notes = anchor_from_fixes(wrong)
    np.testing.assert_allclose(anchor.origin, fixes[1], atol=1e-9)
    assert anchor.georeference()["azimuth"] == pytest.approx(30.0, abs=0.1)
    assert "2 of 25 fixes are not plausible and do not enter the lane's place" in notes


def test_a_way_there_and_back_points_to_its_far_end():
    there = np.concatenate([np.linspace(0, 60, 20), np.linspace(60, 1, 20)])
    anchor, _ = anchor_from_fixes(fixes_along(120.0, there))
    assert anchor.georeference()["azimuth"] == pytest.approx(120.0, abs=0.1)


@pytest.mark.parametrize(
    ("fixes", "rule"),
    [
        (fixes_along(0, [0.0]), "needs two finite fixes or more, got 1 of 1"),
        (fixes_along(0, [0.0, 0.01, 0.02]), "goes 0.5 m away from its first fix, got 0.02 m"),
        (np.full((3, 3), np.nan), "needs two finite fixes or more, got 0 of 3"),
    ],
)
def test_what_has_no_course_is_refused(fixes, rule):
    with pytest.raises(ValueError, match=rule):
        anchor_from_fixes(fixes)


def timed_line(folder, traces=40, every=5):
    """A line triggered by time, without a wheel, with a fix at every so many traces, 0.1 m apart."""
    path = write_mala(folder / "timed.rd3", section(traces), DISTANCE_FLAG=0)
    lines = []
    for k in range(0, traces, every):
        lon, lat, height = fixes_along(25.0, [0.1 * k])[0]
        lines.append(
            f"{k + 1}\t2020-01-02\t12:00:{k:02d}\t{lat:.9f}\tN\t{lon:.9f}\tE\t{height:.3f}\tM\t1.0"
        )
    path.with_suffix(".cor").write_text("\n".join(lines) + "\n")
    return path


@needs("flgpr_exchange")
def test_a_line_without_a_wheel_gets_its_distances_from_its_fixes(tmp_path):
    path = timed_line(tmp_path)
    refused = run("import", "gpr", path, "-o", tmp_path / "a.zarr")
    assert refused.exit_code == 2
    done = run("import", "gpr", path, "-o", tmp_path / "a.zarr", "--anchor-from-track")
    assert done.exit_code == 0, done.output
    assert "note: the lane follows from the track: its origin is the first fix" in done.output
    assert (
        "36 of 40 traces lie between positions of the satellite receiver and are kept"
        in done.output
    )
    held = open_run(tmp_path / "a.zarr")
    np.testing.assert_allclose(held["pose"].values[:, 1], 0.1 * np.arange(36), atol=2e-3)
    np.testing.assert_allclose(held["pose"].values[:, [0, 3]], 0, atol=2e-3)
    assert held.attrs["georeference"]["latitude"] == pytest.approx(50.0)
    assert held.attrs["georeference"]["azimuth"] == pytest.approx(25.0, abs=0.1)
    assert any(
        note.startswith("the lane follows from the track") for note in held.attrs["import_notes"]
    )


@needs("flgpr_exchange")
def test_two_anchors_and_a_line_without_fixes_are_refused(tmp_path):
    path = write_mala(tmp_path / "bare.rd3", section(10))
    done = run("import", "gpr", path, "-o", tmp_path / "a.zarr", "--anchor-from-track")
    assert done.exit_code == 2
    assert "an anchor from the track needs two finite fixes or more, got 0 of 0" in done.output
    (tmp_path / "anchor.toml").write_text("")
    both = ("--anchor-from-track", "--anchor", tmp_path / "anchor.toml")
    done = run("import", "gpr", path, "-o", tmp_path / "a.zarr", *both)
    assert (
        "anchor, anchor-from-track, line-spacing and lines all tell where lines lie: give one"
        in done.output
    )


MAPPING = line_mapping("drive.npz", polarization="VV", height=1.5)
POSE = """
[pose]
geodetic = {longitude = "lon", latitude = "lat", height = "h", angle_unit = "deg", unit = "m"}
heading = "course"
pitch = 0
roll = 0
angle_unit = "deg"
"""


def write_drive(folder, more=""):
    fixes = fixes_along(70.0, 0.5 * np.arange(12))
    rng = np.random.default_rng(2)
    signal = rng.normal(size=(12, 9)) + 1j
    np.savez(
        folder / "drive.npz",
        s=signal,
        lon=fixes[:, 0],
        lat=fixes[:, 1],
        h=fixes[:, 2],
        t=np.arange(12.0),
    )
    (folder / "drive.toml").write_text(MAPPING + more)
    return fixes


def test_a_vehicles_run_lies_in_a_lane_of_its_own_track(tmp_path):
    write_drive(tmp_path, POSE)
    done = run(
        "import",
        "mapped",
        tmp_path / "drive.toml",
        "-o",
        tmp_path / "a.zarr",
        "--anchor-from-track",
    )
    assert done.exit_code == 0, done.output
    assert "the lane follows from the track" in done.output
    held = open_run(tmp_path / "a.zarr")
    np.testing.assert_allclose(held["pose"].values[:, 1], 0.5 * np.arange(12), rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(held["pose"].values[:, [0, 2, 3]], 0, atol=3e-3)
    assert held.attrs["georeference"]["azimuth"] == pytest.approx(70.0, abs=0.1)
    assert any(
        note.startswith("the lane follows from the track") for note in held.attrs["import_notes"]
    )


def test_a_receivers_log_places_a_run_without_an_anchor(tmp_path):
    fixes = write_drive(tmp_path, '[time]\nvariable = "t"\nunit = "s"\n')
    lines = [
        gga(lat, lon, height).replace("120000.00", f"0000{k:02d}.00")
        for k, (lon, lat, height) in enumerate(fixes)
    ]
    lines = [line.split("*")[0] for line in lines]
    sums = [0] * len(lines)
    for k, line in enumerate(lines):
        for one in line[1:]:
            sums[k] ^= ord(one)
    (tmp_path / "t.nmea").write_text(
        "".join(f"{a}*{b:02X}\r\n" for a, b in zip(lines, sums, strict=True))
    )
    np.testing.assert_allclose(nmea_places(tmp_path / "t.nmea"), fixes, atol=1e-3)
    words = (
        "import",
        "mapped",
        tmp_path / "drive.toml",
        "-o",
        tmp_path / "a.zarr",
        "--track",
        tmp_path / "t.nmea",
    )
    assert "needs an anchor" in run(*words).output
    done = run(*words, "--anchor-from-track")
    assert done.exit_code == 0, done.output
    assert "the lane follows from the track" in done.output
    held = open_run(tmp_path / "a.zarr")
    np.testing.assert_allclose(held["pose"].values[:, 1], 0.5 * np.arange(12), atol=5e-3)
    assert json.loads(run("info", tmp_path / "a.zarr", "--json").stdout)["georeference"][
        "azimuth"
    ] % 360 == pytest.approx(70.0, abs=0.2)


def test_positions_that_are_no_fixes_make_no_anchor(tmp_path):
    write_drive(
        tmp_path,
        '[pose]\nx = 0\ny = "t"\nz = 0\nunit = "m"\nheading = 0\npitch = 0\nroll = 0\nangle_unit = "deg"\n',
    )
    done = run(
        "import",
        "mapped",
        tmp_path / "drive.toml",
        "-o",
        tmp_path / "a.zarr",
        "--anchor-from-track",
    )
    assert done.exit_code == 2
    assert "anchor-from-track needs fixes by longitude and latitude" in done.output
