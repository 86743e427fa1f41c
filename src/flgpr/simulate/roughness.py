"""Rough surfaces: the height field that buried echoes pass, and the strength of the surface's own echo."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model import SPEED_OF_LIGHT

FloatArray = NDArray[np.float64]


class HeightField:
    """A Gaussian random surface with exponential correlation ``s²·exp(-r/l)``, defined at every point of the plane.

    A sum of plane waves whose wavenumbers follow the surface's spectrum ``(1 + K²l²)^-3/2``: no storage, and the same
    height for every ray that enters at a point.

    Parameters
    ----------
    rms_height, correlation_length : float
        s and l, m.
    rng : Generator
        Draws the waves.
    modes : int
        Number of waves; the heights are Gaussian in the limit of many.
    """

    def __init__(
        self, rms_height: float, correlation_length: float, rng: np.random.Generator, modes: int = 512
    ) -> None:
        wavenumber = np.sqrt(rng.uniform(1e-3, 1.0, modes) ** -2 - 1) / correlation_length
        azimuth = rng.uniform(0, 2 * np.pi, modes)
        self._waves = np.stack([wavenumber * np.cos(azimuth), wavenumber * np.sin(azimuth)])
        self._phase = rng.uniform(0, 2 * np.pi, modes)
        self._scale = rms_height * np.sqrt(2 / modes)

    def __call__(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Height of the surface at points of the lane frame, m, in the shape of ``x`` and ``y``."""
        if self._scale == 0:
            return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        point = np.stack(np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float)), axis=-1)
        return np.asarray(self._scale * np.cos(point @ self._waves + self._phase).sum(axis=-1))


def surface_backscatter(
    frequency: ArrayLike,
    sine: ArrayLike,
    permittivity: ArrayLike,
    rms_height: float,
    correlation_length: float,
    slope: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Backscatter σ⁰ of a slightly rough surface, HH and VV.

    First-order small perturbation with exponential correlation, ``8k⁴s²cos⁴θ|α|²·l²(1 + (2kl·sinθ)²)^-3/2``, averaged
    over the tilts of a larger scale.

    Parameters
    ----------
    frequency : (...) array_like
        Hz.
    sine : (...) array_like
        Sine of the incidence angle.
    permittivity : (...) array_like of complex
        Relative permittivity of the soil.
    rms_height, correlation_length : float
        Of the small scale, m.
    slope : float
        Rms tilt of the large scale in each direction, rad; 0 leaves a single scale.

    Returns
    -------
    hh, vv : (...) ndarray
        Radar cross section per unit area, linear.

    References
    ----------
    Valenzuela 1978; Ulaby, Moore & Fung 1982, vol. II, Sec. 12-5.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.simulate.roughness import surface_backscatter
    >>> sine = np.sin(np.radians(67))
    >>> hh, vv = surface_backscatter([1.05e9, 2.55e9], sine, 3.4, rms_height=0.005, correlation_length=0.05)
    >>> (10 * np.log10([hh, vv])).round(1)  # dB, rows HH and VV
    array([[-40.6, -35.6],
           [-32.6, -27.6]])
    """
    k = 2 * np.pi * np.asarray(frequency, dtype=float) / SPEED_OF_LIGHT
    theta = np.arcsin(np.asarray(sine, dtype=float))
    eps = np.asarray(permittivity, dtype=complex)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5 if slope > 0 else 1)
    weights = weights / weights.sum()
    hh = np.zeros(np.broadcast_shapes(k.shape, theta.shape, eps.shape))
    vv = np.zeros_like(hh)
    for along, w_along in zip(slope * nodes, weights, strict=True):
        for across, w_across in zip(slope * nodes, weights, strict=True):
            cosine = np.clip(np.cos(theta + along) * np.cos(across), 0.02, 1.0)
            sine_local = np.sqrt(1 - cosine**2)
            rotated = (np.sin(across) / np.maximum(sine_local, 1e-6)) ** 2
            alpha_h, alpha_v = _bragg(cosine, sine_local, eps)
            spectrum = correlation_length**2 * (1 + (2 * k * correlation_length * sine_local) ** 2) ** -1.5
            power = w_along * w_across * 8 * k**4 * rms_height**2 * cosine**4 * spectrum
            hh = hh + power * np.abs((1 - rotated) * alpha_h + rotated * alpha_v) ** 2
            vv = vv + power * np.abs((1 - rotated) * alpha_v + rotated * alpha_h) ** 2
    return hh, vv


def _bragg(cosine: FloatArray, sine: FloatArray, eps: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], ...]:
    q = np.sqrt(eps - sine**2)
    alpha_h = (eps - 1) / (cosine + q) ** 2
    alpha_v = (eps - 1) * (eps * (1 + sine**2) - sine**2) / (eps * cosine + q) ** 2
    return alpha_h, alpha_v
