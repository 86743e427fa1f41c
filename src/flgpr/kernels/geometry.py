"""Optical path lengths from antennas to pixels, and delays and phasors computed from them.

Paths are computed in double precision: in single precision the rounding of a path of 20 m, 1 µm,
would turn the phase at 3 GHz by 6e-5 rad before anything else is rounded. The fraction of a turn
that is left without whole turns fits single precision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import float32, uint32, uint64

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared
from flgpr.kernels.layout import BLOCK

_TURN32 = 4294967296.0


@njit(inline="always", fastmath=True, error_model="numpy", cache=True)
def cos_sin(turns: Any) -> Any:
    """Return cosine and sine of 2π·turns, |turns| <= 1/2, by float32 polynomials that vectorise.

    They are the Taylor series about zero to the power 12 and 11, of angles up to π/2; larger ones
    are mirrored there.
    """
    size = abs(turns)
    far = size > float32(0.25)
    angle = float32(2 * math.pi) * (float32(0.5) - size if far else size)
    y = angle * angle
    c = float32(1 / 479001600)
    c = float32(-1 / 3628800) + y * c
    c = float32(1 / 40320) + y * c
    c = float32(-1 / 720) + y * c
    c = float32(1 / 24) + y * c
    c = float32(-0.5) + y * c
    c = float32(1) + y * c
    s = float32(-1 / 39916800)
    s = float32(1 / 362880) + y * s
    s = float32(-1 / 5040) + y * s
    s = float32(1 / 120) + y * s
    s = float32(-1 / 6) + y * s
    s = angle + angle * y * s
    return (-c if far else c), (-s if turns < 0 else s)


@njit(inline="always", fastmath=True, error_model="numpy", cache=True)
def straight_path(x: Any, y: Any, z: Any, index: Any) -> Any:
    """Return the optical length of the line (x, y, z) in a medium of a refractive index."""
    return index * math.sqrt(x * x + y * y + z * z)


@njit(inline="always", fastmath=True, error_model="numpy", cache=True)
def entry_distance(across: Any, height: Any, depth: Any, square: Any, bend: Any, steps: Any) -> Any:
    """Return the horizontal distance from a buried point to where its ray enters the ground.

    The point is ``depth`` below the surface, the ray begins ``height`` above it. With t the tangent
    of the angle of incidence, m the ratio of the refractive indices, ``square`` = m² and ``bend`` =
    m² - 1, Snell's law reads height·t + depth·t/sqrt(m² + (m²-1)·t²) = across. It is solved by
    Newton's ``steps``, in the precision of the arguments.
    """
    # The start: one fixed-point step from the straight line.
    t = across / (height + depth)
    t = across / (height + depth / math.sqrt(square + bend * t * t))
    for _ in range(steps):
        inner = square + bend * t * t
        root = math.sqrt(inner)
        t -= (height * t + depth * t / root - across) / (height + depth * square / (inner * root))
    return depth * t / math.sqrt(square + bend * t * t)


@njit(inline="always", fastmath=True, error_model="numpy", cache=True)
def bent_path(across: Any, height: Any, depth: Any, entry: Any, index: Any, ground: Any) -> Any:
    """Return the optical length of the ray that enters the ground ``entry`` from the point below.

    The length is stationary in the point of entry (Fermat's principle): an error there is one of
    second order here. ``index`` and ``ground`` are the refractive indices above and below.
    """
    air = across - entry
    return index * math.sqrt(height * height + air * air) + ground * math.sqrt(
        depth * depth + entry * entry
    )


@njit(fastmath=True, error_model="numpy", cache=True)
def antenna_rows(
    pixels: Any,
    first: Any,
    position: Any,
    medium: Any,
    per_turn: Any,
    carrier: Any,
    gain: Any,
    at: Any,
    delay: Any,
    cosine: Any,
    sine: Any,
) -> None:
    """Fill the delays and carrier phasors of one antenna for the block of pixels from ``first``.

    A delay is a 32-bit fraction of the ambiguous range: integer sums wrap as the range does.

    Parameters
    ----------
    pixels : (3, pixel) ndarray
        Pixels, m.
    first : int
        First pixel of the block.
    position : (3,) ndarray
        Position of the antenna, m.
    medium : (2,) ndarray
        Refractive indices above and below the surface z = 0, the second zero where there is no
        ground.
    per_turn, carrier : float
        Tone spacing and carrier over the speed of light, 1/m.
    gain : (pixel,) ndarray of float32
        Amplitudes of the antenna, or an empty array for one everywhere.
    at : int
        Entry of the outputs where the block begins.
    delay : ndarray of uint32
        Delays, filled.
    cosine, sine : ndarray of float32
        Carrier phasors times the amplitudes, filled.
    """
    index = medium[0]
    ground = medium[1]
    path = np.empty(BLOCK, np.float64)
    ax = position[0]
    ay = position[1]
    az = position[2]
    if ground > 0.0:
        square = (ground / index) ** 2
        square32 = float32(square)
        bend32 = float32(square - 1.0)
        for k in range(uint64(BLOCK)):
            p = first + k
            x, y, z = pixels[0, p] - ax, pixels[1, p] - ay, pixels[2, p]
            across = math.sqrt(x * x + y * y)
            height = az - max(z, 0.0)
            depth = max(-z, 0.0)
            # Single precision suffices: the path is stationary in the point of entry.
            entry = entry_distance(
                float32(across), float32(height), float32(depth), square32, bend32, 2
            )
            path[k] = bent_path(across, height, depth, entry, index, ground)
    else:
        for k in range(uint64(BLOCK)):
            p = first + k
            path[k] = straight_path(pixels[0, p] - ax, pixels[1, p] - ay, pixels[2, p] - az, index)
    for k in range(uint64(BLOCK)):
        turns = path[k] * per_turn
        delay[at + k] = uint32((turns - math.floor(turns)) * _TURN32)
        phase = path[k] * carrier
        c, s = cos_sin(float32(phase - math.floor(phase + 0.5)))
        cosine[at + k] = c
        sine[at + k] = s
    if gain.shape[0] > 0:
        for k in range(uint64(BLOCK)):
            cosine[at + k] *= gain[first + k]
            sine[at + k] *= gain[first + k]


@shared(axis=1, cache=True)
def antenna_paths(pixels, positions, medium, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill one-way optical paths, m, in double precision.

    Parameters
    ----------
    pixels : (3, pixel) ndarray
        Pixels, m.
    positions : (antenna, 3) ndarray
        Positions of the antennas, m.
    medium : (2,) ndarray
        Refractive indices above and below z = 0, the second zero where there is no ground.
    out : (antenna, pixel) ndarray
        Optical paths, m.
    begin, end : int
        Pixels of this call.
    """
    index = medium[0]
    ground = medium[1]
    square = (ground / index) ** 2
    for p in range(begin, end):
        for a in range(positions.shape[0]):
            x, y, z = pixels[0, p] - positions[a, 0], pixels[1, p] - positions[a, 1], pixels[2, p]
            if ground > 0.0:
                across = math.sqrt(x * x + y * y)
                height = positions[a, 2] - max(z, 0.0)
                depth = max(-z, 0.0)
                entry = entry_distance(across, height, depth, square, square - 1.0, 5)
                out[a, p] = bent_path(across, height, depth, entry, index, ground)
            else:
                out[a, p] = straight_path(x, y, z - positions[a, 2], index)
