"""The likelihood ratio of chips in textured clutter: its closed form, and clutter of a lane's own."""

import numpy as np

from flgpr.stages.textured_clutter import WhitenedGround, ratio


def noise(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def test_the_ratio_is_that_of_two_compound_gaussian_densities():
    rng = np.random.default_rng(1)
    x = noise(rng, 5, 12)
    size = 12
    vectors = np.linalg.qr(noise(rng, size, 3))[0].T
    share = np.array([0.6, 0.3, 0.1])
    ratios = (2.0, 50.0)
    subspace = np.einsum("k,ki,kj->ij", share, vectors, vectors.conj())

    def density(
        y, covariance
    ):  # the likeliest texture put in; constants alike on both sides are left out
        quadratic = np.einsum("ni,ij,nj->n", y.conj(), np.linalg.inv(covariance), y).real
        return -np.linalg.slogdet(covariance)[1] - size * np.log(quadratic)

    both = [
        density(x, np.eye(size) + power * subspace) - density(x, np.eye(size)) for power in ratios
    ]
    np.testing.assert_allclose(
        ratio(x, vectors.conj(), share, ratios), np.log(np.mean(np.exp(both), axis=0))
    )
    np.testing.assert_allclose(
        ratio(30 * x, vectors.conj(), share, ratios), ratio(x, vectors.conj(), share, ratios)
    )


def test_a_lane_that_shows_no_clutter_leaves_the_ground_as_it_is():
    ground = WhitenedGround(np.eye(4, dtype=np.complex64), {})
    assert ground.with_clutter(np.zeros((4, 4), complex), 0.5, 1e-3) is ground
    other = ground.with_clutter(np.diag([4.0, 2.0, 1.0, 1.0]).astype(complex), 0.5, 0.0)
    back = np.linalg.inv(other.whitener.astype(complex))
    # Half of what was learnt, half of the lane's, which is of unit mean power.
    np.testing.assert_allclose(back @ back.conj().T, np.diag([1.5, 1.0, 0.75, 0.75]), atol=1e-6)
