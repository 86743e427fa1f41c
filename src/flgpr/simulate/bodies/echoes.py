"""Echoes of single bodies: one of them, the ground that their rays meet, and their sum."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flgpr.jit.threads import shared
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.refraction import Ray, interface_path, reflection, refracted_ray
from flgpr.simulate.ground.roughness import HeightField
from flgpr.simulate.radar.spread import ArrayState, antenna_terms
from flgpr.simulate.scene.scene import SceneObject, Soil, Target
from flgpr.types import (
    AnyArray,
    Complex128Array,
    ComplexArray,
    Float32Array,
    FloatArray,
    IndexArray,
)


class Echo(NamedTuple):
    """An echo to be summed over pairs and tones."""

    path: FloatArray  #: (pair,): electrical path out and back, m
    position: FloatArray  #: (3,): point at which the antennas' gains are taken, m
    #: (4, frequency): HH, VV, and the cross amplitudes' mean (HV + VH)/2 and half difference
    #: (HV - VH)/2, m
    spectrum: Complex128Array
    #: (2, pair or 1): of the first three amplitudes, and of the last
    weight: FloatArray = np.ones((2, 1))


def without_difference(spectrum: AnyArray) -> Complex128Array:
    """Return the four amplitudes of an echo of HH, VV and cross whose HV and VH are the same."""
    return np.concatenate([spectrum, np.zeros((1, spectrum.shape[-1]), complex)])


class LayeredGround:
    """The ground as the rays of one scan meet it.

    Parameters
    ----------
    soil : Soil
        The scene's table.
    heights : HeightField or None
        Heights that delay rays; without them the ground is flat.
    frequency : ndarray (frequency,)
        Tones, Hz.

    Attributes
    ----------
    wavenumber : ndarray (frequency,)
        In air, rad/m.
    tops : ndarray (layer,)
        Depths at which the layers begin, m.
    media : list of ndarray (frequency,)
        Complex permittivity of every layer.
    media_from_air : list of ndarray (frequency,)
        That of air before those of the layers.
    middle : int
        Number of the band's middle tone.
    real : list of float
        Real permittivity of every layer at the band's middle.
    """

    def __init__(self, soil: Soil, heights: HeightField | None, frequency: FloatArray) -> None:
        self.soil = soil
        self.tops = np.cumsum([0.0, *(layer.thickness for layer in soil.layers)])
        self.heights = heights
        self.frequency = frequency
        self.wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
        self.middle = frequency.size // 2
        centre = frequency[self.middle : self.middle + 1]
        self.media = soil.media(frequency)
        self.media_from_air = [np.ones_like(self.media[0]), *self.media]
        self.real = [float(eps[0].real) for eps in soil.media(centre)]

    def layer(self, depth: FloatArray) -> IndexArray:
        """Return the index of the layer that holds each depth, m."""
        return np.searchsorted(self.tops[1:], depth, side="left").astype(np.intp)

    def medium(self, depth: float) -> int:
        """Return the index of the layer that holds a depth, m."""
        return int(self.layer(np.array(depth)))

    def reflection(self, sine: float) -> Complex128Array:
        """Return the reflection of the ground from above, H and V (2, frequency)."""
        return np.stack(reflection(sine, 1.0, self.media[0]))

    def entry_squared(self, sine: float, layer: int) -> Complex128Array:
        """Return the transmission t² into a layer and out of it, H and V.

        It is the product of Fresnel's coefficients over all interfaces above, squared: by
        reciprocity the way out has the same one.

        Parameters
        ----------
        sine : float
            Sine of the angle of incidence in air.
        layer : int
            Index of the layer.

        Returns
        -------
        ndarray (2, frequency) of complex
            t² of H and of V.
        """
        total = np.ones((2, self.frequency.size), complex)
        for upper, lower in itertools.pairwise(self.media_from_air[: layer + 2]):
            q1 = np.sqrt(upper - sine**2)
            q2 = np.sqrt(lower - sine**2)
            total[0] *= 2 * q1 / (q1 + q2)
            total[1] *= 2 * np.sqrt(upper * lower) * q1 / (lower * q1 + upper * q2)
        return total**2

    def dispersion(self, sine: float, depth: float) -> Complex128Array:
        """Return attenuation and phase of the way to a depth and back, beyond the ray's path.

        The ray's path is that at the real index of the band's middle (:meth:`ray`).

        Parameters
        ----------
        sine : float
            Sine of the angle of incidence in air.
        depth : float
            Depth, m.

        Returns
        -------
        ndarray (frequency,) of complex
            Factor of the amplitude.
        """
        extra: Any = 0
        thicknesses = self.soil.thicknesses_above(depth)
        for thickness, eps, real in zip(thicknesses, self.media, self.real, strict=True):
            extra = extra + thickness * (np.sqrt(eps - sine**2) - math.sqrt(real - sine**2))
        return np.exp(-2j * self.wavenumber * extra)

    def rays(self, array: ArrayState, points: FloatArray) -> tuple[Ray, Ray]:
        """Return the rays to buried points (pair, 3), m, from transmitters and from receivers."""
        sent = self._ray(array.position[array.tx], points)
        return sent, self._ray(array.position[array.rx], points)

    def _ray(self, antennas: FloatArray, points: FloatArray) -> Ray:
        """Return the rays from antennas to points (n, 3), m, bent and delayed by the roughness."""
        level = points[:, :2] - antennas[:, :2]
        distance = np.hypot(level[:, 0], level[:, 1])
        thicknesses = np.array([self.soil.thicknesses_above(-z) for z in points[:, 2]])
        ray = refracted_ray(distance, antennas[:, 2], list(thicknesses.T), self.real)
        if self.heights is None:
            return ray
        from_point = ray.entry / np.maximum(distance, 1e-9)  # share of the level distance
        entry = points[:, :2] - level * from_point[:, None]
        height = self.heights(entry[:, 0], entry[:, 1])
        delay = interface_path(ray.sine, self.real[0]) * height
        return ray._replace(path=ray.path + delay)


def incidence(x: float, y: float, z: float, array: ArrayState) -> float:
    """Return the sine of the angle of incidence at a point, m, from the middle of the array."""
    offset = array.position.mean(axis=0) - np.array([x, y, z])
    return float(math.hypot(offset[0], offset[1]) / np.linalg.norm(offset))


def bisectors(x: float, y: float, array: ArrayState) -> FloatArray:
    """Return the directions from a point to the middle between each pair's antennas.

    Parameters
    ----------
    x, y : float
        Point, m.
    array : ArrayState
        The antennas.

    Returns
    -------
    ndarray (pair, 2)
        Horizontal unit vectors; the middle is that of the directions, as seen from the point.
    """
    direction = array.position[:, :2] - np.array([x, y])
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    total = direction[array.tx] + direction[array.rx]
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def ring_points(
    body: Target | SceneObject, reach: float, towards: FloatArray, z: float
) -> FloatArray:
    """Return the point of a body's ring that every pair sees (pair, 3), m.

    It lies ``reach`` from the body's axis along the pair's direction ``towards`` (pair, 2).
    """
    points = np.empty((len(towards), 3))
    points[:, :2] = np.array([body.x, body.y]) + reach * towards
    points[:, 2] = z
    return points


def rotated(copolar: AnyArray, angle: float) -> AnyArray:
    """Return HH, VV and cross of an echo whose edge is turned about the ray.

    Parameters
    ----------
    copolar : ndarray (2, frequency)
        HH and VV of the level edge.
    angle : float
        Turn, rad.
    """
    h, v = copolar
    c = math.cos(angle)
    s = math.sin(angle)
    hh = c * c * h + s * s * v
    vv = s * s * h + c * c * v
    cross = s * c * (h - v)
    return np.stack([hh, vv, cross])


def antenna_gains(points: FloatArray, array: ArrayState) -> Float32Array:
    """Return the antennas' gains over distance towards points, without the beam's narrowing.

    Parameters
    ----------
    points : ndarray (n, 3)
        Points in the lane frame, m.
    array : ArrayState
        The antennas.

    Returns
    -------
    ndarray (antenna, n, 3)
        H to h, H to v and V to v.
    """
    shape = (len(array.position), len(points))
    gain = np.empty((*shape, 3), np.float32)
    exponent = 0.0 if array.growth > 0 else array.exponent
    no_beams = np.empty((0, 0), np.float32)
    # Delays and carriers are of no interest here.
    wavenumber = 0.0
    extra = np.zeros(len(points))
    drift = np.zeros(3)
    distance = np.empty(shape)
    phasor = np.empty(shape, np.complex64)
    antenna_terms(
        points,
        array.position,
        array.boresight,
        array.horizontal,
        array.vertical,
        exponent,
        no_beams,
        wavenumber,
        extra,
        drift,
        distance,
        phasor,
        gain,
    )
    return gain


def sum_echoes(echoes: Sequence[Echo], array: ArrayState, frequency: FloatArray) -> ComplexArray:
    """Sum echoes over all pairs and tones.

    Parameters
    ----------
    echoes : sequence of Echo
        The echoes.
    array : ArrayState
        The antennas.
    frequency : ndarray (frequency,)
        Evenly spaced tones, Hz.

    Returns
    -------
    ndarray (4, pair, frequency) of complex64
        HH, HV, VH and VV along the rays' directions, for dipoles along the antennas'.
    """
    out = np.zeros((4, array.tx.size, frequency.size), np.complex64)
    if not echoes:
        return out
    position = np.array([echo.position for echo in echoes])
    gain = antenna_gains(position, array)
    ray = position - array.position[:, None]
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    # A beam cos^(n/2) whose n grows with f² is exp(n/2·log cos).
    log_cosine = np.log(np.maximum(ray @ array.boresight, 1e-6))

    path = np.stack([echo.path for echo in echoes])
    spectrum = np.stack([echo.spectrum for echo in echoes]).astype(np.complex64)
    weights = [np.broadcast_to(echo.weight, (2, array.tx.size)) for echo in echoes]
    weight = np.stack(weights).astype(np.float32)

    first = frequency[0] / SPEED_OF_LIGHT
    step = (frequency[1] - frequency[0]) / SPEED_OF_LIGHT if frequency.size > 1 else 0.0
    growth = array.growth * SPEED_OF_LIGHT**2
    # How much longer the path of each antenna gets from tone to tone of a sweep in motion.
    path_rate = -(ray @ array.drift) / frequency.size
    _sum(
        path,
        spectrum,
        weight,
        gain,
        log_cosine,
        path_rate,
        array.tx,
        array.rx,
        first,
        step,
        growth,
        array.dipoles,
        out,
    )
    return out * np.float32(math.sqrt(4 * np.pi))


@shared(axis=1, cache=True)
def _sum(  # type: ignore[no-untyped-def]
    path,
    spectrum,
    weight,
    gain,
    log_cosine,
    path_rate,
    tx,
    rx,
    first,
    step,
    growth,
    mixed,
    out,
    begin,
    end,
):
    """Add up echoes tone by tone.

    Phases and beams advance from tone to tone by their second differences, and are computed anew
    every 64 tones, so that rounding does not build up.

    Parameters
    ----------
    path : (echo, pair) ndarray
        Electrical paths, m.
    spectrum : (echo, 4, frequency) ndarray of complex64
        Amplitudes HH, VV, (HV + VH)/2 and (HV - VH)/2, m.
    weight : (echo, 2, pair) ndarray of float32
        Weights of the first three rows and of the last.
    gain : (antenna, echo, 3) ndarray of float32
        Gains over distance, H to h, H to v and V to v.
    log_cosine : (antenna, echo) ndarray
        Logarithm of the cosine off the boresight.
    path_rate : (antenna, echo) ndarray
        Growth of an antenna's path from tone to tone of a sweep in motion, m.
    tx, rx : (pair,) ndarray of int
        Antennas of every pair.
    first, step : float
        First tone and spacing over the speed of light, 1/m.
    growth : float
        Growth of the beam's exponent with the squared wavenumber, m²; zero for none.
    mixed : bool
        Whether the antennas mix H and V, as dipoles do.
    out : (4, pair, frequency) ndarray of complex64
        HH, HV, VH and VV, which are added to.
    begin, end : int
        Pairs of this call.
    """
    tones = spectrum.shape[2]
    middle = tones // 2
    for q in range(begin, end):
        a = tx[q]
        b = rx[q]
        for e in range(path.shape[0]):
            ah = gain[a, e, 0]
            av = gain[a, e, 1]
            aw = gain[a, e, 2]
            bh = gain[b, e, 0]
            bv = gain[b, e, 1]
            bw = gain[b, e, 2]
            even = weight[e, 0, q]
            odd = weight[e, 1, q]
            rate = path_rate[a, e] + path_rate[b, e]
            angle = -4 * math.pi * step * rate
            bend = complex(math.cos(angle), math.sin(angle))
            off = 0.5 * (log_cosine[a, e] + log_cosine[b, e])
            narrowing = math.exp(off * 2 * growth * step * step)
            rotation = 0j
            carrier = 0j
            beam = 1.0
            narrower = 1.0
            for k in range(tones):
                if k % 64 == 0:
                    wave = first + k * step
                    turn = wave * (path[e, q] + rate * (k - middle))
                    angle = -2 * math.pi * (turn - math.floor(turn))
                    carrier = complex(math.cos(angle), math.sin(angle))
                    turn = step * path[e, q] + rate * (wave + step * (k + 1 - middle))
                    angle = -2 * math.pi * (turn - math.floor(turn))
                    rotation = complex(math.cos(angle), math.sin(angle))
                    if growth > 0:
                        beam = math.exp(off * (growth * wave * wave - 1))
                        narrower = math.exp(off * growth * step * (2 * wave + step))
                now = carrier * min(beam, 1.0) if growth > 0 else carrier
                h = even * spectrum[e, 0, k] * now
                v = even * spectrum[e, 1, k] * now
                x = even * spectrum[e, 2, k] * now
                y = odd * spectrum[e, 3, k] * now
                if mixed:
                    out[0, q, k] += (
                        ah * bh * h + ah * bv * (x + y) + av * bh * (x - y) + av * bv * v
                    )
                    out[1, q, k] += ah * bw * (x + y) + av * bw * v
                    out[2, q, k] += aw * bh * (x - y) + aw * bv * v
                    out[3, q, k] += aw * bw * v
                else:
                    out[0, q, k] += ah * bh * h
                    out[1, q, k] += ah * bh * (x + y)
                    out[2, q, k] += ah * bh * (x - y)
                    out[3, q, k] += ah * bh * v
                carrier *= rotation
                rotation *= bend
                beam *= narrower
                narrower *= narrowing
