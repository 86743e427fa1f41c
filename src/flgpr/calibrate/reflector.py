"""Calibration by reflectors: delay and gain of pairs, crosstalk and imbalance of polarizations.

Crosstalk and imbalance are ``M = R·S·T`` (rows receive, columns transmit, H before V).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flgpr.calibrate.profiles import resolution
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, check_run, complete_scans
from flgpr.model.phase import lengthen, path_phase
from flgpr.model.run import polarizations_of, with_signal
from flgpr.types import AnyArray, ArrayLike, Complex128Array, FloatArray, IndexArray, floats

SLOPES = {"sphere": 0.0, "corner": 1.0}
"""Power of frequency in the echo's amplitude: a wide sphere, a trihedral corner."""


@dataclass(frozen=True)
class PairFit:
    """Delay and gain of every pair."""

    polarization: tuple[str, ...]  #: polarizations the reflector answers in
    delay: FloatArray  #: (polarization, pair): how late the pair's echo comes, s
    #: (polarization, pair): echo over that of a unit reflector, after the delay is removed
    gain: Complex128Array
    #: (polarization, pair): height of the echo over the median level within the search, 1; below 3
    #: it may be chance
    contrast: FloatArray


def estimate_pairs(
    run: xr.Dataset, point: ArrayLike, kind: str = "sphere", search: float = 0.5
) -> PairFit:
    """Estimate delay and gain of every pair, in HH and VV, from the echo of a known reflector.

    The echo of a unit reflector is ``f^slope·exp(-j2πfL/c)/(R_t·R_r)``, R in metres and f over its
    mean. Scans are averaged after each is referred to its own path, so that clutter elsewhere
    averages out. A corner returns its echo to where it came from: for pairs far apart take a
    sphere. Neither has an echo in HV and VH.

    Parameters
    ----------
    run : xarray.Dataset
        A run with a complete scan and HH or VV.
    point : (3,) array_like
        Phase centre of the reflector in the lane frame, m.
    kind : {"sphere", "corner"}
        The reflector.
    search : float
        Path lengths to either side of the right one where the echo is searched, m.

    Returns
    -------
    PairFit
        Delay and gain.

    Raises
    ------
    ValueError
        If a parameter breaks its rule, or the run has no complete scan or neither HH nor VV.
    """
    check_run(run)
    position = floats(point)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise ValueError(f"point must be x, y, z, got {position}")
    if kind not in SLOPES:
        raise ValueError(f"kind must be one of {', '.join(SLOPES)}, got {kind!r}")
    if not search > 0:
        raise ValueError(f"search must be positive, got {search}")
    labels = polarizations_of(run)
    rows = [k for k, label in enumerate(labels) if label in ("HH", "VV")]
    scans = np.flatnonzero(complete_scans(run))
    if not rows or not scans.size:
        raise ValueError(
            "run must have HH or VV and a complete scan, "
            f"got {labels} and {scans.size} complete scans"
        )
    frequency = run["frequency"].values
    aligned = _aligned_echo(run, scans, rows, position)
    aligned /= scans.size * (frequency / frequency.mean()) ** SLOPES[kind]
    return _fit_pairs(tuple(labels[k] for k in rows), aligned, frequency, search)


def _aligned_echo(
    run: xr.Dataset, scans: IndexArray, rows: list[int], position: FloatArray
) -> Complex128Array:
    """Return the sum over scans of a reflector's echo without its path and its spreading.

    It is (polarization, pair, frequency), of the polarizations in ``rows``.
    """
    frequency = run["frequency"].values
    total = np.zeros((len(rows), run.sizes["pair"], frequency.size), np.complex128)
    for scan in scans:
        tx, rx = antennas_in_lane(run, run["pose"].values[scan])
        outward = np.linalg.norm(tx - position, axis=1)
        back = np.linalg.norm(rx - position, axis=1)
        data = run["signal"][scan].values[rows].astype(np.complex128)
        at_reflector = lengthen(data, frequency, -(outward + back))
        total += at_reflector * (outward * back)[:, None]
    return total


