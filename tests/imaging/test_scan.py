import numpy as np
import pytest

from flgpr.imaging import ScanImager
from flgpr.model import Grid, make_run, vehicle_to_lane

FREQUENCY = 0.45e9 + 15e6 * np.arange(70)
TX = np.repeat([[-0.9, 0, 0], [0.9, 0, 0]], 8, axis=0)
RX = np.tile(np.column_stack([np.linspace(-1.1, 1.1, 8), np.zeros(8), np.full(8, -0.03)]), (2, 1))
TARGET = np.array([0.35, 4.05, 0.0])
POSES = np.array(
    [[0, 0.4, 1.5, 0, 0, 0], [0.1, 0.9, 1.5, 0.08, 0, 0], [0.0, 1.4, 1.6, -0.05, 0.03, -0.02]]
)


def run_of(poses):
    signal = []
    for pose in poses:
        tx = vehicle_to_lane(TX, pose)
        rx = vehicle_to_lane(RX, pose)
        path = np.linalg.norm(tx - TARGET, axis=1) + np.linalg.norm(rx - TARGET, axis=1)
        signal.append(np.exp(-2j * np.pi * FREQUENCY * path[:, None] / 299792458.0)[None])
    return make_run(np.array(signal), FREQUENCY, ["HH"], TX, RX, poses)


GRID = Grid.spanning((-1.0, 1.0), (1.5, 5.0), 0.05)


def test_a_point_focuses_where_it_stands_whatever_the_pose():
    from flgpr.model import scan_to_lane

    imager = ScanImager(
        run_of(POSES), GRID, {"all": (0.45e9, 1.5e9)}, window="hann", tolerance=1e-4
    )
    for image, pose in zip(imager, POSES, strict=True):
        row, column = np.unravel_index(np.abs(image.values[0, 0]).argmax(), GRID.shape)
        place = scan_to_lane([GRID.x[column], GRID.y[row], 0.0], pose)
        assert np.hypot(*(place - TARGET)[:2]) < 0.05
        assert image.attrs["pose"] == pytest.approx(pose.tolist())


def test_scans_with_missing_sweeps_are_left_out_and_counted():
    run = run_of(POSES)
    run["signal"][1, 0, 3, 10] = np.nan
    run["valid"][1, 0, 3] = False
    imager = ScanImager(run, GRID, {"all": (0.45e9, 1.5e9)})
    assert imager.masked_scans.tolist() == [1]
    assert [image.attrs["scan"] for image in imager] == [0, 2]
    run["valid"][:] = False
    with pytest.raises(ValueError, match="without missing sweeps"):
        ScanImager(run, GRID, {"all": (0.45e9, 1.5e9)})


def test_looks_count_scans_whose_image_holds_the_point():
    imager = ScanImager(run_of(POSES), GRID, {"all": (0.45e9, 1.5e9)})
    assert imager.looks([[0.0, 2.0, 0.0], [0.0, 4.0, 0.0], [9.0, 4.0, 0.0]]).tolist() == [1, 3, 0]


def test_an_empty_sub_band_is_refused():
    imager = ScanImager(run_of(POSES), GRID, {"high": (3e9, 4e9)})
    with pytest.raises(ValueError, match="3e\\+09"):
        imager.image(0)
