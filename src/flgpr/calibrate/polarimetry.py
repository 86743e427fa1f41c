"""Polarimetric crosstalk and channel imbalance: ``M = R·S·T`` (rows receive, columns transmit, H before V)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

TRIHEDRAL = ((1.0, 0.0), (0.0, 1.0))
DIHEDRAL = ((1.0, 0.0), (0.0, -1.0))
DIHEDRAL_45 = ((0.0, 1.0), (1.0, 0.0))
_PLACE = {"HH": (0, 0), "HV": (1, 0), "VH": (0, 1), "VV": (1, 1)}


@dataclass(frozen=True)
class Distortion:
    """What an antenna pair does to the scattering matrix."""

    #: rx, tx: (..., 2, 2): R and T with their HH element one. Off the diagonal: crosstalk; second diagonal element:
    #: channel imbalance
    rx: NDArray[np.complex128]
    tx: NDArray[np.complex128]
    misfit: NDArray[np.float64]  #: (...): root mean square of ``M - a·R·S·T`` over that of M


def scattering_matrices(run: xr.Dataset) -> NDArray[Any]:
    """Order a run of four polarizations as matrices (scan, pair, frequency, 2, 2): rows receive, columns transmit."""
    labels = [str(label) for label in run["polarization"].values]
    missing = [label for label in _PLACE if label not in labels]
    if missing:
        raise ValueError(f"run must have HH, HV, VH and VV, {', '.join(missing)} missing")
    signal = run["signal"].values
    out = np.empty((signal.shape[0], signal.shape[2], signal.shape[3], 2, 2), signal.dtype)
    for label, place in _PLACE.items():
        out[(..., *place)] = signal[:, labels.index(label)]
    return out


def estimate_distortion(measured: ArrayLike, known: ArrayLike, iterations: int = 500) -> Distortion:
    """Find receive and transmit distortion from reflectors of known scattering matrix and unknown strength.

    Least squares in R, T and the strengths in turn, from the undistorted pair, in at most ``iterations`` rounds. Three
    reflectors are needed, such as a trihedral, a dihedral and a dihedral turned by 45°; a ValueError says where the
    known matrices do not tell R and T. As strengths are free, the sign of both imbalances together stays open; the one
    nearer to no distortion is taken.

    Parameters
    ----------
    measured : (..., reflector, 2, 2) array_like of complex
        Measured matrices, rows receive, columns transmit; leading axes such as pair or frequency are fitted one by one.
    known : (reflector, 2, 2) array_like
        Scattering matrices.
    """
    m, s = np.asarray(measured, dtype=np.complex128), np.asarray(known, dtype=np.complex128)
    if s.ndim != 3 or s.shape[1:] != (2, 2) or m.shape[-3:] != s.shape:
        raise ValueError(f"measured must have the shape (..., reflector, 2, 2) of known {s.shape}, got {m.shape}")
    if not (np.isfinite(m).all() and np.isfinite(s).all()):
        raise ValueError("measured and known must be finite")
    if np.linalg.matrix_rank(s.reshape(len(s), 4)) < 3:
        raise ValueError(
            "known must hold three linearly independent matrices, such as a trihedral, a dihedral and one at 45°"
        )
    r = np.broadcast_to(np.eye(2, dtype=np.complex128), (*m.shape[:-3], 2, 2)).copy()
    t = r.copy()
    for _ in range(iterations):
        before = (r, t)
        r = _side(m, s @ t[..., None, :, :], r)
        t = _side(_turned(m), _turned(r[..., None, :, :] @ s), _turned(t)).swapaxes(-1, -2)
        if max(np.abs(r - before[0]).max(), np.abs(t - before[1]).max()) < 1e-13:
            break
    model = r[..., None, :, :] @ s @ t[..., None, :, :]
    rest = m - _strength(m, model)[..., None, None] * model
    misfit = np.sqrt((np.abs(rest) ** 2).sum(axis=(-3, -2, -1)) / (np.abs(m) ** 2).sum(axis=(-3, -2, -1)))
    return Distortion(r, t, misfit)


def remove_distortion(run: xr.Dataset, distortion: Distortion) -> xr.Dataset:
    """Turn a run's measured matrices into scattering matrices: ``S = R⁻¹·M·T⁻¹``.

    The distortion's leading axes must broadcast against (pair, frequency). A polarization that is missing, or a matrix
    that cannot be inverted, is a ValueError.
    """
    try:
        left, right = np.linalg.inv(distortion.rx), np.linalg.inv(distortion.tx)
    except np.linalg.LinAlgError:
        raise ValueError("distortion must be invertible, it is not: a dead channel?") from None
    clean = left @ scattering_matrices(run) @ right
    signal = np.stack([clean[(..., *_PLACE[str(label)])] for label in run["polarization"].values], axis=1)
    return run.assign(signal=(run["signal"].dims, signal.astype(run["signal"].dtype)))


def _side(m: NDArray[Any], x: NDArray[Any], r: NDArray[Any]) -> NDArray[Any]:
    """One round of ``m ≈ a·r·x``: strengths from the last r, then r, scaled to have one at HH."""
    a = _strength(m, r[..., None, :, :] @ x)
    ax = a[..., None, None] * x
    adjoint = ax.conj().swapaxes(-1, -2)
    new = (m @ adjoint).sum(axis=-3) @ np.linalg.pinv((ax @ adjoint).sum(axis=-3))
    return np.asarray(new / new[..., :1, :1])


def _strength(m: NDArray[Any], model: NDArray[Any]) -> NDArray[Any]:
    power = (np.abs(model) ** 2).sum(axis=(-2, -1))
    return np.asarray((model.conj() * m).sum(axis=(-2, -1)) / np.maximum(power, np.finfo(float).tiny))


def _turned(m: NDArray[Any]) -> NDArray[Any]:
    return m.swapaxes(-1, -2)
