"""Removal of echoes before the imaged ground: the direct wave, and the ground under the array.

An image of a narrow sub-band resolves little in range: under a Hann window, 0.15 GHz blur an echo
over 4 m of path to either side. The direct wave and the ground below the array are so strong that
they then cover the ground ahead. The whole band separates them. So they are taken out of the data
of the whole band, before it is divided.
"""

from __future__ import annotations

import numpy as np

from flgpr.jit.threads import blas_on_one_thread
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import ArrayLike, Complex128Array, ComplexArray, floats

LEAST_EIGENVALUE = 1e-6
"""Of the greatest: what is weaker in the tones is left, 60 dB below an early echo."""


def early_basis(frequency: ArrayLike, path: float) -> Complex128Array:
    r"""Compute what spans the echoes of all paths from zero to a longest one at some tones.

    The vectors are the eigenvectors of the echoes' mean covariance, whose element for two tones
    :math:`k, k'` (wavenumbers) is :math:`\int_0^L e^{-j(k-k')x} dx`. At even tones they are the
    discrete prolate spheroidal sequences (Slepian, "Prolate spheroidal wave functions, Fourier
    analysis, and uncertainty V", Bell Syst. Tech. J. 57 (1978)): of all signals of a limited band
    the most concentrated within a stretch of path.

    Parameters
    ----------
    frequency : (tone,) array_like
        Tones, Hz; they need not be even.
    path : float
        Longest path L, there and back, m.

    Returns
    -------
    (tone, vector) ndarray of complex
        Orthonormal vectors.

    Raises
    ------
    ValueError
        If the path is not positive, or so long that the echoes fill all tones.
    """
    tones = floats(frequency)
    if not path > 0:
        raise ValueError(f"path must be positive, got {path:g} m")
    wavenumber = 2 * np.pi * tones / SPEED_OF_LIGHT
    apart = wavenumber[:, None] - wavenumber
    # The integral is L times sinc(apart * L / 2), with the phase of the middle of the paths.
    covariance = np.sinc(apart * path / (2 * np.pi)) * np.exp(-0.5j * apart * path)
    with blas_on_one_thread():
        values, vectors = np.linalg.eigh(covariance)
    strong = values > LEAST_EIGENVALUE * values[-1]
    if strong.all():
        raise ValueError(
            f"path must leave later echoes at {tones.size} tones, got {path:g} m, whose earlier "
            "ones fill all of them"
        )
    return np.asarray(vectors[:, strong])


def subtract_early(data: ArrayLike, basis: Complex128Array) -> ComplexArray:
    """Take the part in a basis out of data.

    Echoes that come a few range cells after the longest path lose little; a range cell is the speed
    of light over the band. In contrast to :func:`flgpr.clutter.gate`, an early echo leaves no
    sidelobes later.

    Parameters
    ----------
    data : (..., tone) array_like of complex
        Received field.
    basis : (tone, vector) ndarray of complex
        From :func:`early_basis`.

    Returns
    -------
    (..., tone) ndarray of complex64
        The data without it.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import early_basis, subtract_early
    >>> tones = np.arange(0.5e9, 1.5e9, 10e6)
    >>> direct, mine = (np.exp(-2j * np.pi * tones * path / 299792458.0) for path in (1.0, 8.0))
    >>> rest = subtract_early(1000 * direct + mine, early_basis(tones, 4.0))
    >>> bool(np.sum(abs(rest - mine) ** 2) < 0.05 * np.sum(abs(mine) ** 2))
    True
    """
    signal = np.asarray(data, dtype=np.complex128)
    with blas_on_one_thread():
        early = (signal @ basis.conj()) @ basis.T
    return np.asarray(signal - early, dtype=np.complex64)
