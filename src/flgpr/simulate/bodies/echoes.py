"""Echoes of single objects: rims of bodies on the ground, uprights, rocks, bushes, reflectors."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.jit.threads import shared
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.model.refraction import Ray, interface_path, reflection, refracted_ray
from flgpr.simulate.bodies import rims as bodies
from flgpr.simulate.ground.roughness import HeightField
from flgpr.simulate.radar.spread import ArrayState, antenna_terms
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import SceneObject, Soil, Target

_COPOLAR = np.array([1.0, 1.0, 0.0])
# Reflection of H and V by a perfectly conducting wall.
_CONDUCTOR = np.array([[-1.0], [1.0]])


@dataclass
class Echoes:
    """Echoes to be summed: a path per pair, a position, a spectrum and a weight per pair for each.

    Spectra have four rows: HH, VV, and the cross amplitudes' mean (HV + VH)/2 and half difference
    (HV - VH)/2. A weight has one row for the first three and one for the last.
    """

    path: list[FloatArray] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    spectrum: list[ComplexArray] = field(default_factory=list)
    weight: list[FloatArray] = field(default_factory=list)

    def add(
        self,
        path: FloatArray,
        position: FloatArray,
        spectrum: NDArray[Any],
        weight: FloatArray | None = None,
    ) -> None:
        """Add an echo.

        Parameters
        ----------
        path : ndarray (pair,) or (1,)
            Electrical path out and back, m.
        position : ndarray (3,)
            Point at which the antennas' gains are taken, m.
        spectrum : ndarray (3 or 4, frequency)
            Amplitudes, m; a missing fourth row is zero.
        weight : ndarray (2, pair), optional
            1 in every pair unless given.
        """
        four_rows = np.zeros((4, spectrum.shape[-1]), complex)
        four_rows[: 4 if len(spectrum) == 4 else 3] = spectrum
        if weight is None:
            weight = np.ones((2, path.size))
        self.path.append(path)
        self.position.append(position)
        self.spectrum.append(four_rows)
        self.weight.append(weight)


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
    media : list of ndarray (frequency,)
        Complex permittivity of every layer.
    real : list of float
        Real permittivity of every layer at the band's middle.
    """

    def __init__(self, soil: Soil, heights: HeightField | None, frequency: FloatArray) -> None:
        self.soil = soil
        self.heights = heights
        self.frequency = frequency
        self.wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
        middle = frequency.size // 2
        centre = frequency[middle : middle + 1]
        self.media = soil.media(frequency)
        self.real = [float(eps[0].real) for eps in soil.media(centre)]

    def medium(self, depth: float) -> int:
        """Return the index of the layer that holds a depth, m."""
        deepest = 0
        for index, thickness in enumerate(self.soil.thicknesses_above(depth)):
            if thickness > 0:
                deepest = index
        return deepest

    def reflection(self, sine: float) -> ComplexArray:
        """Return the reflection of the ground from above, H and V (2, frequency)."""
        return np.stack(reflection(sine, 1.0, self.media[0]))

    def entry_squared(self, sine: float, layer: int) -> ComplexArray:
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
        media = [np.ones_like(self.media[0]), *self.media[: layer + 1]]
        total = np.ones((2, self.frequency.size), complex)
        for upper, lower in itertools.pairwise(media):
            q1 = np.sqrt(upper - sine**2)
            q2 = np.sqrt(lower - sine**2)
            total[0] *= 2 * q1 / (q1 + q2)
            total[1] *= 2 * np.sqrt(upper * lower) * q1 / (lower * q1 + upper * q2)
        return total**2

    def dispersion(self, sine: float, depth: float) -> ComplexArray:
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

    def ray(self, antennas: FloatArray, points: FloatArray) -> Ray:
        """Return the rays from antennas to buried points, refracted and delayed by the roughness.

        Parameters
        ----------
        antennas, points : ndarray (n, 3)
            Ends of each ray, m.

        Returns
        -------
        Ray
            Path, sine and point of entry of each ray.
        """
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
    return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def rotated(copolar: NDArray[Any], angle: float) -> NDArray[Any]:
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


