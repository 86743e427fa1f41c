"""An image over a synthetic aperture is the coherent sum of the images of its scans."""

import numpy as np

from flgpr.imaging import ImagingOperator, aperture_blocks, aperture_image
from flgpr.model import make_run, vehicle_to_lane

FREQUENCY = 1e9 + 10e6 * np.arange(40)
TX = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
RX = np.array([[0.0, 0.1, 0.0], [0.0, 0.1, 0.0]])
POINTS = np.stack(np.meshgrid([-0.5, 0.0, 0.5], [4.0, 5.0], [0.0]), axis=-1)[:, :, 0]


def small_run():
    rng = np.random.default_rng(0)
    shape = (3, 2, 2, 40)
    signal = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    pose = np.zeros((3, 6))
    pose[:, 1] = [0.0, 0.5, 1.0]
    pose[:, 2] = 1.5
    return make_run(signal, FREQUENCY, ["HH", "VV"], TX, RX, pose)


def test_the_image_is_the_weighted_sum_over_scans():
    run = small_run()
    weights = [1.0, 0.5, 2.0]
    got = aperture_image(run, POINTS, aperture_blocks(run, range(3)), weights)
    expected = np.zeros((2, *POINTS.shape[:2]), complex)
    for scan, weight in enumerate(weights):
        pose = run["pose"].values[scan]
        tx = vehicle_to_lane(TX, pose)
        rx = vehicle_to_lane(RX, pose)
        operator = ImagingOperator(FREQUENCY, tx, rx, POINTS, method="direct")
        expected += weight * operator.adjoint(run["signal"].values[scan])[:, 0]
    np.testing.assert_allclose(got, expected, atol=2e-3 * np.abs(expected).max())


def test_pixels_out_of_reach_of_all_antennas_stay_zero():
    run = small_run()
    got = aperture_image(run, POINTS, aperture_blocks(run, range(3)), reach=3.5)
    assert (got[:, 1] == 0).all()  # 4 m from the last scan and farther
    assert np.abs(got[:, 0]).min() > 0
