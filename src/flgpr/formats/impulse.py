"""Impulse data, or samples at baseband, taken to frequency."""

from __future__ import annotations

import numpy as np

from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

_UNEVEN = 0.01  # share of a step by which the steps of an axis may differ


def impulse_to_frequency(
    samples: ArrayLike,
    delay: ArrayLike,
    band: tuple[float, float],
    pad: int = 1,
    carrier: float = 0.0,
) -> tuple[Complex128Array, FloatArray]:
    """Transform time-domain (impulse) data to tones.

    A scatterer at the delay t gives ``exp(-j2πft)`` times the pulse's spectrum, since the axis
    keeps its start. Outside the recorded time of ``1/Δf`` delays repeat.

    Parameters
    ----------
    samples : (..., delay) array_like
        Real or analytic signals, or complex ones at baseband.
    delay : (delay,) array_like
        Two-way delays in equal steps, s.
    band : tuple of float
        First and last frequency to keep, Hz; it ends below the Nyquist frequency, and with a
        carrier lies within half the sampling rate of it.
    pad : int
        Zeros make the record so many times as long, and the tones denser.
    carrier : float
        Frequency that the receiver mixed to zero, Hz: its oscillator turned by
        ``exp(-j2π·carrier·t)``, where t is the delay.

    Returns
    -------
    spectrum : (..., frequency) ndarray of complex
        The spectrum.
    frequency : (frequency,) ndarray
        Its tones, Hz.

    Raises
    ------
    ValueError
        If the delays are uneven or do not fit the samples, or the band does not fit them.
    """
    values = np.asarray(samples)
    axis = floats(delay)
    step = _step_of(axis, values.shape)
    if carrier and not np.iscomplexobj(values):
        raise ValueError("carrier is for complex samples, got real ones")
    nyquist = 0.5 / step
    lowest = max(carrier - nyquist, 0.0) if carrier else 0.0
    if not lowest < band[0] < band[1] <= carrier + nyquist:
        limits = f"0 and the Nyquist frequency {nyquist:g} Hz"
        if carrier:
            limits = (
                f"{carrier - nyquist:g} and {carrier + nyquist:g} Hz, "
                "which the samples about the carrier hold"
            )
        raise ValueError(f"band must lie between {limits}, got {band}")
    if pad < 1:
        raise ValueError(f"pad must be at least 1, got {pad}")

    count = axis.size * int(pad)
    bins = np.arange((count + 1) // 2)
    if carrier:
        # At baseband, tones below the carrier are the negative frequencies.
        bins = np.arange(-(count // 2), (count + 1) // 2)
    baseband: FloatArray = bins / (count * step)
    frequency = carrier + baseband
    in_band = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    if not in_band.size:
        spacing = 1 / (count * step)
        raise ValueError(f"band must hold a tone; tones are {spacing:g} Hz apart, got {band}")
    spectrum = np.fft.fft(values, count, axis=-1)[..., bins[in_band]]
    # The transform counts delays from the first sample: its own delay turns the phase.
    phase = np.exp(-2j * np.pi * baseband[in_band] * axis[0])
    return spectrum * phase, frequency[in_band]


def _step_of(axis: FloatArray, shape: tuple[int, ...]) -> float:
    """Return the step of delays (delay,), s, of samples of a shape; uneven ones are refused."""
    if axis.ndim != 1 or axis.size < 2 or shape[-1] != axis.size:
        raise ValueError(
            f"delay must have one value per sample, got {axis.shape} for samples {shape}"
        )
    steps = np.diff(axis)
    step = float(steps.mean())
    rises = bool(np.isfinite(axis).all()) and step > 0
    if not rises or np.abs(steps - step).max() > _UNEVEN * step:
        raise ValueError(
            "delay must increase in equal steps (within 1 %), got an uneven or falling axis"
        )
    return step


def negative_share(samples: ArrayLike) -> float:
    """Return the share of the power of complex samples that lies at negative frequencies.

    Parameters
    ----------
    samples : (..., delay) array_like of complex
        Samples in equal steps. Records with values that are not finite are not counted.

    Returns
    -------
    float
        From 0, of analytic signals, to 1; 0 where there is no power.
    """
    values = np.asarray(samples)
    records = values.reshape(-1, values.shape[-1])
    first_negative = (values.shape[-1] + 2) // 2  # after zero and the Nyquist frequency
    total = 0.0
    negative = 0.0
    for record in records:
        power = np.abs(np.fft.fft(record)) ** 2
        if np.isfinite(power).all():
            total += float(power.sum())
            negative += float(power[first_negative:].sum())
    return negative / total if total else 0.0
