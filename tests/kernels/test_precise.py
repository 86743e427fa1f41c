"""Sums from range profiles in double precision: every bin by its weight, and the transpose."""

import numpy as np

from flgpr.kernels.precise import PreciseGeometry, adjoint_precise, forward_precise

RNG = np.random.default_rng(5)
PATH = RNG.uniform(3, 9, (4, 6))  # two transmitters, two receivers
TX = np.array([0, 0, 1])
RX = np.array([2, 3, 3])
GAIN = RNG.random((4, 6))
TAPS = 4
PER_TURN = 1 / 7.3  # the ambiguous range is 7.3 m of path, so that paths wrap
SIZE = 32
START = 5.0
GEOMETRY = PreciseGeometry(
    tx=TX,
    rx=RX,
    path=PATH,
    gain=GAIN,
    per_turn=PER_TURN,
    carrier=3.7,
    size=SIZE,
    start=START,
    weight=RNG.normal(size=(TAPS, 3)),
)


def operator():
    """Return the matrix (pixel, pair, bin) that takes profiles to pixels, written from its definition."""
    matrix = np.zeros((PATH.shape[1], TX.size, SIZE + TAPS), complex)
    for pair, (i, j) in enumerate(zip(TX, RX, strict=True)):
        length = PATH[i] + PATH[j]
        position = (length * PER_TURN * SIZE - START) % SIZE
        first = position.astype(int)
        fraction = position - first - 0.5
        phasor = GAIN[i] * GAIN[j] * np.exp(2j * np.pi * length * GEOMETRY.carrier)
        for tap, polynomial in enumerate(GEOMETRY.weight):
            weight = np.polyval(polynomial[::-1], fraction)
            matrix[np.arange(first.size), pair, first + tap] += weight * phasor
    return matrix


def test_the_adjoint_weights_the_bins_around_each_path():
    table = RNG.normal(size=(3, SIZE + TAPS, 2)) + 1j * RNG.normal(size=(3, SIZE + TAPS, 2))
    out = np.empty((2, 6), complex)
    adjoint_precise(table, GEOMETRY, out)
    np.testing.assert_allclose(out, np.einsum("pqb,qbc->cp", operator(), table), atol=1e-12)


def test_the_forward_sum_is_its_transpose():
    image = RNG.normal(size=(2, 6)) + 1j * RNG.normal(size=(2, 6))
    table = np.empty((3, SIZE + TAPS, 2), complex)
    forward_precise(image, GEOMETRY, table)
    expected = np.einsum("pqb,cp->qbc", operator().conj(), image)
    np.testing.assert_allclose(table, expected, atol=1e-12)
