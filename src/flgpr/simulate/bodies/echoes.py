"""Echoes of single objects: rims of buried bodies, uprights, rocks, bushes, corner reflectors."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.kernels.threads import shared
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.model.refraction import Ray, interface_path, reflection, refracted_ray
from flgpr.simulate.bodies import rims as bodies
from flgpr.simulate.ground.roughness import HeightField
from flgpr.simulate.radar.spread import ArrayState, antenna_terms
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import SceneObject, Soil, Target

_UPRIGHT = np.array([1.0, 1.0, 0.0])


@dataclass
class Echoes:
    """Echoes to be summed: each a path per pair, a gain per antenna, a spectrum, and its weight in each pair.

    Spectra have four rows: HH, VV, and the cross amplitudes' mean (HV + VH)/2 and half difference
    (HV - VH)/2; a weight has one row for the first three and one for the last.
    """

    path: list[FloatArray] = field(default_factory=list)
    place: list[FloatArray] = field(default_factory=list)
    spectrum: list[ComplexArray] = field(default_factory=list)
    weight: list[FloatArray] = field(default_factory=list)

    def add(
        self,
        path: FloatArray,
        place: FloatArray,
        spectrum: NDArray[Any],
        weight: FloatArray | None = None,
    ) -> None:
        """Add an echo: ``spectrum`` (3 or 4, frequency) m at ``place`` (3,), with ``weight`` (2, pair) or one."""
        whole = np.zeros((4, spectrum.shape[-1]), complex)
        whole[: 4 if len(spectrum) == 4 else 3] = spectrum
        self.path.append(path)
        self.place.append(place)
        self.spectrum.append(whole)
        self.weight.append(np.ones((2, path.size)) if weight is None else weight)


class Ground:
    """The ground as the rays of one scan meet it; without heights it is flat."""

    def __init__(self, soil: Soil, heights: HeightField | None, frequency: FloatArray) -> None:
        self.soil = soil
        self.heights = heights
        self.frequency = frequency
        self.wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
        centre = frequency[frequency.size // 2 : frequency.size // 2 + 1]
        self.media = soil.media(frequency)
        self.real = [float(eps[0].real) for eps in soil.media(centre)]

    def medium(self, depth: float) -> int:
        """Index of the layer that holds ``depth`` (m)."""
        passed = self.soil.thicknesses_above(depth)
        return max(i for i, d in enumerate(passed) if d > 0 or i == 0)

    def reflection(self, sine: float) -> ComplexArray:
        """Reflection of the ground from above, H and V (2, frequency)."""
        return np.stack(reflection(sine, 1.0, self.media[0]))

    def entry_squared(self, sine: float, layer: int) -> ComplexArray:
        """t12² for H and V (2, frequency): into the given layer and, by reciprocity, out of it."""
        below = [np.ones_like(self.media[0]), *self.media[: layer + 1]]
        total = np.ones((2, self.frequency.size), complex)
        for upper, lower in itertools.pairwise(below):
            q1 = np.sqrt(upper - sine**2)
            q2 = np.sqrt(lower - sine**2)
            total[0] *= 2 * q1 / (q1 + q2)
            total[1] *= 2 * np.sqrt(upper * lower) * q1 / (lower * q1 + upper * q2)
        return total**2

    def dispersion(self, sine: float, depth: float) -> ComplexArray:
        """Attenuation and phase against the path at the real index of the band's middle, both ways (frequency,)."""
        extra = sum(
            d * (np.sqrt(eps - sine**2) - math.sqrt(real - sine**2))
            for d, eps, real in zip(
                self.soil.thicknesses_above(depth), self.media, self.real, strict=True
            )
        )
        return np.exp(-2j * self.wavenumber * extra)

    def ray(self, antennas: FloatArray, points: FloatArray) -> Ray:
        """Rays from antennas (n, 3) to buried points (n, 3), refracted and delayed by the rough interface."""
        flat = points[:, :2] - antennas[:, :2]
        distance = np.hypot(*flat.T)
        passed = [
            np.array(d)
            for d in zip(*(self.soil.thicknesses_above(-z) for z in points[:, 2]), strict=True)
        ]
        ray = refracted_ray(distance, antennas[:, 2], passed, self.real)
        if self.heights is None:
            return ray
        entry = points[:, :2] - flat * (ray.entry / np.maximum(distance, 1e-9))[:, None]
        delay = interface_path(ray.sine, self.real[0]) * self.heights(entry[:, 0], entry[:, 1])
        return ray._replace(path=ray.path + delay)


