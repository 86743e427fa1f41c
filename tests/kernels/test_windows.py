"""The ramp of filtered backprojection, against the transform it comes from."""

import numpy as np

from flgpr.kernels.windows import ramp


def test_ramp_is_proportional_to_frequency():
    frequency = np.array([0.3e9, 0.6e9, 1.9e9])
    assert np.allclose(ramp(frequency), frequency / 1.9e9)


def test_backprojection_over_all_aspects_with_the_ramp_is_the_plane_transform():
    """A disc of the wavenumber plane has the Airy pattern 2 J1(KR)/(KR); without the ramp the sum gives another."""
    from scipy.special import j1

    k = (np.arange(400) + 0.5) / 400 * 20.0
    angle = np.arange(256) / 256 * 2 * np.pi
    for distance in (0.05, 0.2, 0.35):
        phase = np.exp(1j * np.outer(k, distance * np.cos(angle)))
        weighed = (ramp(k) @ phase).sum() / (ramp(k).sum() * angle.size)
        plain = phase.mean()
        airy = 2 * j1(20 * distance) / (20 * distance)
        assert abs(weighed - airy) < 1e-3
        assert abs(plain - airy) > 0.02
