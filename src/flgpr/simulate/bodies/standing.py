"""Echoes of what stands on the ground: bodies laid on it, rocks, posts, bushes and reflectors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from flgpr.simulate.bodies import rims as bodies
from flgpr.simulate.bodies.echoes import (
    Echo,
    LayeredGround,
    bisectors,
    incidence,
    ring_points,
    rotated,
    without_difference,
)
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import SceneObject, Target
from flgpr.types import Complex128Array, FloatArray

_COPOLAR = np.array([1.0, 1.0, 0.0])
# Reflection of H and V by a perfectly conducting wall.
_CONDUCTOR = np.array([[-1.0], [1.0]])


def standing_echoes(target: Target, ground: LayeredGround, array: ArrayState) -> Iterator[Echo]:
    """Yield the echoes of a target on the ground.

    They are that of the corner which its wall makes with the ground, and those of the rims of
    its top.

    Parameters
    ----------
    target : Target
        The target, whose depth is negative.
    ground : LayeredGround
        The ground that it stands on.
    array : ArrayState
        The antennas, their heights counted from that ground.
    """
    radius, height = target.extent
    height = min(-target.depth, height)
    sine = incidence(target.x, target.y, 0.0, array)
    k = ground.wavenumber
    wall, top = _standing_reflections(target, ground, sine)
    towards = bisectors(target.x, target.y, array)

    # The cylinder's wall by stationary phase; twice, as waves meet wall and ground in either order.
    wall_amplitude = np.sqrt(k * radius * sine / (4 * np.pi)) * 2 * height * np.exp(-0.25j * np.pi)
    corner = wall_amplitude * _CONDUCTOR * ground.reflection(sine) * wall
    yield _ring_echo(target, radius, towards, 0.0, corner, array)

    for rim in bodies.visible_rims(target.outline, sine):
        if rim.drop > 0:
            continue
        edge = np.array([[rim.h], [rim.v]])
        size = bodies.rim_amplitude(rim, k, sine) * top * edge
        reach = rim.radius if rim.is_near else -rim.radius
        z = height - rim.drop
        yield _ring_echo(target, reach, towards, z, size, array)


def _standing_reflections(
    target: Target, ground: LayeredGround, sine: float
) -> tuple[Complex128Array, Complex128Array]:
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


def _ring_echo(
    target: Target | SceneObject,
    reach: float,
    towards: FloatArray,
    z: float,
    copolar: Complex128Array,
    array: ArrayState,
) -> Echo:
    """Return the echo in air, HH and VV, from a ring's point ``reach`` (m) towards the radar."""
    path = _air_path(ring_points(target, reach, towards, z), array)
    spectrum = np.concatenate([copolar, np.zeros_like(copolar)])
    return Echo(path, np.array([target.x, target.y, z]), spectrum)


def _air_path(point: FloatArray, array: ArrayState) -> FloatArray:
    """Return the paths (pair,) in air by way of a point (3,) or one for every pair, m."""
    sent = np.linalg.norm(array.position[array.tx] - point, axis=-1)
    taken = np.linalg.norm(array.position[array.rx] - point, axis=-1)
    return sent + taken


def object_echoes(
    scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int
) -> Iterable[Echo]:
    """Return an object's echoes.

    Parameters
    ----------
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
        return [_rock(scene_object, ground, array, seed)]
    if scene_object.kind == "post":
        return _post(scene_object, ground, array)
    if scene_object.kind == "bush":
        return _bush(scene_object, ground, array, seed)
    return [_fiducial(scene_object, ground, array)]


def _object_stream(seed: int, scene_object: SceneObject) -> np.random.Generator:
    """Return the random stream of an object, named by its kind and position in mm."""
    x_mm = round(scene_object.x * 1000)
    y_mm = round(scene_object.y * 1000)
    return stream(seed, scene_object.kind, x_mm, y_mm)


def _rock(scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int) -> Echo:
    """Return the echo of a half-buried stone of permittivity 6 and its image in the ground.

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
    return Echo(_air_path(point, array), point[0], without_difference(spectrum))


def _post(scene_object: SceneObject, ground: LayeredGround, array: ArrayState) -> Iterator[Echo]:
    """Yield the echoes of an upright cylinder: direct, image and corner echoes, integrated over its height."""
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
        yield _ring_echo(scene_object, scene_object.radius, towards, z, copolar, array)


def bush_scatterers(
    scene_object: SceneObject, seed: int, count: int = 24
) -> tuple[FloatArray, Complex128Array]:
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


def _bush(
    scene_object: SceneObject, ground: LayeredGround, array: ArrayState, seed: int
) -> Iterator[Echo]:
    """Yield the echoes of twigs whose cross section grows by 5 dB per decade of frequency."""
    positions, amplitude = bush_scatterers(scene_object, seed)
    growth = (ground.frequency / 1e9) ** 0.25
    for position, size in zip(positions, amplitude, strict=True):
        spectrum = without_difference(size[:, None] * growth)
        yield Echo(_air_path(position, array), position, spectrum)


def _fiducial(scene_object: SceneObject, ground: LayeredGround, array: ArrayState) -> Echo:
    """Return the echo of a corner reflector.

    Its cross section grows as f², the same in HH and VV, 0 dBsm at 1 GHz unless given.
    """
    level = 10 ** ((scene_object.rcs_db or 0.0) / 20) / math.sqrt(4 * np.pi)
    point = np.array([scene_object.x, scene_object.y, scene_object.height])
    spectrum = without_difference(level * (ground.frequency / 1e9) * _COPOLAR[:, None])
    return Echo(_air_path(point, array), point, spectrum)
