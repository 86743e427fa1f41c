import math

import numpy as np
import pytest

from alone import needs
from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapped import import_mapped
from flgpr.formats.tracks import read_nmea, read_survey, read_track
from flgpr.geo.anchor import fit_anchor
from flgpr.model import vehicle_to_lane
from flgpr.model.track import make_track
from flgpr.store.writing import write_table
from io_geodesy import AZIMUTH, LANE, on_the_ellipsoid


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_track_by_columns(tmp_path):
    text = (
        "time_s,x_m,y_m,z_m,heading_deg,pitch_rad,roll_deg\n0,1,2,3,90,0.1,-5\n1,2,2,3,95,0.1,-5\n"
    )
    track = read_track(put(text, tmp_path / "t.csv"))
    np.testing.assert_allclose(track.iloc[0], [0, 1, 2, 3, np.pi / 2, 0.1, np.radians(-5)])
    bare = put("time_s,x_m,y_m,z_m\n0,0,0,1\n1,1,0,1\n2,2,0,1\n", tmp_path / "u.csv")
    with pytest.raises(ValueError, match="heading_deg or heading_rad is missing"):
        read_track(bare)
    np.testing.assert_allclose(read_track(bare, "course")["heading"], np.pi / 2)
    for old, new, words in (
        ("time_s", "t", "time_s is missing"),
        ("1,1,0,1", "0,1,0,1", "increase strictly"),
        ("\n1,1,0,1", "\n1,nan,0,1", "every max_gap = 1 s, got none for 2 s after 0 s"),
        ("2,2,0,1", "2,2,0", "4 cells"),
    ):
        changed = put(bare.read_text().replace(old, new), tmp_path / "v.csv")
        with pytest.raises(ValueError, match=words):
            read_track(changed, "course")
    with pytest.raises(FileNotFoundError):
        read_track(tmp_path / "no.csv")


def test_missing_fixes_of_a_table_are_counted(tmp_path):
    rows = [
        f"{0.4 * k:.1f};{'' if k in (0, 3, 4) else k};{'nan' if k == 7 else 0};1" for k in range(9)
    ]
    track = read_track(
        put("\n".join(["time_s;x_m;y_m;z_m", *rows]) + "\n", tmp_path / "t.csv"),
        "course",
        max_gap=1.2,
    )
    np.testing.assert_allclose(track["x"], [1, 2, 5, 6, 8])
    assert track.attrs["notes"] == [
        "no column tells pitch and roll: 0 is taken",
        "4 of 9 fixes of the track not finite, bridged",
    ]


def test_a_track_that_was_written_is_read_again(tmp_path):
    track = make_track(
        [0.1, 0.2, 1 / 3],
        np.random.default_rng(0).normal(size=(3, 3)),
        0.1,
        [0.2, 0.3, 1 / 7],
        -0.3,
    )
    write_table(track, tmp_path / "run-track.csv")
    np.testing.assert_array_equal(read_track(tmp_path / "run-track.csv"), track)


def test_two_marks_on_the_array_give_its_pose(tmp_path):
    pose = np.array([[1.0, 5.0, 1.8, 0.3, 0.05, -0.08], [1.1, 7.0, 1.9, -2.5, -0.1, 0.02]])
    marks = [
        np.concatenate([vehicle_to_lane([side, 0, 0], p) for side in (-1.2, 1.2)]) for p in pose
    ]
    lines = [",".join(map(repr, map(float, [*m, p[4]]))) for m, p in zip(marks, pose, strict=True)]
    head = ",".join([f"{s}_{a}_m" for s in ("left", "right") for a in "xyz"] + ["pitch_rad"])
    got = read_survey(put("\n".join([head, *lines]) + "\n", tmp_path / "s.csv"))
    for one, want in zip(got, pose, strict=True):
        np.testing.assert_allclose(
            vehicle_to_lane([1.2, 0, 0], one), vehicle_to_lane([1.2, 0, 0], want), atol=1e-12
        )
    np.testing.assert_allclose(got, pose, atol=1e-9)
    coincide = put(head + "\n1,1,1,1,1,1,0\n", tmp_path / "c.csv")
    with pytest.raises(ValueError, match="coincide at scan 0"):
        read_survey(coincide)


def test_surveyed_poses(tmp_path):
    text = "x_m;y_m;z_m;heading_deg;pitch_deg;roll_deg\n1;2;3;180;0;0\n4;5;6;0;1;2\n"
    pose = read_survey(put(text, tmp_path / "s.csv"))
    np.testing.assert_allclose(pose[1], [4, 5, 6, 0, *np.radians([1, 2])])
    with pytest.raises(ValueError, match="finite, got other values for scan 1"):
        read_survey(put(text.replace("4;5;6", "4;;6"), tmp_path / "s.csv"))


def sentence(body):
    check = 0
    for letter in body:
        check ^= ord(letter)
    return f"${body}*{check:02X}\r\n"


