"""From a stored run to a focused picture and its files."""

import json

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.picture import make_picture
from flgpr.imaging import View, aperture_blocks, aperture_image
from flgpr.model import SPEED_OF_LIGHT, make_run, vehicle_to_lane
from flgpr.model.phase import path_phase
from flgpr.store import open_run, sample_lane, save_run

TONES = 0.6e9 + 20e6 * np.arange(61)
TARGET = np.array([0.3, 4.0, 0.0])


def drive(path_of, scans=20, height=1.0, step=0.1):
    """Make a run along +y of an antenna pair that hears one echo with the path that a function gives."""
    pose = np.zeros((scans, 6))
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = height
    pose[:, 3] = 0.1
    tx = np.array([[-0.1, 0.0, 0.0]])
    rx = np.array([[0.1, 0.0, 0.0]])
    signal = [
        path_phase(TONES, path_of(vehicle_to_lane(tx, p), vehicle_to_lane(rx, p))) for p in pose
    ]
    return make_run(
        np.array(signal)[:, None], TONES, ["HH"], tx, rx, pose, attrs={"title": "drive"}
    )


def to(point, slow=1.0):
    return lambda tx, rx: (
        slow * (np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1))
    )


@pytest.fixture
def stored(tmp_path):
    return save_run(drive(to(TARGET)), tmp_path / "drive.zarr")


def test_the_aperture_image_is_the_sum_term_by_term():
    run = drive(to(TARGET), scans=5)
    points = np.array([[0.3, 4.0, 0.0], [0.1, 3.5, 0.0], [0.5, 4.2, -0.1], [0.0, 0.5, 0.0]])
    weights = np.array([1.0, 0.5, 2.0, 1.0, 1.0])
    reach = 3.8
    wanted = np.zeros(len(points), complex)
    for scan in (0, 1, 3, 4):
        pose = run["pose"].values[scan]
        tx, rx = (
            vehicle_to_lane(run[name].values, pose)[0] for name in ("tx_position", "rx_position")
        )
        for k, point in enumerate(points):
            path = np.linalg.norm(point - tx) + np.linalg.norm(point - rx)
            away = np.hypot(*(point - tx)[:2]) / reach
            seen = np.cos(np.pi / 2 * away) ** 2 if away < 1 else 0.0
            turn = np.exp(2j * np.pi * TONES * path / SPEED_OF_LIGHT)
            wanted[k] += seen * weights[scan] * (run["signal"].values[scan, 0, 0] * turn).sum()
    made = aperture_image(
        run, points, [np.array([0, 1]), np.array([3, 4])], weights, reach, tolerance=1e-4
    )
    np.testing.assert_allclose(made[0], wanted, atol=1e-3 * np.abs(wanted).max())
    assert [len(one) for one in aperture_blocks(run, np.arange(5))] == [5]


def test_a_reflector_is_the_brightest_point_and_sharper_over_the_aperture(stored):
    view = View(x=(-1.5, 1.5), y=(2.0, 6.0), z=0.0)
    whole = make_picture(stored, view)
    one = make_picture(stored, View(x=(-1.5, 1.5), y=(2.0, 6.0), z=0.0, scans=(3, 3)))
    assert (whole.scans, one.scans) == (20, 1)
    first = whole.peaks.iloc[0]
    assert np.hypot(first["x"] - TARGET[0], first["y"] - TARGET[1]) < 2 * whole.spacing
    assert first["level"] == 0
    assert first["over_median"] > 15
    assert first["width_x"] < 1.6
    assert not one.peaks.iloc[0]["width_x"] < 1.6  # one scan of one pair sees no angle


def test_ground_ahead_is_chosen_where_nothing_is_told(stored):
    made = make_picture(stored)
    assert made.image.sizes["z"] == 1
    assert made.image["y"].values[0] < 2 < TARGET[1] < made.image["y"].values[-1]


def test_antennas_on_the_ground_give_a_section_focused_by_the_ground_s_speed(tmp_path):
    buried = np.array([0.0, 1.0, -0.6])
    slow = 3.0
    line = save_run(
        drive(to(buried, slow), scans=41, height=0.0, step=0.05), tmp_path / "line.zarr"
    )
    made = make_picture(line, View(permittivity=slow**2))
    assert (made.image.sizes["x"], made.image.sizes["z"] > 1, made.image.sizes["y"] > 1) == (
        1,
        True,
        True,
    )
    first = made.peaks.iloc[0]
    assert abs(first["y"] - 1.0) < 0.03
    assert abs(first["z"] + 0.6) < 0.03
    wrong = make_picture(line, View(y=(0, 2), x=0.0, z=(-3.0, 0.0), permittivity=1.0))
    assert wrong.peaks.iloc[0]["over_median"] < first["over_median"]


