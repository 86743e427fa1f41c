"""The phase of a path, also of a long one."""

import numpy as np
import pytest

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.phase import lengthen, path_phase

TONES = np.array([0.5e9, 1.0e9, 3.0e9])


def test_a_wavelength_is_one_turn():
    path = SPEED_OF_LIGHT / TONES[0]
    np.testing.assert_allclose(path_phase(TONES, path), [1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(path_phase(TONES[:1], path / 4), [-1j], atol=1e-12)


def test_long_paths_keep_their_phase():
    path = 1e7 * SPEED_OF_LIGHT / TONES[0]
    assert path_phase(TONES[:1], path)[0] == pytest.approx(1.0, abs=1e-6)


def test_a_lengthened_signal_is_that_of_the_longer_path():
    near = path_phase(TONES, np.array([3.0, 4.0])).astype(np.complex64)
    far = lengthen(near, TONES, np.array([0.7, -1.0]))
    assert far.dtype == np.complex64
    np.testing.assert_allclose(far, path_phase(TONES, np.array([3.7, 3.0])), atol=1e-5)