def add_standing(echoes: Echoes, target: Target, ground: LayeredGround, array: ArrayState) -> None:
    """Add a target on the ground.

    Its echoes are that of the corner which its wall makes with the ground, and those of the rims of
    its top.
    """
    radius, height = target.extent
    height = min(-target.depth, height)
    sine = incidence(target.x, target.y, 0.0, array)
    k = ground.wavenumber
    wall, top = _standing_reflections(target, ground, sine)
    towards = bisectors(target.x, target.y, array)

    # The cylinder's wall by stationary phase; twice, as waves meet wall and ground in either order.
    wall_amplitude = np.sqrt(k * radius * sine / (4 * np.pi)) * 2 * height * np.exp(-0.25j * np.pi)
    corner = _without_cross(wall_amplitude * _CONDUCTOR * ground.reflection(sine) * wall)
    _add_ring_point(echoes, target, radius, towards, 0.0, corner, array)

    for rim in bodies.visible_rims(target.outline, sine):
        if rim.drop > 0:
            continue
        edge = np.array([[rim.h], [rim.v]])
        size = bodies.rim_amplitude(rim, k, sine) * top * edge
        reach = rim.radius if rim.is_near else -rim.radius
        z = height - rim.drop
        _add_ring_point(echoes, target, reach, towards, z, _without_cross(size), array)


def _standing_reflections(
    target: Target, ground: LayeredGround, sine: float
) -> tuple[ComplexArray, ComplexArray]:
    """Return what a standing target's wall and top reflect of what metal does, H and V."""
    if target.dielectric is None:
        return np.ones((2, 1), complex), np.ones((2, 1), complex)
    k = ground.wavenumber
    body = np.full(k.size, target.dielectric, complex)
    air = np.ones_like(body)
    h, v = bodies.layered_reflection(math.sqrt(1 - sine**2), k, [air, body], [])
    wall = np.stack([-h, v])
    # Edges of a dielectric have no Brewster angle; for want of a theory of strong contrasts V is
    # taken as H.
    h, _ = bodies.layered_reflection(sine, k, [air, body, ground.media[0]], [target.height])
    top = np.stack([-h, -h])
    return wall, top


def _without_cross(copolar: ComplexArray) -> ComplexArray:
    """Return HH, VV and a cross amplitude of zero."""
    return np.concatenate([copolar, np.zeros((1, copolar.shape[1]))])