def incidence(x: float, y: float, z: float, array: ArrayState) -> float:
    """Sine of the incidence angle of the array's middle at a place."""
    offset = array.position.mean(axis=0) - np.array([x, y, z])
    return float(math.hypot(offset[0], offset[1]) / np.linalg.norm(offset))


def bisectors(x: float, y: float, array: ArrayState) -> FloatArray:
    """Horizontal unit vectors from a place to the middle between each pair's antennas, as seen from it (pair, 2)."""
    out = array.position[:, :2] - np.array([x, y])
    out = out / np.linalg.norm(out, axis=1, keepdims=True)
    both = out[array.tx] + out[array.rx]
    return np.asarray(both / np.linalg.norm(both, axis=1, keepdims=True))


def rotated(copolar: NDArray[Any], angle: float) -> NDArray[Any]:
    """HH, VV and cross of an echo whose edge is turned about the ray by ``angle`` (rad)."""
    h, v = copolar
    c = math.cos(angle)
    s = math.sin(angle)
    return np.stack([c * c * h + s * s * v, s * s * h + c * c * v, s * c * (h - v)])


def add_standing(echoes: Echoes, target: Target, ground: Ground, array: ArrayState) -> None:
    """Add a target on the ground: the corner its wall makes with the ground, and the rims of its top."""
    radius, height = target.extent
    height = min(-target.depth, height)
    sine = incidence(target.x, target.y, 0.0, array)
    k = ground.wavenumber
    wall = np.ones((2, 1), complex)
    top = np.ones((2, 1), complex)
    if target.dielectric is not None:
        body = np.full(k.size, target.dielectric, complex)
        h, v = bodies.layered_reflection(math.sqrt(1 - sine**2), k, [np.ones_like(body), body], [])
        wall = np.stack([-h, v])
        # Edges of a dielectric have no Brewster angle; for want of a theory of strong contrasts V
        # is taken as H.
        h, _ = bodies.layered_reflection(
            sine, k, [np.ones_like(body), body, ground.media[0]], [target.height]
        )
        top = np.stack([-h, -h])
    signs = np.array([[-1.0], [1.0]])
    corner = np.sqrt(k * radius * sine / (4 * np.pi)) * 2 * height * np.exp(-0.25j * np.pi)
    towards = bisectors(target.x, target.y, array)
    corner = _level(corner * signs * ground.reflection(sine) * wall)
    _add_ring_point(echoes, target, radius, towards, 0.0, corner, array)
    for rim in bodies.visible_rims(target.outline, sine):
        if rim.drop > 0:
            continue
        size = bodies.rim_amplitude(rim, k, sine) * top * np.array([[rim.h], [rim.v]])
        reach = rim.radius if rim.near else -rim.radius
        _add_ring_point(echoes, target, reach, towards, height - rim.drop, _level(size), array)


def _level(copolar: ComplexArray) -> ComplexArray:
    return np.concatenate([copolar, np.zeros((1, copolar.shape[1]))])


def _add_ring_point(
    echoes: Echoes, target: Target | SceneObject, reach: float, towards: FloatArray, z: float, spectrum: ComplexArray,
    array: ArrayState,
) -> None:  # fmt: skip
    """Add an echo in air from the point of a ring that lies ``reach`` (m) towards the radar."""
    point = np.empty((array.tx.size, 3))
    point[:, :2] = np.array([target.x, target.y]) + reach * towards
    point[:, 2] = z
    echoes.add(_air_path(point, array), np.array([target.x, target.y, z]), spectrum)


