"""Waves from antenna to antenna over one straight path: the direct wave, or that of an image.

All are in the unit of the echoes before :func:`flgpr.simulate.simulator.system_response`
multiplies them: a horn's ``G·λ/(4π)^1.5`` times ``sqrt(4π)/R`` is Friis' ``G·λ/(4πR)``, a dipole's
``ωμ0/(4π)^1.5`` times it the field ``ωμ0/(4πR)`` of a unit moment.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.radar.spread import ArrayState
from flgpr.types import Complex128Array, ComplexArray, FloatArray

_SAME_PLACE = 1e-3  # m: nearer antennas are one, which has no direct wave
# m: horns couple no more strongly than at this distance, for they are about as large and nearer than
# that not far from each other; assumed
_LEAST_OF_HORNS = 0.5


def port_directions(array: ArrayState, ray: FloatArray) -> FloatArray:
    """Return the directions of the field that the H and V ports send along rays.

    A dipole's is its moment, the same along every ray. A horn's is its direction on the axis,
    turned with the ray by the shortest way (Ludwig 1973, third definition): unlike "level" and
    "upright" it has a meaning beneath and beside the antenna, too. Ahead, in the plane of the
    axis, they are the same.

    Parameters
    ----------
    array : ArrayState
        The antennas.
    ray : ndarray (ray, 3)
        Unit vectors that leave the antenna.

    Returns
    -------
    ndarray (ray, 2, 3)
        Of the H and of the V port.
    """
    on_axis = np.stack([array.horizontal, array.vertical])
    if array.dipoles:
        return np.broadcast_to(on_axis, (len(ray), 2, 3)).copy()
    # Across the axis, which a tilt of the antennas turns out of the vertical.
    on_axis[1] = np.cross(array.horizontal, array.boresight)
    along_axis = np.maximum(1 + ray @ array.boresight, 1e-9)
    share = (ray @ on_axis.T) / along_axis[:, None]
    return on_axis - share[..., None] * (ray + array.boresight)[:, None]


def beam(array: ArrayState, ray: FloatArray, frequency: FloatArray, side_db: float) -> FloatArray:
    """Return the amplitude (ray, frequency) of the antennas' pattern along rays over the axis.

    Parameters
    ----------
    array : ArrayState
        The antennas.
    ray : ndarray (ray, 3)
        Unit vectors that leave the antenna.
    frequency : ndarray (frequency,)
        Tones, Hz.
    side_db : float
        Level over the axis below which a horn's pattern does not fall, dB.
    """
    if array.dipoles:  # their pattern is in the directions of their ports
        return np.ones((len(ray), frequency.size))
    cosine = np.maximum(ray @ array.boresight, 1e-9)[:, None]
    main = cosine ** (0.5 * array.exponents(frequency))
    return np.maximum(main, 10 ** (side_db / 20))


def path_transfer(
    array: ArrayState, distance: FloatArray, frequency: FloatArray, across: Any, along: Any
) -> Complex128Array:
    """Return what a path passes on, from ports to ports.

    Horns are far from each other, 0.5 m or more. A dipole's field is the closed form of a short dipole, near
    field included: ``1 + 1/(jkr) + 1/(jkr)²`` across the path and ``-2/(jkr) - 2/(jkr)²`` along it.

    Parameters
    ----------
    array : ArrayState
        The antennas.
    distance : ndarray (pair,)
        Length r of the path, m.
    frequency : ndarray (frequency,)
        Tones, Hz.
    across, along : ndarray (..., pair, frequency)
        Product of the ports' directions across the path and along it.
    """
    r = distance[:, None]
    turn = 2j * np.pi * frequency / SPEED_OF_LIGHT * r
    if array.dipoles:
        total = across * (1 + 1 / turn + 1 / turn**2) - 2 * along * (1 / turn + 1 / turn**2)
    else:
        total = across
        r = np.maximum(r, _LEAST_OF_HORNS)
    return math.sqrt(4 * math.pi) * total * np.exp(-turn) / r


def direct_wave(array: ArrayState, frequency: FloatArray, side_db: float) -> ComplexArray:
    """Return the wave that goes straight from each pair's transmitter to its receiver.

    Parameters
    ----------
    array : ArrayState
        The antennas.
    frequency : ndarray (frequency,)
        Tones, Hz.
    side_db : float
        As in :func:`beam`: horns beside each other meet by their sides.

    Returns
    -------
    ndarray (4, pair, frequency) of complex64
        HH, HV, VH and VV; zero in pairs whose antennas are in one place.
    """
    offset = array.position[array.rx] - array.position[array.tx]
    distance = np.linalg.norm(offset, axis=1)
    apart = distance > _SAME_PLACE
    distance = np.where(apart, distance, 1.0)
    ray = offset / distance[:, None]
    sent = port_directions(array, ray)
    taken = port_directions(array, -ray)
    along = np.einsum("pic,pc->ip", sent, ray)[:, None] * np.einsum("pjc,pc->jp", taken, ray)
    across = np.einsum("pic,pjc->ijp", sent, taken) - along
    patterns = beam(array, ray, frequency, side_db) * beam(array, -ray, frequency, side_db)
    patterns = patterns * apart[:, None]
    total = patterns * path_transfer(
        array, distance, frequency, across[..., None], along[..., None]
    )
    return total.reshape(4, *total.shape[2:]).astype(np.complex64)
