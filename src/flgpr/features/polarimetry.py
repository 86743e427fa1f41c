"""Polarimetric decompositions: entropy/alpha and Cameron's symmetric part.

They are those of Cloude & Pottier (1997) and Cameron (1990, 1996). Both use ratios and phases
between the polarizations, so that the images must share one calibration; a common factor drops out.
Reciprocity is assumed: VH equals HV.
"""

from __future__ import annotations

import numpy as np

from flgpr.kernels.hermitian import eigen_3x3
from flgpr.types import AnyArray, ArrayLike, Complex128Array, FloatArray


def entropy_alpha(
    hh: ArrayLike, hv: ArrayLike, vv: ArrayLike, window: tuple[int, int] = (5, 5)
) -> tuple[FloatArray, FloatArray]:
    """Compute entropy H and mean angle α of the coherency matrix (Wang et al. 2007, Eq. 10).

    The decomposition is that of Cloude & Pottier (1997): ``k = [hh + vv, hh - vv, 2 hv]/√2``,
    ``T = <k kᴴ>`` over the window, ``p_i = λ_i/Σλ``; ``H = -Σ p_i log₃ p_i`` and
    ``α = Σ p_i arccos|e_i(1)|``. Of equal eigenvalues the axes are taken as eigenvectors where T is
    diagonal.

    Parameters
    ----------
    hh, hv, vv : (..., y, x) array_like of complex
        Images on one calibration, or single numbers.
    window : tuple of int
        Pixels (y, x) of the average, odd; it shrinks at the border.

    Returns
    -------
    entropy, alpha : (..., y, x) ndarray
        H, 0 (one mechanism) to 1 (random), and α, rad: 0 for a sphere, π/4 for a dipole, π/2 for a
        dihedral; NaN where there is no signal.

    Raises
    ------
    ValueError
        If the images differ in shape or are not finite, or the window is not odd.

    Examples
    --------
    A single mechanism has no entropy; α is 0° for a plane, 45° for a dipole and 90° for a dihedral.

    >>> import numpy as np
    >>> from flgpr.features import entropy_alpha
    >>> flat = np.ones((5, 5))
    >>> for name, vv in (("plane", flat), ("dipole", 0 * flat), ("dihedral", -flat)):
    ...     entropy, alpha = entropy_alpha(flat, 0 * flat, vv)
    ...     print(f"{name}: {abs(entropy[2, 2]):.2f}, {np.degrees(alpha[2, 2]):.0f}°")
    plane: 0.00, 0°
    dipole: 0.00, 45°
    dihedral: 0.00, 90°
    """
    channels, shape = _channels(hh, hv, vv)
    if any(n < 1 or n % 2 == 0 for n in window):
        raise ValueError(f"window must be odd numbers of pixels, got {window}")
    matrix = coherency(*channels)
    for axis, size in zip((-4, -3), window, strict=True):
        matrix = _window_mean(matrix, size // 2, matrix.ndim + axis)
    entropy, alpha = entropy_alpha_of(matrix)
    return entropy.reshape(shape), alpha.reshape(shape)


def coherency(hh: Complex128Array, hv: Complex128Array, vv: Complex128Array) -> Complex128Array:
    """Compute the coherency matrix k·kᴴ (..., 3, 3) of every pixel (Wang et al. 2007, Eq. 10).

    This is Eq. 10 without its mean over a window.
    """
    vector = np.stack([hh + vv, hh - vv, 2 * hv], axis=-1) / np.sqrt(2)
    return np.asarray(vector[..., :, None] * vector[..., None, :].conj())


def entropy_alpha_of(matrix: Complex128Array) -> tuple[FloatArray, FloatArray]:
    """Compute entropy and mean angle α, rad, of averaged coherency matrices (..., 3, 3).

    Both have the leading shape of the matrices and are NaN where the matrix is zero.
    """
    flat = np.ascontiguousarray(matrix.reshape(-1, 3, 3), dtype=np.complex128)
    values = np.empty((len(flat), 3))
    vectors = np.empty((len(flat), 3, 3), np.complex128)
    eigen_3x3(flat, values, vectors)
    values = np.maximum(values, 0.0)
    total = values.sum(axis=1, keepdims=True)
    share = np.divide(values, total, out=np.full_like(values, np.nan), where=total > 0)
    logarithm = np.log(share, out=np.zeros_like(share), where=share > 0)
    size = np.abs(vectors)
    # arccos|e(1)|, exact near 0 too
    angle = np.arctan2(np.hypot(size[:, 1], size[:, 2]), size[:, 0])
    entropy = np.maximum(-(share * logarithm).sum(axis=1) / np.log(3), 0.0)
    alpha = (share * angle).sum(axis=1)
    shape = matrix.shape[:-2]
    return entropy.reshape(shape), alpha.reshape(shape)


def cameron(hh: ArrayLike, hv: ArrayLike, vv: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute the degree of symmetry τ and the rotation angle ψ (Wang et al. 2007, Eq. 13-15).

    The decomposition is that of Cameron et al. (1996); both are in rad.

    τ is 0 for a symmetric scatterer to π/4 for a helix. ψ, in (-π/2, π/2], is that of the
    eigenvector of the symmetric part whose eigenvalue is larger in modulus. It says nothing for a
    sphere or a helix (0 is returned) and is known modulo 90° only where both eigenvalues are
    equally large.

    Parameters
    ----------
    hh, hv, vv : (...) array_like of complex
        Images on one calibration, or single numbers.

    Returns
    -------
    tau, psi : (...) ndarray
        τ and ψ, rad, NaN where there is no signal.

    Raises
    ------
    ValueError
        If the images differ in shape or are not finite.

    Examples
    --------
    A sphere or plane, a dihedral and a dipole; τ is 0 for symmetric scatterers.

    >>> import numpy as np
    >>> from flgpr.features import cameron
    >>> tau, _ = cameron([1, 1, 1], [0, 0, 0], [1, -1, 0])  # HH, HV, VV
    >>> tau.round(3)
    array([0., 0., 0.])
    >>> tau, _ = cameron(1, 1j, -1)  # a helix has no symmetry
    >>> round(np.degrees(float(tau)))
    45
    """
    (s_hh, s_hv, s_vv), shape = _channels(hh, hv, vv)
    # Inner products of S_rec with the parts of which it is made, of length one: S_a = [1 0; 0
    # 1]/√2, S_b = [1 0; 0 -1]/√2 and S_c = [0 1; 1 0]/√2.
    S_rec_S_a = (s_hh + s_vv) / np.sqrt(2)
    S_rec_S_b = (s_hh - s_vv) / np.sqrt(2)
    S_rec_S_c = np.sqrt(2) * s_hv

    # Eq. 14: S' = S_b cos θ + S_c sin θ, with the θ that makes |S_rec • S'| largest.
    theta = _angle_of_largest_part(S_rec_S_b, S_rec_S_c)
    S_rec_S_prime = S_rec_S_b * np.cos(theta) + S_rec_S_c * np.sin(theta)

    # Eq. 13: S_sym = (S_rec • S_a) S_a + (S_rec • S') S'. What is left of S_rec is at right angles
    # to it.
    left_over = S_rec_S_c * np.cos(theta) - S_rec_S_b * np.sin(theta)
    S_sym_length = np.hypot(np.abs(S_rec_S_a), np.abs(S_rec_S_prime))

    # Eq. 15: cos τ = |S_sym • S_rec| / (|S_sym| |S_rec|). The arctangent is exact near 0, too.
    tau = np.arctan2(np.abs(left_over), S_sym_length)

    # S_sym, turned by θ/2, is diagonal: (S_rec • S_a ± S_rec • S')/√2. The first must not be
    # smaller in modulus.
    second_is_larger = np.abs(S_rec_S_a - S_rec_S_prime) > np.abs(S_rec_S_a + S_rec_S_prime)
    psi = theta / 2 + np.where(second_is_larger, np.pi / 2, 0.0)
    psi = np.where(psi > np.pi / 2, psi - np.pi, psi)

    no_signal = np.abs(S_rec_S_a) ** 2 + np.abs(S_rec_S_b) ** 2 + np.abs(S_rec_S_c) ** 2 == 0
    tau = np.where(no_signal, np.nan, tau)
    psi = np.where(no_signal, np.nan, psi)
    return tau.reshape(shape), psi.reshape(shape)


def _angle_of_largest_part(S_rec_S_b: Complex128Array, S_rec_S_c: Complex128Array) -> FloatArray:
    """Return the θ of Eq. 14; 0 for a sphere and a helix, for which any angle does."""
    across = 2 * (S_rec_S_b * S_rec_S_c.conj()).real
    along = np.abs(S_rec_S_b) ** 2 - np.abs(S_rec_S_c) ** 2
    power = np.abs(S_rec_S_b) ** 2 + np.abs(S_rec_S_c) ** 2
    any_angle = np.hypot(across, along) <= 8 * np.finfo(np.float64).eps * power
    return np.asarray(np.where(any_angle, 0.0, np.arctan2(across, along) / 2))


def _channels(*arrays: ArrayLike) -> tuple[list[Complex128Array], tuple[int, ...]]:
    """Return checked channels of at least two dimensions, and their shape before."""
    channels = [np.asarray(array, dtype=np.complex128) for array in arrays]
    shape = channels[0].shape
    if any(channel.shape != shape for channel in channels):
        raise ValueError(
            f"hh, hv and vv must have the same shape, got {[channel.shape for channel in channels]}"
        )
    if not all(np.isfinite(channel).all() for channel in channels):
        raise ValueError("hh, hv and vv must be finite, got values that are not")
    return [np.atleast_2d(channel) for channel in channels], shape


def _window_mean(array: AnyArray, half: int, axis: int) -> AnyArray:
    """Average over a window along an axis; at the ends over the pixels that exist."""
    # Plain sums: differences of running sums would not be exact enough.
    array = np.moveaxis(array, axis, 0)
    length = array.shape[0]
    total = np.zeros_like(array)
    count = np.zeros(length)
    for shift in range(-half, half + 1):
        target = slice(max(0, -shift), length - max(0, shift))
        source = slice(max(0, shift), length - max(0, -shift))
        if abs(shift) < length:
            total[target] += array[source]
            count[target] += 1
    mean = total / count.reshape(-1, *([1] * (array.ndim - 1)))
    return np.moveaxis(mean, 0, axis)
