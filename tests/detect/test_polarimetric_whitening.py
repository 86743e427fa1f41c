"""The polarimetric whitening filter and the magnitude of one channel."""

import numpy as np
import pytest

from flgpr.detect import PolarimetricWhiteningFilter, magnitude_form
from reference.cosgrove2004 import circular


@pytest.fixture
def clutter():
    covariance = np.array([[2, 0.9 + 0.4j, 0.1], [0.9 - 0.4j, 1.5, 0], [0.1, 0, 0.2]])
    return circular(np.random.default_rng(3), np.zeros(3), covariance, 20_000)


@pytest.mark.parametrize("polarizations", [1, 2, 3])
def test_score_is_the_energy_of_whitened_channels(clutter, polarizations):
    X = clutter[:, :polarizations]
    found = PolarimetricWhiteningFilter().fit(X)
    sigma = X.T @ X.conj() / len(X)
    assert np.allclose(found.covariance_, sigma)
    assert np.allclose(
        found.decision_function(X[:50]),
        [(x.conj() @ np.linalg.inv(sigma) @ x).real for x in X[:50]],
    )
    # The trace identity makes the mean exact; the energy of a CN(0, I) vector is gamma distributed.
    score = found.decision_function(X)
    assert score.mean() == pytest.approx(polarizations)
    assert score.var() == pytest.approx(polarizations, rel=0.1)


def test_scale_and_mixing_of_channels_do_not_matter(clutter):
    mix = np.array([[1, 0.3, 0], [0.2j, 5, 0], [0, 0, 40]])
    plain = PolarimetricWhiteningFilter().fit(clutter).decision_function(clutter[:20])
    mixed = clutter @ mix.T
    assert np.allclose(
        PolarimetricWhiteningFilter().fit(mixed).decision_function(mixed[:20]), plain
    )


def test_dependent_channels_are_refused(clutter):
    with pytest.raises(ValueError, match="span all 2 features"):
        PolarimetricWhiteningFilter().fit(np.stack([clutter[:, 0], 2 * clutter[:, 0]], axis=1))


def test_magnitude_takes_one_channel(clutter):
    assert np.allclose(magnitude_form(3, 1)(clutter), np.abs(clutter[:, 1]) ** 2)
    with pytest.raises(ValueError, match="channel"):
        magnitude_form(2, 2)
