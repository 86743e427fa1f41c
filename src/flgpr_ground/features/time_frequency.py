"""Double reflections in range profiles, seen in time and frequency (after Sun & Li 2003).

Y. Sun & J. Li, "Time-frequency analysis for plastic landmine detection via forward-looking ground
penetrating radar", IEE Proc. Radar Sonar Navig. 150(4), 2003: a plastic mine reflects at its top
and at its bottom. Of the paper nothing but title and citations could be read; transform and
features are ours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import Complex128Array, FloatArray

_TINY = np.finfo(np.float64).tiny


class ReflectionFeatures(NamedTuple):
    """Features (profile,) of the first reflection, and of what follows it."""

    level: FloatArray  #: energy of the first reflection, dB
    second: FloatArray  #: energy of the strongest reflection behind it, relative to its own, dB
    distance: FloatArray  #: from the first to the second, m
    shift: FloatArray  #: mean frequency of the second less that of the first, Hz
    bandwidth: FloatArray  #: standard deviation of the frequency of the first, Hz
    entropy: FloatArray  #: of the whole plane, bits; one more for a second part as strong as one


def range_wavenumbers(
    points: FloatArray, tx: FloatArray, rx: FloatArray, frequency: FloatArray
) -> FloatArray:
    """Return how fast the phase of a focused image turns down-track at points of the ground.

    Parameters
    ----------
    points : (point, 2) ndarray
        x and y in the scan frame, m.
    tx, rx : (pair, 3) ndarray
        Antennas in the scan frame, m.
    frequency : (frequency,) ndarray
        Hz.

    Returns
    -------
    (point, frequency) ndarray
        ``2πf/c`` times the change of the path per metre, the mean over the pairs, rad/m.
    """
    path_per_metre = np.zeros(len(points))
    for antennas in (tx, rx):
        offset = points[:, None] - antennas[None, :, :2]
        distance = np.sqrt((offset**2).sum(axis=2) + antennas[:, 2] ** 2)
        path_per_metre += (offset[..., 1] / distance).mean(axis=1)
    return 2 * np.pi / SPEED_OF_LIGHT * path_per_metre[:, None] * frequency


def spectrograms(
    profiles: Complex128Array, offsets: FloatArray, wavenumbers: FloatArray, width: float
) -> FloatArray:
    """Compute the energy of range profiles by range and frequency.

    ``|Σ_n s(r_n) g(r_n - r) exp(-i k r_n)|²`` with a Gaussian window g of standard deviation
    ``width`` and the sum 1.

    Parameters
    ----------
    profiles : (profile, range) ndarray of complex
        s.
    offsets : (range,) ndarray
        r, evenly spaced, m.
    wavenumbers : (profile, frequency) ndarray
        k, rad/m.
    width : float
        m.

    Returns
    -------
    (profile, range, frequency) ndarray
        Energy.
    """
    window = np.exp(-((offsets[None, :] - offsets[:, None]) ** 2) / (2 * width**2))
    window /= window.sum(axis=1, keepdims=True)
    rotation = np.exp(-1j * wavenumbers[:, None, :] * offsets[None, :, None])
    transformed = (profiles[:, None, :] * window) @ rotation
    return np.abs(transformed) ** 2


def reflection_features(
    energy: FloatArray,
    offsets: FloatArray,
    frequency: FloatArray,
    search: float,
    gate: tuple[float, float],
) -> ReflectionFeatures:
    """Return what tells a double reflection from a single one.

    The first reflection is where the energy over all frequencies is largest within ``search`` of
    the middle; the second is where it is largest from ``gate[0]`` to ``gate[1]`` behind the first.

    Parameters
    ----------
    energy : (profile, range, frequency) ndarray
        What :func:`spectrograms` returned.
    offsets : (range,) ndarray
        Ranges about the middle, m. They reach ``search + gate[1]`` behind it.
    frequency : (frequency,) ndarray
        Hz.
    search : float
        m.
    gate : (float, float)
        m.

    Returns
    -------
    ReflectionFeatures
        The features. The entropy is Rényi's of the third order, which counts the parts of a
        time-frequency plane (Baraniuk, Flandrin, Janssen & Michel 2001).

    Raises
    ------
    ValueError
        If the ranges do not reach so far.
    """
    if offsets[-1] < search + gate[1] - 1e-9:
        raise ValueError(
            f"offsets must reach search + gate = {search + gate[1]:g} m, got {offsets[-1]:g} m"
        )
    rows = np.arange(len(energy))
    over_range = energy.mean(axis=2)
    may_be_first = np.abs(offsets) <= search + 1e-9
    first = np.where(may_be_first, over_range, -1.0).argmax(axis=1)

    behind = offsets[None, :] - offsets[first][:, None]
    in_gate = (behind >= gate[0] - 1e-9) & (behind <= gate[1] + 1e-9)
    second = np.where(in_gate, over_range, -1.0).argmax(axis=1)

    first_energy = np.maximum(over_range[rows, first], _TINY)
    second_energy = np.maximum(over_range[rows, second], _TINY)
    first_mean, first_deviation = _frequency_moments(energy[rows, first], frequency)
    second_mean, _ = _frequency_moments(energy[rows, second], frequency)
    return ReflectionFeatures(
        level=10 * np.log10(first_energy),
        second=10 * np.log10(second_energy / first_energy),
        distance=behind[rows, second],
        shift=second_mean - first_mean,
        bandwidth=first_deviation,
        entropy=_entropy(energy),
    )


def _frequency_moments(
    spectrum: FloatArray, frequency: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (profile,) of the frequency by energy."""
    share = spectrum / np.maximum(spectrum.sum(axis=1, keepdims=True), _TINY)
    mean = share @ frequency
    variance = (share * (frequency - mean[:, None]) ** 2).sum(axis=1)
    return mean, np.sqrt(variance)


def _entropy(energy: FloatArray) -> FloatArray:
    """Return Rényi's entropy (profile,) of the third order, bits."""
    total = np.maximum(energy.sum(axis=(1, 2), keepdims=True), _TINY)
    cubes = ((energy / total) ** 3).sum(axis=(1, 2))
    return -0.5 * np.log2(np.maximum(cubes, _TINY))
