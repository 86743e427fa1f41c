"""A run as one aperture: its antennas, its weights, and its pose."""

import numpy as np
import pytest

from flgpr.model import aperture_run, make_run, vehicle_to_lane, way_weights
from flgpr.model.aperture import aperture_pose, synthetic_aperture

TX = np.array([[-0.5, 0.1, 0.0], [0.5, 0.1, 0.0]])
RX = np.array([[-0.3, 0.0, 0.2], [0.3, 0.0, 0.2]])


def run_at(pose):
    rng = np.random.default_rng(0)
    shape = (len(pose), 1, 2, 4)
    signal = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return make_run(signal, 1e9 + 1e7 * np.arange(4), ["VV"], TX, RX, pose, np.arange(len(pose)))


def poses(y, heading=0.1):
    pose = np.zeros((len(y), 6))
    pose[:, 1] = y
    pose[:, 2] = 1.5
    pose[:, 3] = heading
    return pose


def test_a_scan_counts_by_its_share_of_the_track():
    weights = way_weights(poses([0.0, 0.0, 1.0, 3.0])[:, :3])
    np.testing.assert_allclose(weights / weights[3], [0.0, 0.5, 1.5, 1.0])
    assert weights.mean() == pytest.approx(1.0)


def raster(rows, columns, step=0.02):
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    return step * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


ORDERS = {
    "row by row": lambda places: places,
    "zigzag": lambda places: np.concatenate(
        [row[:: 1 - 2 * (k % 2)] for k, row in enumerate(places.reshape(7, 20, 3))]
    ),
    "shuffled": lambda places: np.random.default_rng(0).permutation(places),
    "twice, shuffled": lambda places: np.random.default_rng(0).permutation(np.tile(places, (2, 1))),
    "twice each": lambda places: np.repeat(places, 2, axis=0),
}


@pytest.mark.parametrize("order", ORDERS)
def test_places_of_an_even_raster_count_alike_in_any_order(order):
    places = ORDERS[order](raster(7, 20))
    weights = way_weights(places)
    unique, which = np.unique(np.round(places, 6), axis=0, return_inverse=True)
    of_place = np.bincount(which.ravel(), weights)
    inner = np.sort(of_place)[2 : len(unique)]  # the first and the last scan count half
    np.testing.assert_allclose(inner, np.median(of_place), rtol=1e-9)


def test_a_gap_in_a_line_is_nothing_that_its_edges_stand_for():
    y = np.concatenate([np.arange(0, 1, 0.05), np.arange(4, 5, 0.05)])
    weights = way_weights(poses(y)[:, :3])
    np.testing.assert_allclose(weights[1:-1], weights[1], rtol=1e-9)


def test_a_vehicle_that_waits_and_goes_faster_counts_by_its_way():
    """Steps of 1, 2 and 3 cm are no jumps, however long it waits with a receiver that wanders."""
    wander = 1e-3 * np.sin(np.arange(300))
    y = np.concatenate([np.cumsum([0.02] * 50), 1 + wander, 1 + np.cumsum([0.03] * 50)])
    weights = way_weights(poses(y)[:, :3])
    assert weights[10] > 15 * np.median(weights[60:340])
    np.testing.assert_allclose(weights[360:390] / weights[10], 1.5, rtol=1e-6)


def test_rasters_as_one_aperture_count_their_places_alike():
    pose = np.zeros((140, 6))
    pose[:, :3] = raster(7, 20)
    run = run_at(pose)
    field, _, _ = synthetic_aperture(run)
    weight = np.abs(field[0, ::2, 0] / run["signal"].values[:, 0, 0, 0])
    np.testing.assert_allclose(weight[1:-1], weight[1], rtol=1e-5)


def test_the_aperture_holds_all_antennas_in_the_lane_and_the_weighted_field():
    pose = poses([0.0, 1.0, 3.0])
    run = run_at(pose)
    field, tx, rx = synthetic_aperture(run)
    np.testing.assert_allclose(tx.reshape(3, 2, 3)[1], vehicle_to_lane(TX, pose[1]))
    np.testing.assert_allclose(rx.reshape(3, 2, 3)[2], vehicle_to_lane(RX, pose[2]))
    weight = way_weights(pose[:, :3])
    expected = run["signal"].values[2, :, 1] * weight[2]
    np.testing.assert_allclose(field[:, 5], expected, rtol=1e-6)


def test_as_a_single_scan_it_has_the_mean_pose_and_the_same_antennas_in_the_lane():
    run = run_at(poses([0.0, 1.0, 2.0]))
    single = aperture_run(run)
    pose = single["pose"].values[0]
    np.testing.assert_allclose(pose, [0, 1, 1.5, 0.1, 0, 0], atol=1e-12)
    _, tx, _ = synthetic_aperture(run)
    np.testing.assert_allclose(vehicle_to_lane(single["tx_position"].values, pose), tx, atol=1e-12)


def test_a_run_there_and_back_is_no_aperture():
    pose = poses([0.0, 1.0, 2.0, 3.0], heading=np.array([0.0, 0.0, 3.1, 3.1]))
    with pytest.raises(ValueError, match="run must head one way"):
        aperture_pose(run_at(pose))