def _fit_pairs(
    labels: tuple[str, ...],
    aligned: Complex128Array,
    frequency: FloatArray,
    search: float,
) -> PairFit:
    """Fit delay and gain to echoes (polarization, pair, frequency) referred to the right path."""
    step = resolution(frequency) / 4  # of the path: an eighth of its resolution
    offsets = np.arange(-search, search + step / 2, step)
    level = np.abs(aligned @ path_phase(frequency, -offsets).T) / frequency.size
    best = offsets[level.argmax(axis=-1)]

    # Around the best offset of every pair with halved steps, down to a micrometre.
    while step > 1e-6:
        trials = best[..., None] + np.array([-step, 0.0, step])
        turned = aligned[..., None, :] * path_phase(frequency, -trials)
        size = np.abs(turned.sum(axis=-1))
        largest = size.argmax(axis=-1)[..., None]
        best = np.take_along_axis(trials, largest, axis=-1)[..., 0]
        step /= 2

    gain = lengthen(aligned, frequency, -best).mean(axis=-1)
    median_level = np.maximum(np.median(level, axis=-1), np.finfo(float).tiny)
    contrast = np.abs(gain) / median_level
    return PairFit(labels, best / SPEED_OF_LIGHT, gain, contrast)


def apply_pairs(run: xr.Dataset, fit: PairFit) -> xr.Dataset:
    """Remove the delays of a run and make its gains equal, to their root mean square.

    Parameters
    ----------
    run : xarray.Dataset
        A run of as many pairs.
    fit : PairFit
        From :func:`estimate_pairs`; polarizations that it does not hold stay as they are.

    Returns
    -------
    xarray.Dataset
        The calibrated run.

    Raises
    ------
    ValueError
        If the number of pairs differs, or a gain is zero.
    """
    if fit.delay.shape[1] != run.sizes["pair"]:
        raise ValueError(
            f"run must have {fit.delay.shape[1]} pairs as the calibration has, "
            f"got {run.sizes['pair']}"
        )
    if (np.abs(fit.gain) == 0).any():
        polarization, pair = np.argwhere(np.abs(fit.gain) == 0)[0]
        raise ValueError(
            f"gain must not be zero, it is for {fit.polarization[polarization]} pair {pair}: "
            "a dead channel?"
        )
    labels = polarizations_of(run)
    signal = run["signal"].values.copy()
    scale = np.sqrt(np.mean(np.abs(fit.gain) ** 2))
    for k, label in enumerate(fit.polarization):
        if label in labels:
            row = labels.index(label)
            path = -fit.delay[k] * SPEED_OF_LIGHT
            shifted = lengthen(signal[:, row], run["frequency"].values, path)
            signal[:, row] = shifted * (scale / fit.gain[k])[:, None]
    return with_signal(run, signal)


TRIHEDRAL = ((1.0, 0.0), (0.0, 1.0))
DIHEDRAL = ((1.0, 0.0), (0.0, -1.0))
DIHEDRAL_45 = ((0.0, 1.0), (1.0, 0.0))
_ELEMENT = {"HH": (0, 0), "HV": (1, 0), "VH": (0, 1), "VV": (1, 1)}


@dataclass(frozen=True)
class Distortion:
    """Distortion of the scattering matrix by an antenna pair.

    R and T have one as their HH element, crosstalk off the diagonal, and the channel imbalance as
    the second diagonal element.
    """

    rx: Complex128Array  #: (..., 2, 2): R
    tx: Complex128Array  #: (..., 2, 2): T
    misfit: FloatArray  #: (...): root mean square of ``M - a·R·S·T`` over that of M


def scattering_matrices(run: xr.Dataset) -> AnyArray:
    """Return the scattering matrices (scan, pair, frequency, 2, 2) of a run of four polarizations.

    Rows receive, columns transmit. A missing polarization is a ValueError.
    """
    labels = polarizations_of(run)
    missing = [label for label in _ELEMENT if label not in labels]
    if missing:
        raise ValueError(f"run must have HH, HV, VH and VV, {', '.join(missing)} missing")
    signal = run["signal"].values
    out = np.empty((signal.shape[0], signal.shape[2], signal.shape[3], 2, 2), signal.dtype)
    for label, (row, column) in _ELEMENT.items():
        out[..., row, column] = signal[:, labels.index(label)]
    return out


