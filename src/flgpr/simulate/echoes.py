"""Echoes of single objects: rims of buried bodies, uprights, rocks, bushes, corner reflectors."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate import bodies
from flgpr.simulate.draw import stream
from flgpr.simulate.refraction import interface_path, reflection, refracted_ray
from flgpr.simulate.roughness import HeightField
from flgpr.simulate.scene import Soil, Target, Thing
from flgpr.simulate.spread import ArrayState, antenna_terms

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_UPRIGHT = np.array([1.0, 1.0, 0.0])


@dataclass
class Echoes:
    """Echoes to be summed: each a path per pair, a gain per antenna and a spectrum for HH, VV and cross."""

    path: list[FloatArray] = field(default_factory=list)
    place: list[FloatArray] = field(default_factory=list)
    spectrum: list[ComplexArray] = field(default_factory=list)

    def add(self, path: FloatArray, place: FloatArray, spectrum: ComplexArray) -> None:
        """Add an echo: ``path`` (pair,) m, ``place`` (3,) m for the antennas' gain, ``spectrum`` (3, frequency) m."""
        self.path.append(path)
        self.place.append(place)
        self.spectrum.append(np.broadcast_to(spectrum, (3, spectrum.shape[-1])))


class Ground:
    """The ground as the rays of one scan meet it.

    Parameters
    ----------
    soil : Soil
        Permittivity.
    heights : HeightField or None
        The rough interface; None is flat.
    frequency : (frequency,) ndarray
        Tones, Hz.
    """

    def __init__(self, soil: Soil, heights: HeightField | None, frequency: FloatArray) -> None:
        self.soil, self.heights, self.frequency = soil, heights, frequency
        self.wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
        centre = frequency[frequency.size // 2 : frequency.size // 2 + 1]
        self.media = soil.media(frequency)
        self.real = [float(eps[0].real) for eps in soil.media(centre)]

    def medium(self, depth: float) -> int:
        """Index of the layer that holds ``depth`` (m)."""
        passed = self.soil.passed(depth)
        return max(i for i, d in enumerate(passed) if d > 0 or i == 0)

    def reflection(self, sine: float) -> ComplexArray:
        """Reflection of the ground from above, H and V (2, frequency)."""
        return np.stack(reflection(sine, 1.0, self.media[0]))

    def entry_squared(self, sine: float, layer: int) -> ComplexArray:
        """t12² for H and V (2, frequency): into the given layer and, by reciprocity, out of it."""
        below = [np.ones_like(self.media[0]), *self.media[: layer + 1]]
        total = np.ones((2, self.frequency.size), complex)
        for upper, lower in itertools.pairwise(below):
            q1, q2 = np.sqrt(upper - sine**2), np.sqrt(lower - sine**2)
            total[0] *= 2 * q1 / (q1 + q2)
            total[1] *= 2 * np.sqrt(upper * lower) * q1 / (lower * q1 + upper * q2)
        return total**2

    def dispersion(self, sine: float, depth: float) -> ComplexArray:
        """Attenuation and phase against the path at the real index of the band's middle, both ways (frequency,)."""
        extra = sum(
            d * (np.sqrt(eps - sine**2) - math.sqrt(real - sine**2))
            for d, eps, real in zip(self.soil.passed(depth), self.media, self.real, strict=True)
        )
        return np.exp(-2j * self.wavenumber * extra)

    def path(self, antennas: FloatArray, points: FloatArray) -> FloatArray:
        """Path from antennas (n, 3) to buried points (n, 3), refracted and delayed by the rough interface, m."""
        flat = points[:, :2] - antennas[:, :2]
        distance = np.hypot(*flat.T)
        passed = [np.array(d) for d in zip(*(self.soil.passed(-z) for z in points[:, 2]), strict=True)]
        ray = refracted_ray(distance, antennas[:, 2], passed, self.real)
        if self.heights is None:
            return ray.path
        entry = points[:, :2] - flat * (ray.entry / np.maximum(distance, 1e-9))[:, None]
        return ray.path + interface_path(ray.sine, self.real[0]) * self.heights(entry[:, 0], entry[:, 1])


def add_target(echoes: Echoes, target: Target, ground: Ground, array: ArrayState) -> None:
    """Add a target's echoes: its rims below the ground, or its rims and its dihedral above."""
    profile = target.profile or bodies.cylinder(target.radius, target.height)
    if target.depth >= 0:
        _add_buried(echoes, target, profile, ground, array)
    else:
        _add_standing(echoes, target, profile, ground, array)


def _sine(x: float, y: float, z: float, array: ArrayState) -> float:
    offset = array.position.mean(axis=0) - np.array([x, y, z])
    return float(math.hypot(offset[0], offset[1]) / np.linalg.norm(offset))


def _bisectors(x: float, y: float, array: ArrayState) -> FloatArray:
    """Horizontal unit vectors from a place to the middle between each pair's antennas, as seen from it (pair, 2)."""
    out = array.position[:, :2] - np.array([x, y])
    out = out / np.linalg.norm(out, axis=1, keepdims=True)
    both = out[array.tx] + out[array.rx]
    return np.asarray(both / np.linalg.norm(both, axis=1, keepdims=True))


def _add_buried(echoes: Echoes, target: Target, profile: bodies.Profile, ground: Ground, array: ArrayState) -> None:
    """Add the near and far flash of every rim that is seen through the ground."""
    sine = _sine(target.x, target.y, 0.0, array)
    layer = ground.medium(target.depth)
    index = math.sqrt(ground.real[layer])
    towards = _bisectors(target.x, target.y, array)
    lean = math.tan(target.tilt) * np.array([math.sin(target.azimuth), math.cos(target.azimuth)])
    mean = towards.mean(axis=0)
    along, across = float(mean @ lean), float(mean @ np.array([lean[1], -lean[0]]))
    top = _top_reflection(target, sine, ground, layer)
    cover = _cover_factor(sine, target, top, ground) if layer == 0 else np.ones((2, 1))
    entry = ground.entry_squared(sine, layer)
    for rim in bodies.visible_rims(profile, min(sine / index, 0.999)):
        if target.dielectric is not None and rim.drop > 0:
            continue  # the layered reflection already holds the body's bottom
        side = 1.0 if rim.near else -1.0
        # The axis leans towards the radar: the near rim sinks, the far one rises.
        depth = max(target.depth + rim.drop + side * rim.radius * along, 0.0)
        point = np.empty((array.tx.size, 3))
        point[:, :2] = np.array([target.x, target.y]) + side * rim.radius * towards
        point[:, 2] = -depth
        path = ground.path(array.position[array.tx], point) + ground.path(array.position[array.rx], point)
        size = bodies.rim_amplitude(rim, index * ground.wavenumber, sine / index) * ground.dispersion(sine, depth)
        copolar = size * entry * top * np.array([[rim.h], [rim.v]])
        copolar = copolar * (cover if rim.drop == 0 and not rim.near else 1.0)
        place = np.array([target.x, target.y, -depth])
        echoes.add(path, place, _rotated(copolar, math.atan2(across, sine / index)))


def _top_reflection(target: Target, sine: float, ground: Ground, layer: int) -> ComplexArray:
    """Reflection of the target's top over that of metal, H and V, (2, frequency)."""
    if target.dielectric is None:
        return np.ones((2, ground.frequency.size), complex)
    around, body = ground.media[layer], np.full(ground.frequency.size, target.dielectric, complex)
    gap = min(target.air_gap, 0.9 * target.height)
    media = [around, *([np.ones_like(body)] if gap > 0 else []), body, around]
    thickness = [*([gap] if gap > 0 else []), target.height - gap]
    h, v = bodies.layered_reflection(sine, ground.wavenumber, media, thickness)
    return np.stack([-h, bodies.floor_vertical(h, v)])


def _cover_factor(sine: float, target: Target, top: ComplexArray, ground: Ground) -> ComplexArray:
    """Waves that bounce between the target's top and the surface on their way to the far rim and back.

    Each bounce ``r21·Γ·e^{-2jqd}`` starts ``2d·tanθ_t`` nearer the radar, where the top must reach: as many are summed
    as fit on the diameter, the last in part. The near rim has no top before it and sees none. Squared, for by
    reciprocity the way out has the same bounces as the way in.
    """
    normal = np.sqrt(ground.media[0] - sine**2)
    delay = np.exp(-2j * ground.wavenumber * normal * target.depth)
    bounce = -ground.reflection(sine) * top * np.array([[-1.0], [1.0]]) * delay
    shift = 2 * target.depth * sine / math.sqrt(ground.real[0] - sine**2)
    fitting = min(2 * target.radius / max(shift, 1e-9), 1e3)
    whole = math.floor(fitting)
    rest: ComplexArray = (1 - bounce ** (whole + 1)) / (1 - bounce) + (fitting - whole) * bounce ** (whole + 1)
    return rest**2


def _rotated(copolar: ComplexArray, angle: float) -> ComplexArray:
    """HH, VV and cross of an echo whose edge is turned about the ray by ``angle`` (rad)."""
    h, v = copolar
    c, s = math.cos(angle), math.sin(angle)
    return np.stack([c * c * h + s * s * v, s * s * h + c * c * v, s * c * (h - v)])


def _add_standing(echoes: Echoes, target: Target, profile: bodies.Profile, ground: Ground, array: ArrayState) -> None:
    """Add a target on the ground: the corner its wall makes with the ground, and the rims of its top."""
    height = min(-target.depth, profile[-1][1])
    radius = max(r for r, _ in profile)
    sine = _sine(target.x, target.y, 0.0, array)
    k = ground.wavenumber
    wall, top = np.ones((2, 1), complex), np.ones((2, 1), complex)
    if target.dielectric is not None:
        body = np.full(k.size, target.dielectric, complex)
        h, v = bodies.layered_reflection(math.sqrt(1 - sine**2), k, [np.ones_like(body), body], [])
        wall = np.stack([-h, v])
        h, v = bodies.layered_reflection(sine, k, [np.ones_like(body), body, ground.media[0]], [target.height])
        top = np.stack([-h, bodies.floor_vertical(h, v)])
    signs = np.array([[-1.0], [1.0]])
    corner = np.sqrt(k * radius * sine / (4 * np.pi)) * 2 * height * np.exp(-0.25j * np.pi)
    towards = _bisectors(target.x, target.y, array)
    _add_ring_point(
        echoes, target, radius, towards, 0.0, _level(corner * signs * ground.reflection(sine) * wall), array
    )
    for rim in bodies.visible_rims(profile, sine):
        if rim.drop > 0:
            continue
        size = bodies.rim_amplitude(rim, k, sine) * top * np.array([[rim.h], [rim.v]])
        reach = rim.radius if rim.near else -rim.radius
        _add_ring_point(echoes, target, reach, towards, height - rim.drop, _level(size), array)


def _level(copolar: ComplexArray) -> ComplexArray:
    return np.concatenate([copolar, np.zeros((1, copolar.shape[1]))])


def _add_ring_point(
    echoes: Echoes,
    target: Target | Thing,
    reach: float,
    towards: FloatArray,
    z: float,
    spectrum: ComplexArray,
    array: ArrayState,
) -> None:
    """Add an echo in air from the point of a ring that lies ``reach`` (m) towards the radar."""
    point = np.empty((array.tx.size, 3))
    point[:, :2] = np.array([target.x, target.y]) + reach * towards
    point[:, 2] = z
    echoes.add(_air_path(point, array), np.array([target.x, target.y, z]), spectrum)


def _air_path(point: FloatArray, array: ArrayState) -> FloatArray:
    out = np.linalg.norm(array.position[array.tx] - point, axis=-1)
    return np.asarray(out + np.linalg.norm(array.position[array.rx] - point, axis=-1))


def add_object(echoes: Echoes, thing: Thing, ground: Ground, array: ArrayState, seed: int) -> None:
    """Add an object's echoes; ``seed`` draws the inside of bushes."""
    {"rock": _add_rock, "post": _add_post, "bush": _add_bush, "fiducial": _add_fiducial}[thing.kind](
        echoes, thing, ground, array, seed
    )


def _add_rock(echoes: Echoes, thing: Thing, ground: Ground, array: ArrayState, seed: int) -> None:
    """Half-buried stone of permittivity 6: a small sphere's dipole that saturates at its optical cross section.

    The dipole and its image in the ground, half a radius up, echo together.
    """
    sine = _sine(thing.x, thing.y, 0.0, array)
    k, cosine = ground.wavenumber, math.sqrt(1 - sine**2)
    optical, dipole = ((math.sqrt(6) - 1) / (math.sqrt(6) + 1)) ** 2, ((6 - 1) / (6 + 2)) ** 2
    growth = 4 * dipole / optical * (k * thing.radius) ** 4
    size = thing.radius / 2 * np.sqrt(optical * growth / (1 + growth))
    r_h, r_v = ground.reflection(sine) * np.exp(-1j * k * thing.radius * cosine)
    copolar = np.stack([(1 + r_h) ** 2, (sine * (1 + r_v)) ** 2 + (cosine * (1 - r_v)) ** 2])
    rng = stream(seed, "rock", round(thing.x * 1000), round(thing.y * 1000))
    spectrum = _rotated(size * copolar, rng.normal(0, 0.2))
    point = np.tile([thing.x, thing.y, thing.radius / 2], (array.tx.size, 1))
    echoes.add(_air_path(point, array), point[0], spectrum)


def _add_post(echoes: Echoes, thing: Thing, ground: Ground, array: ArrayState, seed: int) -> None:  # noqa: ARG001
    """Upright cylinder on the ground: direct, image and corner echoes of its lit line, integrated over its height."""
    sine = _sine(thing.x, thing.y, thing.height / 2, array)
    k, cosine = ground.wavenumber, math.sqrt(1 - sine**2)
    line = np.sqrt(k * thing.radius * sine / (4 * np.pi)) * np.exp(-0.25j * np.pi)
    bounce = np.array([[-1.0], [1.0]]) * ground.reflection(sine)
    end = 1 / (2j * k * cosine)
    towards = _bisectors(thing.x, thing.y, array)
    parts = (
        (0.0, line * (2 * bounce * thing.height - (1 - bounce**2) * end)),
        (thing.height, np.broadcast_to(line * end, bounce.shape)),
        (-thing.height, -line * end * bounce**2),
    )
    for z, copolar in parts:
        _add_ring_point(echoes, thing, thing.radius, towards, z, _level(copolar), array)


def bush_scatterers(thing: Thing, seed: int, count: int = 24) -> tuple[FloatArray, ComplexArray]:
    """Scatter a bush's twigs.

    Parameters
    ----------
    thing : Thing
        The bush; its ``rcs_db`` at 1 GHz is the mean of HH.
    seed : int
        Seed of the world.
    count : int
        Number of scatterers.

    Returns
    -------
    points : (count, 3) ndarray
        Places, m.
    amplitude : (count, 3) ndarray of complex
        HH, VV and cross, m: independent, cross 6 dB down.
    """
    rng = stream(seed, "bush", round(thing.x * 1000), round(thing.y * 1000))
    place = rng.normal(0, 0.5, (count, 3)) * thing.radius
    place[:, 2] = rng.uniform(0.05, 1.0, count) * max(thing.height, 0.1)
    place[:, :2] += [thing.x, thing.y]
    level = 10 ** ((-10.0 if thing.rcs_db is None else thing.rcs_db) / 20) / math.sqrt(4 * np.pi * count)
    z = (rng.normal(size=(count, 3)) + 1j * rng.normal(size=(count, 3))) / math.sqrt(2)
    return place, z * level * np.array([1.0, 1.0, 0.5])


def _add_bush(echoes: Echoes, thing: Thing, ground: Ground, array: ArrayState, seed: int) -> None:
    """Twigs whose cross section grows by 5 dB per decade of frequency."""
    places, amplitude = bush_scatterers(thing, seed)
    growth = (ground.frequency / 1e9) ** 0.25
    for place, size in zip(places, amplitude, strict=True):
        echoes.add(_air_path(place[None, :], array), place, size[:, None] * growth)


def _add_fiducial(echoes: Echoes, thing: Thing, ground: Ground, array: ArrayState, seed: int) -> None:  # noqa: ARG001
    """Corner reflector: cross section growing as f², the same in HH and VV, 0 dBsm at 1 GHz unless given."""
    level = 10 ** ((thing.rcs_db or 0.0) / 20) / math.sqrt(4 * np.pi)
    point = np.array([[thing.x, thing.y, thing.height]])
    spectrum = level * (ground.frequency / 1e9) * _UPRIGHT[:, None]
    echoes.add(_air_path(point, array), point[0], spectrum.astype(complex))


def sum_echoes(echoes: Echoes, array: ArrayState, frequency: FloatArray) -> NDArray[np.complex64]:
    """Sum echoes over all pairs and tones.

    Parameters
    ----------
    echoes : Echoes
        The echoes.
    array : ArrayState
        The antennas.
    frequency : (frequency,) ndarray
        Uniform tones, Hz.

    Returns
    -------
    (3 or 4, pair, frequency) ndarray of complex64
        Channels as :class:`~flgpr.simulate.spread.Spreader` gives them.
    """
    out = np.zeros((4 if array.dipoles else 3, array.tx.size, frequency.size), np.complex64)
    if not echoes.path:
        return out
    place = np.array(echoes.place)
    shape = (len(array.position), len(place))
    gain = np.empty((shape[0], 3, shape[1]), np.float32)
    look = (array.boresight, array.horizontal, array.vertical, array.exponent)
    antenna_terms(place, array.position, *look, 0.0, np.empty(shape), np.empty(shape, np.complex64), gain)
    path = np.stack([np.broadcast_to(p, (array.tx.size,)) for p in echoes.path])
    spectrum = np.ascontiguousarray(np.stack(echoes.spectrum), dtype=np.complex64)
    step = (frequency[1] - frequency[0]) / SPEED_OF_LIGHT if frequency.size > 1 else 0.0
    _sum(path, spectrum, gain, array.tx, array.rx, frequency[0] / SPEED_OF_LIGHT, step, array.dipoles, out)
    return out * np.float32(math.sqrt(4 * np.pi))


@njit(parallel=True, cache=True, error_model="numpy")
def _sum(path: Any, spectrum: Any, gain: Any, tx: Any, rx: Any, first: Any, step: Any, mixed: Any, out: Any) -> None:
    tones = spectrum.shape[2]
    for q in prange(tx.shape[0]):
        a, b = tx[q], rx[q]
        for e in range(path.shape[0]):
            ah, av, aw = gain[a, 0, e], gain[a, 1, e], gain[a, 2, e]
            bh, bv, bw = gain[b, 0, e], gain[b, 1, e], gain[b, 2, e]
            turn = step * path[e, q]
            angle = -2 * math.pi * (turn - math.floor(turn))
            rotation = complex(math.cos(angle), math.sin(angle))
            carrier = 0j
            for k in range(tones):
                if k % 64 == 0:
                    turn = (first + k * step) * path[e, q]
                    angle = -2 * math.pi * (turn - math.floor(turn))
                    carrier = complex(math.cos(angle), math.sin(angle))
                h, v, x = spectrum[e, 0, k] * carrier, spectrum[e, 1, k] * carrier, spectrum[e, 2, k] * carrier
                if mixed:
                    out[0, q, k] += ah * bh * h + (ah * bv + av * bh) * x + av * bv * v
                    out[1, q, k] += ah * bw * x + av * bw * v
                    out[2, q, k] += aw * bh * x + aw * bv * v
                    out[3, q, k] += aw * bw * v
                else:
                    out[0, q, k] += ah * bh * h
                    out[1, q, k] += ah * bh * v
                    out[2, q, k] += ah * bh * x
                carrier *= rotation