def test_every_kind_of_file_is_written_and_holds_the_image(stored, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    anchor = tmp_path / "anchor.toml"
    anchor.write_text(
        'crs = "EPSG:32633"\naccuracy = 0.02\n'
        "[[point]]\nlane = [0.0, 0.0]\neasting = 500010.0\nnorthing = 5400000.0\nheight = 312.4\n"
        "[[point]]\nlane = [0.0, 50.0]\neasting = 500035.0\nnorthing = 5400043.28\nheight = 312.4\n"
    )
    files = [tmp_path / f"out.{ending}" for ending in ("png", "npz", "zarr", "tif")]
    made = make_picture(stored, View(x=(-1, 1), y=(3, 5), z=0.0), files, anchor)
    assert files[0].read_bytes().startswith(b"\x89PNG")
    with np.load(files[1]) as held:
        np.testing.assert_array_equal(held["image"], made.image.values)
        np.testing.assert_array_equal(held["x"], made.image["x"].values)
    np.testing.assert_array_equal(xr.open_zarr(files[2])["HH"].values, made.image.values[0])
    with rasterio.open(files[3]) as held:
        np.testing.assert_allclose(held.read(1)[::-1], np.abs(made.image.values[0, 0]), rtol=1e-6)
        assert held.tags()["flgpr_quantity"].startswith("magnitude of the focused image")
    assert not list(tmp_path.glob(".partial*"))


@pytest.mark.parametrize(
    ("view", "output", "rule"),
    [
        (View(x=(0, 1)), "a.png", "y must be given beside the others"),
        (View(x=(0, 1), y=3.0), "a.png", "two of x, y and z must have two limits"),
        (View(x=(1, 0), y=(0, 1)), "a.png", "x must have limits that increase, got 1, 0"),
        (
            View(x=(0, 1), y=(0, 1), spacing=1e-6),
            "a.png",
            "spacing must give 2 pixels or more",
        ),
        (
            View(x=(0, 1), y=(0, 1), spacing=float("nan")),
            "a.png",
            "spacing must be positive, got nan",
        ),
        (
            View(scans=(5, 90)),
            "a.png",
            "scans must have 0 <= first <= last < 20, the run's, got 5, 90",
        ),
        (
            View(polarizations=("VV",)),
            "a.png",
            "polarization must be one of the run's, HH, got VV",
        ),
        (View(window="kaiser"), "a.png", "window must be one of"),
        (View(), "a.pdf", r"output must end in .png, .npz, .zarr, .tif, got 'a.pdf'"),
        (View(), "a.tif", "a GeoTIFF needs an anchor"),
    ],
)
def test_what_does_not_fit_is_told_and_nothing_is_written(stored, tmp_path, view, output, rule):
    with pytest.raises(ValueError, match=rule):
        make_picture(stored, view, [tmp_path / output])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drive.zarr"]


def test_commands_prepare_and_image_go_together(tmp_path):
    """The packaged lane's standing part is prepared away, and the post is what is left brightest."""
    source = sample_lane() / "run.zarr"
    ready = tmp_path / "ready.zarr"
    picture = tmp_path / "ready.png"
    run = CliRunner().invoke
    done = run(
        app, ["prepare", str(source), "-o", str(ready), "--background", "--band", "0.5", "1.4"]
    )
    assert done.exit_code == 0, done.output
    assert open_run(ready).attrs["history"] == [
        {"do": "background"}, {"do": "band", "low_ghz": 0.5, "high_ghz": 1.4, "taper": 0.1},
    ]  # fmt: skip
    done = run(app, ["image", str(ready), "-o", str(picture), "--polarization", "HH", "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["scans"] == 3
    assert np.hypot(told["peaks"][0]["x"] + 1.2, told["peaks"][0]["y"] - 4.0) < 0.15
    done = run(app, ["image", str(ready), "-o", str(picture)])
    assert done.exit_code == 2
    assert "must not exist yet" in done.output