def gga(seconds, lon, lat, quality=4, height=301.5):
    clock = f"{int(seconds // 3600) % 24:02d}{int(seconds // 60) % 60:02d}{seconds % 60:05.2f}"
    parts = [f"{int(lat):02d}{(lat % 1) * 60:010.7f},N", f"{int(lon):03d}{(lon % 1) * 60:010.7f},E"]
    return sentence(
        f"GPGGA,{clock},{parts[0]},{parts[1]},{quality},12,0.7,{height - 47:.3f},M,47.000,M,,"
    )


@pytest.fixture
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)


WAY = np.array([[0.5, y, 0] for y in (0.0, 1.0, 2.0, 3.0)])


def test_nmea_positions_over_midnight(anchor, tmp_path):
    places = on_the_ellipsoid(WAY)
    log = "".join(gga(86398.5 + k, *place) for k, place in enumerate(places))
    track = read_nmea(put(log + sentence("GPGSV,1,1,00"), tmp_path / "n.nmea"), anchor)
    np.testing.assert_allclose(track["time"], 86398.5 + np.arange(4))
    np.testing.assert_allclose(track[["x", "y"]], WAY[:, :2], atol=0.002)
    np.testing.assert_allclose(track["z"], 1.5, atol=0.002)
    np.testing.assert_allclose(track["heading"], 0, atol=0.002)


def test_nmea_heading_of_a_dual_antenna_is_turned_to_the_lane(anchor, tmp_path):
    north = math.degrees(AZIMUTH) + 20
    log = "".join(
        gga(k, *place) + sentence(f"GPHDT,{north:.3f},T")
        for k, place in enumerate(on_the_ellipsoid(WAY))
    )
    track = read_nmea(put(log, tmp_path / "n.nmea"), anchor)
    np.testing.assert_allclose(np.degrees(track["heading"]), 20, atol=0.01)


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_nmea_that_an_anchor_refuses_is_named(anchor, tmp_path):
    log = put("".join(gga(k, 9.0, 95.0) for k in range(3)), tmp_path / "pole.nmea")
    with pytest.raises(ValueError, match=r"pole\.nmea: "):
        read_nmea(log, anchor)


def test_nmea_of_poor_quality_or_damaged(anchor, tmp_path):
    places = on_the_ellipsoid(WAY)
    poor = put(
        "".join(gga(k, *place, quality=1) for k, place in enumerate(places)), tmp_path / "n.nmea"
    )
    with pytest.raises(ValueError, match=r"quality \(4,\).*\{1: 4\}"):
        read_nmea(poor, anchor)
    assert len(read_nmea(poor, anchor, quality=(1,))) == 4
    bad = put(gga(1, *places[0]).replace("M,47", "M,48"), tmp_path / "b.nmea")
    with pytest.raises(ValueError, match=r"got 0 .*1 of 1 sentences of b\.nmea are left out"):
        read_nmea(bad, anchor)
    flat = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02)
    with pytest.raises(ValueError, match="height must be given"):
        read_nmea(poor, flat, quality=(1,))
    np.testing.assert_allclose(read_nmea(poor, flat, (1,), height=2.0)["z"], 2.0)


TOUCHSTONE = """
title = "VNA sweeps"
polarization = ["VV"]
join = "new pair"
[signal]
variable = "s21"
dims = ["frequency"]
[frequency]
variable = "frequency"
unit = "Hz"
[tx_position]
values = [[-0.5, 0, 0], [0.5, 0, 0]]
unit = "m"
[rx_position]
values = [[0, 0, 0], [0, 0, 0]]
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


def touchstone(path, factor):
    lines = ["! by hand", "# MHz S RI R 50"]
    for k in range(4):
        lines.append(f"{500 + 100 * k} 0.1 0 {factor * k} {factor} 0.2 0.3 0 0")
    return put("\n".join(lines) + "\n", path)


@needs("flgpr_exchange")
def test_touchstone_one_file_per_pair(tmp_path):
    pytest.importorskip("skrf")
    files = [touchstone(tmp_path / "a.s2p", 1.0), touchstone(tmp_path / "b.s2p", 2.0)]
    run = import_mapped(put(TOUCHSTONE, tmp_path / "m.toml"), files).run
    np.testing.assert_allclose(run["frequency"].values, 1e6 * (500 + 100 * np.arange(4)))
    np.testing.assert_allclose(run["signal"].values[0, 0, 1], 2 * np.arange(4) + 2j)


@needs("flgpr_exchange")
def test_touchstone_of_many_ports(tmp_path):
    pytest.importorskip("skrf")
    s = np.arange(9).reshape(3, 3) + 0.5
    rows = [
        f"500 {' '.join(f'{v} 0' for v in s[0])}",
        *(" ".join(f"{v} 0" for v in r) for r in s[1:]),
    ]
    opened = open_arrays(put("# MHz S RI R 50\n" + "\n".join(rows) + "\n", tmp_path / "a.s3p"))
    assert opened.read("s32")[0] == s[2, 1]
    assert opened.read("s").shape == (1, 3, 3)
    with pytest.raises(ValueError, match=r"bad\.s2p"):
        open_arrays(put("# MHz S RI R 50\n500 1 2 banana\n", tmp_path / "bad.s2p"))
