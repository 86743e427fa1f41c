"""The direct sums in double precision: the adjoint term by term, and its transpose."""

import numpy as np

from flgpr.kernels.direct import adjoint_direct, forward_direct

RNG = np.random.default_rng(3)
WEIGHT = RNG.random((2, 7))
WAVENUMBER = np.linspace(1.0, 4.0, 7)
PATH = RNG.uniform(3, 9, (4, 5))  # two transmitters, two receivers
TX = np.array([0, 0, 1])
RX = np.array([2, 3, 3])
OFFSET = np.array([0.0, 0.3, -0.2])
GAIN = RNG.random((4, 5))
ARGUMENTS = (WEIGHT, WAVENUMBER, PATH, TX, RX, OFFSET, GAIN)


def test_the_adjoint_is_the_weighted_sum_of_all_terms():
    data = RNG.normal(size=(2, 3, 7)) + 1j * RNG.normal(size=(2, 3, 7))
    out = np.empty((2, 2, 5), complex)
    adjoint_direct(data, *ARGUMENTS, out)
    length = PATH[TX] + PATH[RX] - OFFSET[:, None]
    carrier = np.exp(2j * np.pi * length[..., None] * WAVENUMBER)
    gain = GAIN[TX] * GAIN[RX]
    expected = np.einsum("sk,qp,cqk,qpk->csp", WEIGHT, gain, data, carrier)
    np.testing.assert_allclose(out, expected, atol=1e-12)


def test_the_forward_sum_is_its_transpose():
    data = RNG.normal(size=(1, 3, 7)) + 1j * RNG.normal(size=(1, 3, 7))
    image = RNG.normal(size=(1, 2, 5)) + 1j * RNG.normal(size=(1, 2, 5))
    imaged = np.empty((1, 2, 5), complex)
    modelled = np.empty((1, 3, 7), complex)
    adjoint_direct(data, *ARGUMENTS, imaged)
    forward_direct(image, *ARGUMENTS, modelled)
    np.testing.assert_allclose(np.vdot(data, modelled), np.vdot(imaged, image), rtol=1e-12)
