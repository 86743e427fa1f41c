"""Shadows of upright objects by diffraction at strips: deep at high tones, weak at low ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import fresnel

from flgpr.jit.compiled import njit
from flgpr.jit.threads import share
from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.scene import SceneObject, Target
from flgpr.types import Complex128Array, ComplexArray, FloatArray

_NODES = 5  # frequencies at which the shadow on a body is known; linear between them
_PAIRS = 8  # pairs over which a shadow is averaged
_REACH = 6.0  # argument beyond which the Fresnel integral is taken as one or zero
_FINE = 128  # its samples per unit
_LEAST = 0.05  # change of the two-way amplitude that counts
_MANY = 500  # points from which on threads share them: waking threads takes longer than few points
_LOWEST_ROCK = 0.05  # m: lower rocks throw no shadow
_SINE, _COSINE = fresnel(np.linspace(-_REACH, _REACH, round(2 * _REACH * _FINE) + 1))
_TABLE = (_COSINE - 1j * _SINE) / (1 - 1j) + 0.5  # G(v), see Shadows


class Strip(NamedTuple):
    """An upright that rays must pass, ``radius`` to either side of its middle."""

    x: float  #: position in the lane frame, m
    y: float
    bottom: float  #: height above the lane's plane, m
    top: float  #: height above the lane's plane, m
    radius: float  #: m
    foliage: float = math.inf  #: one-way loss across its middle at 0.87 GHz, dB; infinite: opaque


def shadow_strips(
    targets: Iterable[Target], objects: Iterable[SceneObject], ground: Any, foliage: float
) -> list[Strip]:
    """Return the strips of what throws shadows.

    These are metal bodies on the ground, posts, bushes, and rocks of more than 5 cm radius.

    Parameters
    ----------
    targets : iterable of Target
        Targets of the world.
    objects : iterable of SceneObject
        All else that stands there.
    ground : callable
        Height of the ground at x and y, m.
    foliage : float
        One-way loss of a bush at 0.87 GHz over its mean chord, dB/m.

    Returns
    -------
    list of Strip
        Strips, those of targets first.
    """
    strips = []
    for target in targets:
        if target.depth < 0 and target.dielectric is None:
            z = float(ground(target.x, target.y))
            top = z - target.depth
            strips.append(Strip(target.x, target.y, z, top, target.extent[0]))
    for scene_object in objects:
        if scene_object.kind == "fiducial":
            continue
        height = scene_object.height
        lowest = 0.0
        if scene_object.kind == "rock":
            height = scene_object.radius  # half of it is buried
            lowest = _LOWEST_ROCK
        if height <= lowest:
            continue
        loss = math.inf
        if scene_object.kind == "bush":
            loss = foliage * math.pi / 2 * scene_object.radius  # mean chord of a circle
        x = scene_object.x
        y = scene_object.y
        z = float(ground(x, y))
        strips.append(Strip(x, y, z, z + height, scene_object.radius, loss))
    return strips


class Shadows:
    """The shadows that a scan's antennas see.

    Behind a strip from the ground up the field of an antenna is
    ``1 - (1 - T)·[G(v2) - G(v1)]·G(u)`` of the free one, with the Fresnel integral
    ``G(v) = ∫_{-∞}^{v} exp(-jπt²/2) dt/(1 - j)``, v1 and v2 of its sides and u of its top in units
    of ``sqrt(λ·d1·d2/(2(d1 + d2)))`` across the ray, and T what passes it (Babinet's principle in
    Kirchhoff's approximation: Born & Wolf 1999, Sec. 8.7-8.8; Deygout's several edges multiply).
    Two-way it is the mean product of transmitter's and receiver's factor over the pairs, which is
    what an image focused there has.

    Parameters
    ----------
    strips : iterable of Strip
        What throws shadows.
    array : ArrayState
        The antennas.
    frequency : ndarray (frequency,)
        Tones, Hz.
    """

    def __init__(self, strips: Iterable[Strip], array: ArrayState, frequency: FloatArray) -> None:
        self._frequency = frequency
        stride = max(1, math.ceil(array.tx.size / _PAIRS))
        antennas = np.concatenate([array.tx[::stride], array.rx[::stride]])
        used, index = np.unique(antennas, return_inverse=True)
        self._antennas = array.position[used]
        self._tx, self._rx = np.split(index, 2)
        self._strips = np.array([s[:5] for s in strips]).reshape(-1, 5)
        self._foliage = np.array([s.foliage for s in strips])

    def darken(self, values: ComplexArray, points: FloatArray, nodes: FloatArray) -> None:
        """Multiply amplitudes by the two-way factors of all strips, in place.

        Parameters
        ----------
        values : ndarray (point, channel, node) of complex64
            Amplitudes.
        points : ndarray (point, 3)
            Their positions in the lane frame, m.
        nodes : ndarray (node,)
            Frequencies, Hz.
        """
        if not len(self._strips):
            return
        # The loss of foliage in dB grows with the root of the frequency.
        passed = 10 ** (-self._foliage[:, None] * np.sqrt(nodes / 0.87e9) / 20)
        shade = partial(
            _shade,
            points,
            self._antennas,
            self._tx,
            self._rx,
            self._strips,
            passed,
            SPEED_OF_LIGHT / nodes,
            _TABLE,
            values,
        )
        share(len(points), shade, alone=len(points) <= _MANY)

    def factors(self, points: FloatArray, nodes: FloatArray) -> ComplexArray:
        """Return the two-way factors (point, node) of the field at points (point, 3)."""
        out = np.ones((len(points), 1, len(nodes)), np.complex64)
        self.darken(out, points, nodes)
        return out[:, 0]

    def body_factor(self, point: FloatArray) -> Complex128Array:
        """Return the two-way factor (frequency,) of the field at one point (3,) for every tone."""
        f = self._frequency
        nodes = np.geomspace(f[0], f[-1], _NODES) if f.size > 1 else f
        factor = self.factors(point[None, :], nodes)[0]
        real = np.interp(f, nodes, factor.real)
        imaginary = np.interp(f, nodes, factor.imag)
        return real + 1j * imaginary


@njit(cache=True, inline="always")
def _fresnel(v: Any, table: Any) -> Any:
    """Return G(v), linear between the table's samples.

    Its last ripples, below 5 %, are left out.
    """
    if v >= 6.0:
        return 1.0 + 0j
    if v <= -6.0:
        return 0j
    position = (v + 6.0) * 128
    cell = int(position)
    return table[cell] + (position - cell) * (table[cell + 1] - table[cell])


@njit(cache=True)
def _strip_factor(
    point: Any, antenna: Any, strip: Any, passed: Any, wavelength: Any, table: Any, out: Any
) -> None:
    """Fill ``out`` (node,) with the factor of the field from an antenna to a point past a strip.

    The formula is that of :class:`Shadows`. ``passed`` (node,) is T.
    """
    out[:] = 1.0
    dx = point[0] - antenna[0]
    dy = point[1] - antenna[1]
    flat = math.sqrt(dx * dx + dy * dy)
    sx = strip[0] - antenna[0]
    sy = strip[1] - antenna[1]
    along = (sx * dx + sy * dy) / flat
    if along <= 0 or flat - along <= strip[4]:
        return
    across = (sx * dy - sy * dx) / flat
    fraction = along / flat
    dz = point[2] - antenna[2]
    slant = math.sqrt(flat * flat + dz * dz)
    above = (strip[3] - antenna[2] - fraction * dz) * flat / slant
    for n in range(wavelength.size):
        scale = math.sqrt(2 / (wavelength[n] * slant * fraction * (1 - fraction)))
        width = _fresnel((across + strip[4]) * scale, table) - _fresnel(
            (across - strip[4]) * scale, table
        )
        out[n] = 1 - (1 - passed[n]) * width * _fresnel(above * scale, table)


@njit(nogil=True, cache=True, error_model="numpy")
def _shade(points, antennas, tx, rx, strips, passed, wavelength, table, out, begin, end):  # type: ignore[no-untyped-def]
    """Multiply amplitudes by the two-way factor of every strip.

    A factor is the mean over pairs of the product of both ways. Strips that surely change a point's
    amplitude by less than ``_LEAST`` are left out.

    Parameters
    ----------
    points : (point, 3) ndarray
        Points, m.
    antennas : (antenna, 3) ndarray
        Positions of the antennas, m.
    tx, rx : (pair,) ndarray of int
        Antennas of every pair.
    strips : (strip, 5) ndarray
        Strips without their foliage.
    passed : (strip, node) ndarray
        Share of the amplitude that passes a strip, T.
    wavelength : (node,) ndarray
        Wavelengths, m.
    table : ndarray of complex
        Samples of the Fresnel integral G.
    out : (point, channel, node) ndarray of complex64
        Amplitudes.
    begin, end : int
        Points of this call.
    """
    cx = antennas[:, 0].mean()
    cy = antennas[:, 1].mean()
    cz = antennas[:, 2].mean()
    aperture = np.abs(antennas[:, 0] - cx).max() + np.abs(antennas[:, 1] - cy).max()
    # One Fresnel zone of the lowest frequency at its widest, and the spread of the antennas as seen
    # past the strip.
    longest = wavelength.max()
    distance = np.hypot(strips[:, 0] - cx, strips[:, 1] - cy)
    reach = strips[:, 4] + np.sqrt(longest * distance) + aperture
    for i in range(begin, end):
        dx = points[i, 0] - cx
        dy = points[i, 1] - cy
        dz = points[i, 2] - cz
        flat = math.sqrt(dx * dx + dy * dy)
        ux = dx / flat
        uy = dy / flat
        for s in range(strips.shape[0]):
            sx = strips[s, 0] - cx
            sy = strips[s, 1] - cy
            across = abs(sx * uy - sy * ux)
            fraction = (sx * ux + sy * uy) / flat
            if across > reach[s] or fraction <= 0 or (1 - fraction) * flat <= strips[s, 4]:
                continue
            zone = math.sqrt(longest * flat * fraction * (1 - fraction))
            below = cz + fraction * dz - strips[s, 3]
            if below > zone or across > strips[s, 4] + zone + aperture * (1 - fraction):
                continue
            # |G(v2) - G(v1)| <= (v2 - v1)/√2 and |G(u)| <= 1/(√2·π|u|) bound what a low or thin
            # strip takes away.
            if 2 * strips[s, 4] < _LEAST * math.pi * below:
                continue
            one_way = np.empty((antennas.shape[0], wavelength.size), np.complex128)
            for a in range(antennas.shape[0]):
                _strip_factor(
                    points[i], antennas[a], strips[s], passed[s], wavelength, table, one_way[a]
                )
            for n in range(wavelength.size):
                total = 0j
                for q in range(tx.size):
                    total += one_way[tx[q], n] * one_way[rx[q], n]
                for c in range(out.shape[1]):
                    out[i, c, n] *= total / tx.size