def _add_ring_point(
    echoes: Echoes,
    target: Target | SceneObject,
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
    """Return the paths (pair,) in air by way of points (pair or 1, 3), m."""
    sent = np.linalg.norm(array.position[array.tx] - point, axis=-1)
    taken = np.linalg.norm(array.position[array.rx] - point, axis=-1)
    return np.asarray(sent + taken)


def add_object(
    echoes: Echoes, scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int
) -> None:
    """Add an object's echoes.

    Parameters
    ----------
    echoes : Echoes
        Where they are added.
    scene_object : SceneObject
        The object.
    ground : LayeredGround
        The ground that it stands on.
    array : ArrayState
        The antennas, their heights counted from that ground.
    seed : int
        Draws the tilt of rocks and the twigs of bushes.
    """
    if scene_object.kind == "rock":
        _add_rock(echoes, scene_object, ground, array, seed)
    elif scene_object.kind == "post":
        _add_post(echoes, scene_object, ground, array)
    elif scene_object.kind == "bush":
        _add_bush(echoes, scene_object, ground, array, seed)
    else:
        _add_fiducial(echoes, scene_object, ground, array)


def _object_stream(seed: int, scene_object: SceneObject) -> np.random.Generator:
    """Return the random stream of an object, named by its kind and position in mm."""
    x_mm = round(scene_object.x * 1000)
    y_mm = round(scene_object.y * 1000)
    return stream(seed, scene_object.kind, x_mm, y_mm)


def _add_rock(
    echoes: Echoes, scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int
) -> None:
    """Add a half-buried stone of permittivity 6 and its image in the ground.

    It is a dipole, half a radius up, that saturates at the optical cross section.
    """
    radius = scene_object.radius
    sine = incidence(scene_object.x, scene_object.y, 0.0, array)
    k = ground.wavenumber
    cosine = math.sqrt(1 - sine**2)

    # Rayleigh's 4πa²·(ka)⁴·((ε - 1)/(ε + 2))² up to πa²·|r|², with r of normal incidence.
    optical = ((math.sqrt(6) - 1) / (math.sqrt(6) + 1)) ** 2
    dipole = ((6 - 1) / (6 + 2)) ** 2
    growth = 4 * dipole / optical * (k * radius) ** 4
    size = radius / 2 * np.sqrt(optical * growth / (1 + growth))

    # Direct wave and the one by the ground, on both ways: H along the ground, V along it and up.
    r_h, r_v = ground.reflection(sine) * np.exp(-1j * k * radius * cosine)
    copolar_h = (1 + r_h) ** 2
    copolar_v = (sine * (1 + r_v)) ** 2 + (cosine * (1 - r_v)) ** 2
    copolar = np.stack([copolar_h, copolar_v])

    rng = _object_stream(seed, scene_object)
    spectrum = rotated(size * copolar, rng.normal(0, 0.2))
    point = np.tile([scene_object.x, scene_object.y, radius / 2], (array.tx.size, 1))
    echoes.add(_air_path(point, array), point[0], spectrum)


def _add_post(
    echoes: Echoes, scene_object: SceneObject, ground: LayeredGround, array: ArrayState
) -> None:
    """Add an upright cylinder: direct, image and corner echoes, integrated over its height."""
    sine = incidence(scene_object.x, scene_object.y, scene_object.height / 2, array)
    k = ground.wavenumber
    cosine = math.sqrt(1 - sine**2)
    # The integral over the height of exp(2jkz·cosθ) leaves its two ends, and the corner, whose
    # phase does not depend on the height, all of it.
    line = np.sqrt(k * scene_object.radius * sine / (4 * np.pi)) * np.exp(-0.25j * np.pi)
    bounce = _CONDUCTOR * ground.reflection(sine)
    end = 1 / (2j * k * cosine)
    foot = line * (2 * bounce * scene_object.height - (1 - bounce**2) * end)
    top = np.broadcast_to(line * end, bounce.shape)
    image = -line * end * bounce**2
    towards = bisectors(scene_object.x, scene_object.y, array)
    for z, copolar in ((0.0, foot), (scene_object.height, top), (-scene_object.height, image)):
        spectrum = _without_cross(copolar)
        _add_ring_point(echoes, scene_object, scene_object.radius, towards, z, spectrum, array)


def bush_scatterers(
    scene_object: SceneObject, seed: int, count: int = 24
) -> tuple[FloatArray, ComplexArray]:
    """Draw a bush's twigs.

    Parameters
    ----------
    scene_object : SceneObject
        The bush.
    seed : int
        Seed of the world.
    count : int
        Number of twigs.

    Returns
    -------
    position : ndarray (twig, 3)
        Positions in the lane frame, m.
    amplitude : ndarray (twig, 3) of complex
        HH, VV and cross, m: HH of the bush's ``rcs_db``, -10 dBsm unless given, cross 6 dB below.
    """
    rng = _object_stream(seed, scene_object)
    position = rng.normal(0, 0.5, (count, 3)) * scene_object.radius
    position[:, 2] = rng.uniform(0.05, 1.0, count) * max(scene_object.height, 0.1)
    position[:, :2] += [scene_object.x, scene_object.y]
    rcs_db = -10.0 if scene_object.rcs_db is None else scene_object.rcs_db
    level = 10 ** (rcs_db / 20) / math.sqrt(4 * np.pi * count)
    white = rng.normal(size=(count, 3)) + 1j * rng.normal(size=(count, 3))
    unit = white / math.sqrt(2)
    return position, unit * level * np.array([1.0, 1.0, 0.5])


def _add_bush(
    echoes: Echoes, scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int
) -> None:
    """Add twigs whose cross section grows by 5 dB per decade of frequency."""
    positions, amplitude = bush_scatterers(scene_object, seed)
    growth = (ground.frequency / 1e9) ** 0.25
    for position, size in zip(positions, amplitude, strict=True):
        echoes.add(_air_path(position[None, :], array), position, size[:, None] * growth)


def _add_fiducial(
    echoes: Echoes, scene_object: SceneObject, ground: LayeredGround, array: ArrayState
) -> None:
    """Add a corner reflector.

    Its cross section grows as f², the same in HH and VV, 0 dBsm at 1 GHz unless given.
    """
    level = 10 ** ((scene_object.rcs_db or 0.0) / 20) / math.sqrt(4 * np.pi)
    point = np.array([[scene_object.x, scene_object.y, scene_object.height]])
    spectrum = level * (ground.frequency / 1e9) * _COPOLAR[:, None]
    echoes.add(_air_path(point, array), point[0], spectrum.astype(complex))


def antenna_gains(points: FloatArray, array: ArrayState) -> NDArray[np.float32]:
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


def sum_echoes(echoes: Echoes, array: ArrayState, frequency: FloatArray) -> NDArray[np.complex64]:
    """Sum echoes over all pairs and tones.

    Parameters
    ----------
    echoes : Echoes
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
    if not echoes.path:
        return out
    pairs = array.tx.size
    position = np.array(echoes.position)
    gain = antenna_gains(position, array)
    ray = position - array.position[:, None]
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    # A beam cos^(n/2) whose n grows with f² is exp(n/2·log cos).
    log_cosine = np.log(np.maximum(ray @ array.boresight, 1e-6))

    path = np.stack([np.broadcast_to(p, (pairs,)) for p in echoes.path])
    spectrum = np.ascontiguousarray(np.stack(echoes.spectrum), dtype=np.complex64)
    weights = [np.broadcast_to(w, (2, pairs)) for w in echoes.weight]
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
