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
