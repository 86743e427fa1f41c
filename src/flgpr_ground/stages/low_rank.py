"""Data freed from a subspace of low rank that stands still on the vehicle."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from flgpr.engine import PlannedPass
from flgpr.model.bounds import AtLeastOne
from flgpr.stages import Table
from flgpr.stages.standing import StandingField, StandingSettings, standing_pass
from flgpr.types import AnyArray, Complex128Array, ComplexArray

_MOST = 30  # iterations
_MISFIT = 1e-5  # of the matrix's norm, at which the iterations end
_NOTHING = 1e-6  # of the largest singular value: what is smaller is no direction of clutter


class LowRankSettings(StandingSettings):
    """The subspace has at most ``rank`` dimensions.

    It is learnt from at most ``most`` scans, spread evenly over the run.
    """

    rank: AtLeastOne = 2


class LowRank(StandingField):
    """Subtracts from every scan its projection on the clutter's subspace.

    Every polarization and pair has a subspace of its own. The data (scan, frequency) are split into
    a part of low rank and a sparse one by principal component pursuit with λ = 1/√max(n, m)
    (Candès, Li, Ma & Wright, "Robust principal component analysis?", Journal of the ACM 58(3),
    2011, Eq. 1.1) by the inexact augmented Lagrangian (Lin, Chen & Ma, arXiv:1009.5055, 2010). The
    first right singular vectors of the former span the subspace; gains may drift, of each pair and
    each vector on their own.
    """

    Settings: ClassVar[type[Table]] = LowRankSettings

    def passes(self) -> list[PlannedPass]:
        """Return the pass that finds the subspaces."""
        scans = len(self.setup.imager)
        return [
            standing_pass("low-rank", scans, self.settings.most, self._data_before, self._subspaces)
        ]

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without their projection on the subspace."""
        basis = self.setup.results["low-rank"]["field"]
        gain = np.einsum("pkf,pkrf->pkr", data, basis.conj())
        return np.asarray(data - np.einsum("pkr,pkrf->pkf", gain, basis), dtype=np.complex64)

    def _subspaces(self, signal: ComplexArray) -> ComplexArray:
        """Return orthonormal vectors (polarization, pair, rank, frequency).

        They are zero where the clutter has fewer dimensions.
        """
        rank = self.settings.rank
        scans, *pairs, tones = signal.shape
        if not rank < min(scans, tones):
            raise ValueError(
                f"low-rank.rank must be less than scans and tones, {scans} and {tones}, got {rank}"
            )
        basis = np.zeros((*pairs, rank, tones), np.complex64)
        for p, k in np.ndindex(*pairs):
            _, size, vectors = np.linalg.svd(low_rank_part(signal[:, p, k]), full_matrices=False)
            count = int((size[:rank] > _NOTHING * size[0]).sum())
            basis[p, k, :count] = vectors[:count]
        return basis


def low_rank_part(matrix: AnyArray) -> Complex128Array:
    """Return the part of low rank of a matrix.

    Parameters
    ----------
    matrix : (n, m) ndarray
        Quickest for n ≤ m: only matrices (n, n) are decomposed.

    Returns
    -------
    (n, m) ndarray of complex
        The solution of principal component pursuit, see :class:`LowRank`.
    """
    data = matrix.astype(np.complex128)
    low = np.zeros_like(data)
    size = np.linalg.norm(data)
    weight = 1 / np.sqrt(max(data.shape))
    if not size:
        return low
    largest = np.linalg.norm(data, 2)
    sparse = low
    dual = data / max(largest, np.abs(data).max() / weight)
    slope = 1.25 / largest
    for _ in range(_MOST):
        target = data - sparse + dual / slope
        # Singular values and right vectors by the smaller matrix target·target^H.
        power, vectors = np.linalg.eigh(target @ target.conj().T)
        singular_values = np.sqrt(np.maximum(power, 0))
        low = (vectors * _shrinkage(singular_values, 1 / slope)) @ (vectors.conj().T @ target)
        target = data - low + dual / slope
        sparse = target * _shrinkage(np.abs(target), weight / slope)
        rest = data - low - sparse
        dual = dual + slope * rest
        slope = 1.5 * slope
        if np.linalg.norm(rest) <= _MISFIT * size:
            break
    return low


def _shrinkage(size: Any, threshold: Any) -> Any:
    """Return which share of values of these sizes is left when a threshold is taken off them."""
    return 1 - threshold / np.maximum(size, threshold)
