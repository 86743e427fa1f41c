"""Focused range profiles against their sums, term by term."""

import numpy as np

from flgpr.kernels.focus import focus


def test_beams_are_the_sums_over_pairs_and_tones():
    rng = np.random.default_rng(1)
    shape = (2, 3, 8)
    signal = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    wavenumber = np.linspace(1.0, 5.0, 8)
    path = rng.uniform(5, 15, (4, 3))
    kernel = rng.normal(size=(8, 6)) + 1j * rng.normal(size=(8, 6))
    parts = np.stack([kernel.real, kernel.imag]).astype(np.float32)
    out = np.empty((4, 2, 6), np.float32)
    focus(signal, wavenumber, path, parts, out)
    phase = np.exp(2j * np.pi * path[..., None] * wavenumber)
    beam = np.einsum("cqk,nqk->nck", signal, phase)
    np.testing.assert_allclose(out, np.abs(beam @ kernel) / 3, rtol=1e-4)
