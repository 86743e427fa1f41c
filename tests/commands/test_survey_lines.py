"""Channels, marks, topography and many lines into one run, and depth slices of it: by command, against the places."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.formats import gpr_run, place_by_marks, read_gpr
from flgpr.model import SPEED_OF_LIGHT
from flgpr.store import open_run
from io_gpr import SPEED, STEP, WINDOW, gga, section, write_dt1, write_dzt
from io_survey import BODIES, write_lines

PERMITTIVITY = (SPEED_OF_LIGHT / SPEED) ** 2
NORTH = 1 / 111_236.0  # degrees per metre


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def good(*words):
    done = run(*words)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow("many commands")
@pytest.mark.parametrize("zigzag", [False, True])
def test_lines_become_one_survey_whose_slices_show_the_bodies(zigzag, tmp_path):
    paths = write_lines(tmp_path, zigzag=zigzag)
    more = ["--zigzag"] if zigzag else []
    told = good("import", "gpr", *paths, "-o", tmp_path / "s.zarr", "--line-spacing", 0.25, *more)
    assert "note: 8 lines are put 0.25 m apart along x as given" in told
    held = open_run(tmp_path / "s.zarr")
    assert held.attrs["line_starts"] == [44 * k for k in range(8)]
    np.testing.assert_allclose(held["pose"].values[::44, 0], 0.25 * np.arange(8))
    if zigzag:
        np.testing.assert_allclose(held["pose"].values[44, 1:4], [43 * STEP, 0, np.pi])
    words = [
        "image",
        tmp_path / "s.zarr",
        "--permittivity",
        PERMITTIVITY,
        "--x",
        0,
        1.75,
        "--y",
        0,
        2.15,
    ]
    words += ["--spacing", 0.05, "--depth", 0.4, "--depth", 0.7]
    good(*words, "-o", tmp_path / "s.png", "-o", tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as archive:
        level = np.abs(archive["image"][0])
        x, y, z = archive["x"], archive["y"], archive["z"]
    np.testing.assert_allclose(z, [-0.4, -0.7])
    for picture, (bx, by, _) in zip(level, BODIES, strict=True):
        row, column = np.unravel_index(picture.argmax(), picture.shape)
        assert (x[column], y[row]) == pytest.approx((bx, by), abs=0.11)
    assert imread(tmp_path / "s.png").std() > 0.05


def test_lines_lie_where_a_table_says_and_keep_their_own_distances(tmp_path):
    paths = write_lines(tmp_path, lines=2)
    table = tmp_path / "lines.csv"
    table.write_text(
        # the second is 3 m
        "line,x_start_m,y_start_m,x_end_m,y_end_m\nline1.dt1,5,5,5,2.85\nline0.dt1,1,0,4,0\n"
    )
    told = good("import", "gpr", *paths, "-o", tmp_path / "s.zarr", "--lines", table)
    assert "line0.dt1: its ends lie 3 m apart, its own distance is 2.15 m, which is kept" in told
    pose = open_run(tmp_path / "s.zarr")["pose"].values
    np.testing.assert_allclose(
        pose[[0, 43]], [[1, 0, 0, np.pi / 2, 0, 0], [3.15, 0, 0, np.pi / 2, 0, 0]], atol=1e-6
    )
    np.testing.assert_allclose(pose[[44, 87], :2], [[5, 5], [5, 2.85]], atol=1e-6)


def test_lines_by_their_own_fixes_need_no_layout(tmp_path):
    paths = write_lines(tmp_path, lines=2, traces=20)
    for k, path in enumerate(paths):
        lines = []
        for trace in (0, 19):
            lat = 50 + STEP * trace * NORTH
            lon = 8 + k * 0.25 / 71_700.0
            lines += [f"Trace #{trace + 1} at position {STEP * trace}", gga(lat, lon, 100.0)]
        path.with_suffix(".gps").write_text("\n".join(lines))
    good("import", "gpr", *paths, "-o", tmp_path / "s.zarr", "--anchor-from-track")
    pose = open_run(tmp_path / "s.zarr")["pose"].values
    np.testing.assert_allclose(pose[:20, 0], 0, atol=5e-3)
    np.testing.assert_allclose(pose[20:, 0], 0.25, atol=5e-3)
    np.testing.assert_allclose(pose[:20, 1], STEP * np.arange(20), atol=5e-3)


def test_all_channels_become_pairs_of_one_run(tmp_path):
    both = np.stack([section(20), -section(20)], axis=1)
    path = write_dzt(tmp_path / "a.DZT", both, names=("50400", "50400"))
    told = good(
        "import",
        "gpr",
        path,
        "-o",
        tmp_path / "a.zarr",
        "--all-channels",
        "--channel-x",
        -0.3,
        "--channel-x",
        0.3,
    )
    assert "all 2 channels in one run, a pair each" in told
    held = open_run(tmp_path / "a.zarr")
    assert held.sizes["pair"] == 2
    np.testing.assert_allclose(held["tx_position"].values[:, 0], [-0.3, 0.3])


def test_distances_come_from_the_marks(tmp_path):
    line = read_gpr(write_dt1(tmp_path / "a.dt1", section(40)))
    line = replace(line, marks=(4, 14, 34))
    marked = place_by_marks(line, 2.0)
    assert marked.distance[[4, 14, 34]] - marked.distance[4] == pytest.approx([0, 2, 4])
    assert np.diff(marked.distance[:14]) == pytest.approx([0.2] * 13)
    assert np.diff(marked.distance[14:]) == pytest.approx([0.1] * 25)
    assert marked.history[-1] == (
        "distances are from 3 marks every 2 m, in place of those that the file tells; 9 traces before the first and "
        "after the last mark go on at the steps beside them"
    )
    np.testing.assert_allclose(gpr_run(marked)["pose"].values[:, 1], marked.distance)
    with pytest.raises(ValueError, match="distances from marks need two marks or more, got 0"):
        place_by_marks(replace(line, marks=()), 2.0)
    with pytest.raises(ValueError, match="mark-spacing must be a positive distance, got 0 m"):
        place_by_marks(line, 0.0)


@pytest.fixture
def hill(tmp_path):
    """A line over ground that rises by 1 m in 2 m of way."""
    path = write_dt1(tmp_path / "hill.dt1", section(41))
    lines = []
    for trace in (0, 20, 40):
        lines += [
            f"Trace #{trace + 1} at position 0",
            gga(50 + STEP * trace * NORTH, 8.0, 100 + 0.5 * STEP * trace),
        ]
    path.with_suffix(".gps").write_text("\n".join(lines))
    return path


def test_heights_of_the_receiver_are_told_and_used_where_asked(hill, tmp_path):
    told = good("import", "gpr", hill, "-o", tmp_path / "a.zarr", "--anchor-from-track")
    assert "heights of the receiver from 0.00 to 1.00 m in the lane are not used" in told
    assert not open_run(tmp_path / "a.zarr")["pose"].values[:, 2].any()
    told = good(
        "import", "gpr", hill, "-o", tmp_path / "b.zarr", "--anchor-from-track", "--topography"
    )
    assert "antennas are put on the receiver's heights, 0.00 to 1.00 m in the lane" in told
    held = open_run(tmp_path / "b.zarr")
    np.testing.assert_allclose(held["pose"].values[:, 2], 0.5 * STEP * np.arange(41), atol=3e-3)
    told = good(
        "image", tmp_path / "b.zarr", "-o", tmp_path / "b.npz", "--permittivity", 9, "--json"
    )
    assert json.loads(told)["scans"] == 41
    with np.load(tmp_path / "b.npz") as archive:
        assert archive["z"].max() == pytest.approx(
            1.0, abs=0.05
        )  # a section below the line, up to its top
        assert archive["z"].min() < -2


@pytest.mark.parametrize(
    ("more", "rule"),
    [
        ([], "lines of a survey need an anchor, line-spacing or a table of lines"),
        (["--line-spacing", 1, "--anchor-from-track"], "all tell where lines lie: give one"),
        (["--zigzag"], "zigzag goes with line-spacing"),
        (["--line-spacing", 1, "--channel", 1], "channel is of a single line"),
        (["--anchor-from-track"], "an anchor from the track needs two finite fixes or more"),
    ],
)
def test_what_does_not_tell_where_lines_lie_is_refused(more, rule, tmp_path):
    paths = write_lines(tmp_path, lines=2, traces=10)
    done = run("import", "gpr", *paths, "-o", tmp_path / "s.zarr", *more)
    assert done.exit_code == 2
    assert rule in done.output


def test_other_lines_and_depths_are_refused(tmp_path):
    paths = write_lines(tmp_path, lines=1, traces=10)
    half = {"TOTAL_TIME_WINDOW": f"{WINDOW / 2:.6f}"}
    other = write_dt1(tmp_path / "other.dt1", section(10)[:, :200], **half)
    done = run("import", "gpr", *paths, other, "-o", tmp_path / "s.zarr", "--line-spacing", 1)
    assert "lines of a survey must have the same time window and channels" in done.output
    good("import", "gpr", *paths, "-o", tmp_path / "a.zarr")
    words = ("image", tmp_path / "a.zarr", "--permittivity", 9, "-o", tmp_path / "a.png")
    assert "that increase, m, got [0.5, 0.2]" in run(*words, "--depth", 0.5, "--depth", 0.2).output
    assert "depth and z both say how deep" in run(*words, "--depth", 0.5, "--at-z", -1).output
    assert (
        "topography needs an anchor"
        in run("import", "gpr", *paths, "-o", tmp_path / "b.zarr", "--topography").output
    )
