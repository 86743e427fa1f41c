"""Rough surfaces: the heights that buried echoes pass, and the strength of the surface's echo."""

from __future__ import annotations

import math

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Surface
from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

UNEVEN_LENGTH = 0.5
"""Outer scale of the uneven ground, m.

Its waves longer than 2π times this carry bodies and scatterers with them.
"""


class HeightField:
    """A Gaussian random surface: ``s²·exp(-r/l)`` and the unevenness of a track.

    It is a sum of plane waves whose wavenumbers follow the surface's spectrum,
    ``(1 + K²l²)^-3/2`` for the short waves: no storage, and the same height for every ray that
    enters at a point. Each wave belongs to the short or to the uneven waves
    (:func:`uneven_height`), by their shares of the variance.

    Parameters
    ----------
    rms_height, correlation_length : float
        s and l of the exponential correlation, m.
    rng : numpy.random.Generator
        Draws the waves.
    unevenness, waviness : float
        Of the uneven ground, as in :func:`uneven_height`.
    modes : int
        Number of waves.
    """

    def __init__(
        self,
        rms_height: float,
        correlation_length: float,
        rng: np.random.Generator,
        unevenness: float = 0.0,
        waviness: float = 2.0,
        modes: int = 512,
    ) -> None:
        level = rng.uniform(1e-3, 1.0, modes)
        azimuth = rng.uniform(0, 2 * np.pi, modes)
        self._phase = rng.uniform(0, 2 * np.pi, modes)
        # Inverse of the spectrum's cumulative distribution at uniform levels.
        wavenumber = np.sqrt(level**-2 - 1) / correlation_length
        total_height = math.hypot(rms_height, uneven_height(unevenness, waviness))
        if unevenness > 0:
            uneven = rng.random(modes) * total_height**2 >= rms_height**2
            exponent = -2 / (waviness - 1)
            wavenumber[uneven] = np.sqrt(level[uneven] ** exponent - 1) / UNEVEN_LENGTH
        self._waves = np.stack([wavenumber * np.cos(azimuth), wavenumber * np.sin(azimuth)])
        self._scale = total_height * np.sqrt(2 / modes)

    def __call__(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height at points of the lane frame, m, in the shape of ``x`` and ``y``."""
        if self._scale == 0:
            return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        x, y = np.broadcast_arrays(floats(x), floats(y))
        point = np.stack([x, y], axis=-1)
        return self._scale * np.cos(point @ self._waves + self._phase).sum(axis=-1)


def uneven_height(unevenness: float, waviness: float = 2.0) -> float:
    """Return the rms height of uneven ground up to waves of some 2π·0.5 m, m.

    Profiles of roads and tracks have the one-sided spectrum ``G(n) = G0·(n/0.1)^-w`` over the waves
    per metre n, from about 0.35 to 90 m of wavelength (ISO 8608). An isotropic surface with such
    profiles has the spectrum ``W(K) = 4πH·s²·l²·(1 + K²l²)^-(1+H)`` with ``H = (w - 1)/2`` at
    ``K·l`` well above 1.

    Parameters
    ----------
    unevenness : float
        G0, m³: 16e-6 in the middle of class A, four times as much from class to class (7.1 mm of
        height in class D).
    waviness : float
        w, between 1 and 3.

    Raises
    ------
    ValueError
        If ``unevenness`` is negative or ``waviness`` is outside its range.
    """
    if unevenness < 0:
        raise ValueError(f"unevenness must not be negative, got {unevenness!r}")
    if not 1 < waviness < 3:
        raise ValueError(f"waviness must lie between 1 and 3, got {waviness!r}")
    hurst = (waviness - 1) / 2
    # Along a line the isotropic C·K^-(w+1) has G = C·K^-w·sqrt(π)·Γ(w/2)/Γ((w+1)/2)/π, K = 2πn.
    ratio = math.gamma((waviness + 1) / 2) / math.gamma(waviness / 2)
    power = math.sqrt(math.pi) * ratio * unevenness * (0.2 * math.pi) ** waviness
    return math.sqrt(power * UNEVEN_LENGTH ** (2 * hurst) / (4 * math.pi * hurst))


def surface_heights(surface: Surface, seed: int) -> HeightField:
    """Return the heights of a scene's surface, m, the same wherever its ``seed`` is simulated."""
    return HeightField(
        surface.rms_height,
        surface.correlation_length,
        stream(seed, "heights"),
        surface.unevenness,
        surface.waviness,
    )


def surface_backscatter(
    frequency: ArrayLike,
    sine: ArrayLike,
    permittivity: ArrayLike,
    rms_height: float,
    correlation_length: float,
    slope: float = 0.0,
    unevenness: float = 0.0,
    waviness: float = 2.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the backscatter σ⁰ of a slightly rough surface, HH and VV, linear.

    First-order small perturbation with exponential correlation,
    ``8k⁴s²cos⁴θ|α|²·l²(1 + (2kl·sinθ)²)^-3/2``, averaged over the tilts of a larger scale:
    Valenzuela 1978; Ulaby, Moore & Fung 1982, vol. II, Sec. 12-5. Uneven ground
    (:func:`uneven_height`) adds its own spectrum: the short waves' echo grows as f⁴ while their
    correlation length is short beside the wave, and as f when it is long, that of the uneven ground
    as ``f^(3-w)`` throughout (two kinds of roughness, one of a single scale and one self-affine, on
    fields: Davidson et al. 2000).

    Parameters
    ----------
    frequency : array_like
        Frequencies, Hz.
    sine : array_like
        Sines of the angle of incidence; it is broadcast with the frequencies.
    permittivity : array_like of complex
        Permittivity of the soil, broadcast with them too.
    rms_height, correlation_length : float
        s and l, m.
    slope : float
        Rms tilt of the larger scale in each direction, rad.
    unevenness, waviness : float
        Of the uneven ground, as in :func:`uneven_height`.

    Returns
    -------
    hh, vv : ndarray
        σ⁰ in the broadcast shape.

    Raises
    ------
    ValueError
        If ``unevenness`` or ``waviness`` is outside its range.
    """
    k = 2 * np.pi * floats(frequency) / SPEED_OF_LIGHT
    theta = np.arcsin(floats(sine))
    eps = np.asarray(permittivity, dtype=complex)
    # Gaussian quadrature over the tilts.
    nodes, weights = np.polynomial.hermite_e.hermegauss(5 if slope > 0 else 1)
    weights = weights / weights.sum()
    uneven_rms = uneven_height(unevenness, waviness)
    hurst = (waviness - 1) / 2
    hh = np.zeros(np.broadcast_shapes(k.shape, theta.shape, eps.shape))
    vv = np.zeros_like(hh)
    tilts_left = slope * nodes[: nodes.size // 2 + 1]
    for along, w_along in zip(slope * nodes, weights, strict=True):
        terms = []
        for across, w_across in zip(tilts_left, weights, strict=False):
            cosine = np.clip(np.cos(theta + along) * np.cos(across), 0.02, 1.0)
            local_sine = np.sqrt(1 - cosine**2)
            # How much a tilt across the ray turns the polarizations into one another.
            rotated = (np.sin(across) / np.maximum(local_sine, 1e-6)) ** 2
            alpha_h, alpha_v = bragg_factors(cosine, local_sine, eps)

            # Backscatter comes from the roughness of the wavenumber 2k·sinθ (Bragg).
            bragg = 2 * k * local_sine
            spectrum = rms_height**2 * _spectrum(bragg, correlation_length, 0.5)
            if uneven_rms > 0:
                spectrum = spectrum + uneven_rms**2 * _spectrum(bragg, UNEVEN_LENGTH, hurst)
            power = w_along * w_across * 8 * k**4 * cosine**4 * spectrum
            in_hh = power * np.abs((1 - rotated) * alpha_h + rotated * alpha_v) ** 2
            in_vv = power * np.abs((1 - rotated) * alpha_v + rotated * alpha_h) ** 2
            terms.append((in_hh, in_vv))
        # A tilt to the right counts as one to the left.
        mirrored = terms[-2::-1]
        for in_hh, in_vv in terms + mirrored:
            hh = hh + in_hh
            vv = vv + in_vv
    return hh, vv


def _spectrum(wavenumber: FloatArray, length: float, hurst: float) -> FloatArray:
    """Return a roughness spectrum of unit variance over 2π, m².

    ``hurst`` = 1/2 is exponential correlation.
    """
    return 2 * hurst * length**2 * (1 + (wavenumber * length) ** 2) ** -(1 + hurst)


def bragg_factors(
    cosine: FloatArray, sine: FloatArray, eps: Complex128Array
) -> tuple[Complex128Array, Complex128Array]:
    """Return α of HH and VV in small perturbation.

    Parameters
    ----------
    cosine, sine : ndarray
        Of the angle of incidence.
    eps : ndarray of complex
        Permittivity of the soil.
    """
    q = np.sqrt(eps - sine**2)
    alpha_h = (eps - 1) / (cosine + q) ** 2
    alpha_v = (eps - 1) * (eps * (1 + sine**2) - sine**2) / (eps * cosine + q) ** 2
    return alpha_h, alpha_v