def _air_path(point: FloatArray, array: ArrayState) -> FloatArray:
    out = np.linalg.norm(array.position[array.tx] - point, axis=-1)
    return np.asarray(out + np.linalg.norm(array.position[array.rx] - point, axis=-1))


def add_object(
    echoes: Echoes, thing: SceneObject, ground: Ground, array: ArrayState, seed: int
) -> None:
    """Add an object's echoes; ``seed`` draws the inside of bushes."""
    {"rock": _add_rock, "post": _add_post, "bush": _add_bush, "fiducial": _add_fiducial}[
        thing.kind
    ](echoes, thing, ground, array, seed)


def _add_rock(
    echoes: Echoes, thing: SceneObject, ground: Ground, array: ArrayState, seed: int
) -> None:
    """Half-buried stone of permittivity 6, its dipole saturating, and its image in the ground half a radius up."""
    sine = incidence(thing.x, thing.y, 0.0, array)
    k = ground.wavenumber
    cosine = math.sqrt(1 - sine**2)
    optical = ((math.sqrt(6) - 1) / (math.sqrt(6) + 1)) ** 2
    dipole = ((6 - 1) / (6 + 2)) ** 2
    growth = 4 * dipole / optical * (k * thing.radius) ** 4
    size = thing.radius / 2 * np.sqrt(optical * growth / (1 + growth))
    r_h, r_v = ground.reflection(sine) * np.exp(-1j * k * thing.radius * cosine)
    copolar = np.stack([(1 + r_h) ** 2, (sine * (1 + r_v)) ** 2 + (cosine * (1 - r_v)) ** 2])
    rng = stream(seed, "rock", round(thing.x * 1000), round(thing.y * 1000))
    spectrum = rotated(size * copolar, rng.normal(0, 0.2))
    point = np.tile([thing.x, thing.y, thing.radius / 2], (array.tx.size, 1))
    echoes.add(_air_path(point, array), point[0], spectrum)


def _add_post(
    echoes: Echoes, thing: SceneObject, ground: Ground, array: ArrayState, seed: int
) -> None:
    """Upright cylinder on the ground: direct, image and corner echoes of its lit line, integrated over its height."""
    sine = incidence(thing.x, thing.y, thing.height / 2, array)
    k = ground.wavenumber
    cosine = math.sqrt(1 - sine**2)
    line = np.sqrt(k * thing.radius * sine / (4 * np.pi)) * np.exp(-0.25j * np.pi)
    bounce = np.array([[-1.0], [1.0]]) * ground.reflection(sine)
    end = 1 / (2j * k * cosine)
    towards = bisectors(thing.x, thing.y, array)
    parts = (
        (0.0, line * (2 * bounce * thing.height - (1 - bounce**2) * end)),
        (thing.height, np.broadcast_to(line * end, bounce.shape)),
        (-thing.height, -line * end * bounce**2),
    )
    for z, copolar in parts:
        _add_ring_point(echoes, thing, thing.radius, towards, z, _level(copolar), array)


def bush_scatterers(
    thing: SceneObject, seed: int, count: int = 24
) -> tuple[FloatArray, ComplexArray]:
    """Scatter a bush's twigs: places (count, 3) and amplitudes (count, 3), m; cross 6 dB down, HH of ``rcs_db``."""
    rng = stream(seed, "bush", round(thing.x * 1000), round(thing.y * 1000))
    place = rng.normal(0, 0.5, (count, 3)) * thing.radius
    place[:, 2] = rng.uniform(0.05, 1.0, count) * max(thing.height, 0.1)
    place[:, :2] += [thing.x, thing.y]
    level = 10 ** ((-10.0 if thing.rcs_db is None else thing.rcs_db) / 20) / math.sqrt(
        4 * np.pi * count
    )
    z = (rng.normal(size=(count, 3)) + 1j * rng.normal(size=(count, 3))) / math.sqrt(2)
    return place, z * level * np.array([1.0, 1.0, 0.5])


