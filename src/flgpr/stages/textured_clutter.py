"""Chips in textured clutter: what whitens them, signatures in it, and their likelihood ratio.

The densities are those of :class:`flgpr.stages.likelihood.LikelihoodMap`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from flgpr.types import AnyArray, Arrays, ComplexArray, FloatArray, IndexArray, IntArray

SHAPES = np.geomspace(0.05, 500.0, 241)
"""Borders between classes of the power that whitening leaves of a chip of unit power."""


class SomeValues(NamedTuple):
    """What some of a chip's values, those of one sub-band, are compared with."""

    values: IndexArray  # their numbers in a chip
    whitener: ComplexArray  # (value, value)
    vectors: ComplexArray  # (vector, value) conjugate and orthonormal
    share: FloatArray  # (vector,) of the mean signature's power


class WhitenedGround(NamedTuple):
    """What chips of one metre ahead are whitened by, and the signatures in whitened clutter."""

    whitener: ComplexArray  # (value, value)
    #: conjugate vectors and their shares of the mean signature's power, by group of bodies
    signatures: dict[str, tuple[ComplexArray, FloatArray]]

    def with_clutter(self, own: AnyArray, share: float, load: float) -> WhitenedGround:
        """Return the ground with a lane's own clutter in it.

        Parameters
        ----------
        own : (value, value) ndarray of complex
            Sum of x x^H over the lane's clutter; without power the ground stays as it is.
        share : float
            Share of the lane's clutter in the covariance.
        load : float
            Share of its mean power that is added to its diagonal.

        Returns
        -------
        WhitenedGround
            The mean signatures are what they were; in other clutter they have other directions.
        """
        power = np.trace(own).real
        if not power > 0:
            return self
        size = len(own)
        own = own * (size / power) + load * np.eye(size)
        back = np.linalg.inv(self.whitener.astype(complex))
        whitener = np.linalg.inv(
            np.linalg.cholesky((1 - share) * back @ back.conj().T + share * own)
        )
        signatures = {}
        for group, (vectors, shares) in self.signatures.items():
            strong = whitener @ back @ (vectors.conj().T * np.sqrt(shares))
            left, strength, _ = np.linalg.svd(strong, full_matrices=False)
            new_shares = strength**2 * (shares.sum() / (strength**2).sum())
            signatures[group] = (_single(left.T.conj()), new_shares)
        return WhitenedGround(_single(whitener), signatures)

    def of_values(self, values: IndexArray, group: str) -> SomeValues:
        """Return what some of a chip's values are compared with.

        Parameters
        ----------
        values : (n,) ndarray
            Their numbers.
        group : str
            The group of bodies.

        Returns
        -------
        SomeValues
            In clutter of these values alone.
        """
        vectors, shares = self.signatures[group]
        back = np.linalg.inv(self.whitener.astype(complex))
        covariance = (back @ back.conj().T)[np.ix_(values, values)]
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        strong = vectors.conj().T * np.sqrt(shares)
        left, strength, _ = np.linalg.svd(white @ (back @ strong)[values], full_matrices=False)
        share = strength**2 / (strength**2).sum()
        return SomeValues(values, _single(white), _single(left.T.conj()), share)


def ratio(
    chips: ComplexArray, vectors: ComplexArray, share: FloatArray, ratios: Sequence[float]
) -> FloatArray:
    """Compute the log-likelihood ratio of whitened chips, averaged over powers.

    Parameters
    ----------
    chips : (..., value) ndarray of complex
        Whitened chips.
    vectors : (vector, value) ndarray of complex
        Conjugate and orthonormal.
    share : (vector,) ndarray
        Shares of the mean signature's power in them.
    ratios : sequence of float
        Powers γ of a signature in whitened clutter.

    Returns
    -------
    (...) ndarray
        The ratio, see :class:`~flgpr.stages.likelihood.LikelihoodMap`.
    """
    power = np.maximum((np.abs(chips) ** 2).sum(axis=-1), np.finfo(np.float32).tiny)
    share_of_chip = np.abs(chips @ vectors.T) ** 2 / power[..., None]
    gain = np.array(ratios)[:, None] * share
    rest = np.maximum(1 - share_of_chip @ (gain / (1 + gain)).T, 1e-6)
    by_power = -chips.shape[-1] * np.log(rest) - np.log1p(gain).sum(axis=1)
    return np.asarray(logsumexp(by_power, axis=-1) - math.log(len(ratios)))


def summed_clutter(lanes: Sequence[Arrays]) -> tuple[AnyArray, FloatArray]:
    """Return the sums of x x^H and the number of chips by metre, over several lanes."""
    total = np.sum([lane["covariance"] for lane in lanes], axis=0)
    return total, np.sum([lane["count"] for lane in lanes], axis=0)


def clutter_whitener(total: AnyArray, count: FloatArray, metre: int, load: float) -> AnyArray:
    """Return what whitens the clutter of a metre and of as many about it as give a covariance.

    Parameters
    ----------
    total : (metre, value, value) ndarray of complex
        Sums of x x^H.
    count : (metre,) ndarray
        Number of samples in each.
    metre : int
        The metre.
    load : float
        Share of the mean power that is added to the diagonal.

    Returns
    -------
    (value, value) ndarray of complex
        Inverse of the covariance's Cholesky factor.
    """
    size = total.shape[-1]
    metres_off = np.abs(np.arange(len(count)) - metre)
    reach = 1
    while count[metres_off <= reach].sum() < size:
        reach += 1
    covariance = total[metres_off <= reach].sum(axis=0)
    covariance *= size / np.trace(covariance).real
    return np.linalg.inv(np.linalg.cholesky(covariance + load * np.eye(size)))


def shape_counts(chips: ComplexArray, whitener: ComplexArray, dark: float) -> IntArray:
    """Count chips by the mean power that whitening leaves of them, each over its own power.

    Parameters
    ----------
    chips : (chip, value) ndarray of complex
        In units of the background.
    whitener : (value, value) ndarray of complex
        Whitens clutter.
    dark : float
        A chip of less power counts as if it had as much.

    Returns
    -------
    (class,) ndarray
        Their number below, between and above the borders ``SHAPES``.
    """
    power = np.maximum((np.abs(chips) ** 2).mean(axis=1), dark)
    left = (np.abs(chips @ whitener.T) ** 2).mean(axis=1) / power
    classes = np.searchsorted(SHAPES, left, side="right")
    return np.bincount(classes, minlength=len(SHAPES) + 1)


def principal_directions(chips: AnyArray) -> tuple[AnyArray, FloatArray]:
    """Return the principal vectors of whitened chips of unit power, and their shares of it.

    Vectors are conjugate, the strongest first.
    """
    chips /= np.linalg.norm(chips, axis=1, keepdims=True)
    _, strength, vectors = np.linalg.svd(chips, full_matrices=False)
    return vectors.conj(), strength**2 / (strength**2).sum()


def _single(values: AnyArray) -> ComplexArray:
    """Return values in single precision."""
    return np.asarray(values, dtype=np.complex64)