def estimate_distortion(measured: ArrayLike, known: ArrayLike, iterations: int = 500) -> Distortion:
    """Estimate receive and transmit distortion from reflectors of known scattering matrices.

    Their strengths are unknown. R, T and the strengths are fitted by least squares in turn, from
    the undistorted pair, in at most ``iterations`` rounds. Three reflectors are needed, such as a
    trihedral, a dihedral and a dihedral turned by 45°. As strengths are free, the sign of both
    imbalances together stays open; the one nearer to no distortion is taken.

    Parameters
    ----------
    measured : (..., reflector, 2, 2) array_like of complex
        Measured matrices, rows receive, columns transmit; leading axes such as pair or frequency
        are fitted one by one.
    known : (reflector, 2, 2) array_like
        Scattering matrices.
    iterations : int
        Largest number of rounds.

    Returns
    -------
    Distortion
        R, T and the misfit.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or the known matrices do not determine R and T.
    """
    m = np.asarray(measured, dtype=np.complex128)
    s = np.asarray(known, dtype=np.complex128)
    if s.ndim != 3 or s.shape[1:] != (2, 2) or m.shape[-3:] != s.shape:
        raise ValueError(
            f"measured must have the shape (..., reflector, 2, 2) of known {s.shape}, got {m.shape}"
        )
    if not (np.isfinite(m).all() and np.isfinite(s).all()):
        raise ValueError("measured and known must be finite")
    if np.linalg.matrix_rank(s.reshape(len(s), 4)) < 3:
        raise ValueError(
            "known must hold three linearly independent matrices, "
            "such as a trihedral, a dihedral and one at 45°"
        )
    undistorted = np.eye(2, dtype=np.complex128)
    r = np.broadcast_to(undistorted, (*m.shape[:-3], 2, 2)).copy()
    t = r.copy()
    for _ in range(iterations):
        last_r = r
        last_t = t
        r = _fit_side(m, s @ t[..., None, :, :], r)
        # Transposed, M = R·S·T reads Mᵀ = Tᵀ·(R·S)ᵀ: the same fit gives T.
        received = r[..., None, :, :] @ s
        t = _transpose(_fit_side(_transpose(m), _transpose(received), _transpose(t)))
        if max(np.abs(r - last_r).max(), np.abs(t - last_t).max()) < 1e-13:
            break

    model = r[..., None, :, :] @ s @ t[..., None, :, :]
    residual = m - _strength(m, model)[..., None, None] * model
    residual_power = (np.abs(residual) ** 2).sum(axis=(-3, -2, -1))
    measured_power = (np.abs(m) ** 2).sum(axis=(-3, -2, -1))
    return Distortion(r, t, np.sqrt(residual_power / measured_power))


def remove_distortion(run: xr.Dataset, distortion: Distortion) -> xr.Dataset:
    """Convert a run's measured matrices to scattering matrices, ``S = R⁻¹·M·T⁻¹``.

    Parameters
    ----------
    run : xarray.Dataset
        A run of four polarizations.
    distortion : Distortion
        Its leading axes must broadcast against (pair, frequency).

    Returns
    -------
    xarray.Dataset
        The calibrated run.

    Raises
    ------
    ValueError
        If a polarization is missing or the distortion cannot be inverted.
    """
    try:
        left = np.linalg.inv(distortion.rx)
        right = np.linalg.inv(distortion.tx)
    except np.linalg.LinAlgError:
        raise ValueError("distortion must be invertible, it is not: a dead channel?") from None
    clean = left @ scattering_matrices(run) @ right
    elements = []
    for label in polarizations_of(run):
        row, column = _ELEMENT[label]
        elements.append(clean[..., row, column])
    signal = np.stack(elements, axis=1)
    return with_signal(run, signal)


def _fit_side(m: AnyArray, x: AnyArray, r: AnyArray) -> AnyArray:
    """Fit ``m ≈ a·r·x`` once: strengths from the last r, then r, scaled to have one at HH."""
    a = _strength(m, r[..., None, :, :] @ x)
    ax = a[..., None, None] * x
    adjoint = ax.conj().swapaxes(-1, -2)
    # Normal equations of the least squares, summed over the reflectors.
    measured = (m @ adjoint).sum(axis=-3)
    normal = (ax @ adjoint).sum(axis=-3)
    new = measured @ np.linalg.pinv(normal)
    return new / new[..., :1, :1]


def _strength(m: AnyArray, model: AnyArray) -> AnyArray:
    """Return the complex strengths of the model matrices that fit the measured ones best."""
    power = (np.abs(model) ** 2).sum(axis=(-2, -1))
    overlap = (model.conj() * m).sum(axis=(-2, -1))
    return overlap / np.maximum(power, np.finfo(float).tiny)


def _transpose(m: AnyArray) -> AnyArray:
    """Return matrices (..., 2, 2) with rows and columns exchanged."""
    return m.swapaxes(-1, -2)