def _add_bush(
    echoes: Echoes, thing: SceneObject, ground: Ground, array: ArrayState, seed: int
) -> None:
    """Twigs whose cross section grows by 5 dB per decade of frequency."""
    places, amplitude = bush_scatterers(thing, seed)
    growth = (ground.frequency / 1e9) ** 0.25
    for place, size in zip(places, amplitude, strict=True):
        echoes.add(_air_path(place[None, :], array), place, size[:, None] * growth)


def _add_fiducial(
    echoes: Echoes,
    thing: SceneObject,
    ground: Ground,
    array: ArrayState,
    seed: int,  # noqa: ARG001
) -> None:
    """Corner reflector: cross section growing as f², the same in HH and VV, 0 dBsm at 1 GHz unless given."""
    level = 10 ** ((thing.rcs_db or 0.0) / 20) / math.sqrt(4 * np.pi)
    point = np.array([[thing.x, thing.y, thing.height]])
    spectrum = level * (ground.frequency / 1e9) * _UPRIGHT[:, None]
    echoes.add(_air_path(point, array), point[0], spectrum.astype(complex))


def antenna_gains(places: FloatArray, array: ArrayState) -> NDArray[np.float32]:
    """Gain over distance of antennas towards places: (antenna, n, 3), H to h, H to v, V to v; less the narrowing."""
    shape = (len(array.position), len(places))
    gain = np.empty((*shape, 3), np.float32)
    exponent = 0.0 if array.growth > 0 else array.exponent
    look = (
        array.boresight,
        array.horizontal,
        array.vertical,
        exponent,
        np.empty((0, 0), np.float32),
    )
    unused = (np.empty(shape), np.empty(shape, np.complex64))
    antenna_terms(
        places, array.position, *look, 0.0, np.zeros(len(places)), np.zeros(3), *unused, gain
    )
    return gain


def sum_echoes(echoes: Echoes, array: ArrayState, frequency: FloatArray) -> NDArray[np.complex64]:
    """Sum echoes to (4, pair, frequency): HH, HV, VH, VV along the rays' directions, for dipoles the antennas'."""
    out = np.zeros((4, array.tx.size, frequency.size), np.complex64)
    if not echoes.path:
        return out
    place = np.array(echoes.place)
    gain = antenna_gains(place, array)
    ray = place - array.position[:, None]
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    cosine = np.log(np.maximum(ray @ array.boresight, 1e-6))
    path = np.stack([np.broadcast_to(p, (array.tx.size,)) for p in echoes.path])
    spectrum = np.ascontiguousarray(np.stack(echoes.spectrum), dtype=np.complex64)
    weight = np.stack([np.broadcast_to(w, (2, array.tx.size)) for w in echoes.weight]).astype(
        np.float32
    )
    step = (frequency[1] - frequency[0]) / SPEED_OF_LIGHT if frequency.size > 1 else 0.0
    tones = (frequency[0] / SPEED_OF_LIGHT, step, array.growth * SPEED_OF_LIGHT**2)
    moved = -(ray @ array.drift) / frequency.size  # path from tone to tone
    _sum(
        path, spectrum, weight, gain, cosine, moved, array.tx, array.rx, *tones, array.dipoles, out
    )
    return out * np.float32(math.sqrt(4 * np.pi))


@shared(axis=1, cache=True)
def _sum(  # type: ignore[no-untyped-def]
    path, spectrum, weight, gain, cosine, moved, tx, rx, first, step, growth, mixed, out, begin, end
):
    """Add up echoes tone by tone; phases and beams go on from tone to tone by their second differences."""
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
            rate = moved[a, e] + moved[b, e]
            angle = -4 * math.pi * step * rate
            bend = complex(math.cos(angle), math.sin(angle))
            off = 0.5 * (cosine[a, e] + cosine[b, e])
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
                x, y = even * spectrum[e, 2, k] * now, odd * spectrum[e, 3, k] * now
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
