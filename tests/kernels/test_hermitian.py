"""Eigenvalues and eigenvectors of 3 x 3 Hermitian matrices against LAPACK."""

import numpy as np

from flgpr.kernels.hermitian import eigen_3x3


def decompose(matrices):
    values = np.empty((len(matrices), 3))
    vectors = np.empty((len(matrices), 3, 3), complex)
    eigen_3x3(np.ascontiguousarray(matrices, dtype=complex), values, vectors)
    return values, vectors


def test_random_matrices_are_those_of_lapack():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(50, 3, 3)) + 1j * rng.normal(size=(50, 3, 3))
    matrices = root @ root.conj().swapaxes(1, 2)
    values, vectors = decompose(matrices)
    np.testing.assert_allclose(np.sort(values, axis=1), np.linalg.eigvalsh(matrices), rtol=1e-10)
    np.testing.assert_allclose(matrices @ vectors, vectors * values[:, None], atol=1e-12 * 50)
    unit = vectors.conj().swapaxes(1, 2) @ vectors
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-14)


def test_equal_eigenvalues_of_a_diagonal_matrix_keep_the_axes():
    values, vectors = decompose([np.eye(3), np.diag([2.0, 2.0, 0.0])])
    np.testing.assert_array_equal(vectors, np.broadcast_to(np.eye(3), (2, 3, 3)))
    np.testing.assert_array_equal(values, [[1, 1, 1], [2, 2, 0]])
