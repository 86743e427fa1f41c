"""Echoes of bodies in the ground: from their full-wave signatures, and by rays where there is none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.bodies import rims as bodies
from flgpr.simulate.bodies.echoes import (
    Echoes,
    Ground,
    add_standing,
    antenna_gains,
    bisectors,
    incidence,
    rotated,
)
from flgpr.simulate.bodies.signature import FREQUENCY, SEPARATION, SINE, find_table, packaged_table
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.scene import Target

# times the table's 1.5 cm, to which the gap's echo is taken as linear in its thickness
_WIDEST_GAP = 1.5
_LEAST_WEIGHT = 1e-4  # of the nodes' weights, beside the greatest, that is summed
# m and of the sine, for slopes
_STEP = 0.05
_SINE_STEP = 0.005
# of the generic bodies
_TABLE_GAP = 0.015
_TABLE_RADIUS = 0.16
_TABLE_PERMITTIVITY = 2.9


def add_target(echoes: Echoes, target: Target, ground: Ground, array: ArrayState) -> None:
    """Add a target's echoes: by its signature in the ground, by rays above it and where no table describes it."""
    if target.depth < 0:
        add_standing(echoes, target, ground, array)
    elif target.profile is None and float(ground.frequency.mean()) <= FREQUENCY[-1]:
        _add_signature(echoes, target, ground, array)
    else:
        _add_rims(echoes, target, ground, array)


def _add_signature(echoes: Echoes, target: Target, ground: Ground, array: ArrayState) -> None:
    """Add a table's nodes, weighted in each pair by its incidence, bistatic angle and aspect."""
    layer = ground.medium(target.depth)
    aspects, basis, slope = _basis(target, ground, layer)
    point = np.tile([target.x, target.y, -target.depth], (array.tx.size, 1))
    sent, taken = (ground.ray(array.position[which], point) for which in (array.tx, array.rx))
    sine, (separation, aspect) = (sent.sine + taken.sine) / 2, _azimuths(target, array)
    mean = float(sine.mean())
    lean, across = _lean(target, mean, ground.real[layer], array)
    seen = _leaning(sine, lean, ground.real[layer]) / math.sqrt(_relative(target))
    weight = node_weights(seen, separation, aspect - (math.pi / 2 - target.heading), aspects)
    near = 0.5j / ground.wavenumber * _taper(target, mean, ground, layer, array)
    entry = ground.entry_squared(mean, layer) * ground.dispersion(mean, target.depth)
    cross = [np.sqrt(entry[0] * entry[1]), (near[0] + near[1]) / 2]
    entry, near = (
        np.stack([*both, one, one]) for both, one in zip((entry, near), cross, strict=True)
    )
    whole = (basis + near * slope) * entry
    spectra = whole.astype(np.complex64).reshape(-1, 4, ground.frequency.size)
    surface = np.array([target.x, target.y, 0.0])
    path = sent.path + taken.path
    for channels, kind in (([0, 1], 0), ([2], 1), ([3], 2)):
        if kind == 1 and aspects.size == 1:
            continue  # (HV + VH)/2 of round bodies is zero
        for one, few in _few(weight[..., kind, :].reshape(len(spectra), -1), spectra[:, channels]):
            spectrum = np.zeros((4, few.shape[-1]), np.complex64)
            spectrum[channels] = few
            if kind == 0:
                spectrum[:3] = rotated(few, across)
            echoes.add(path, surface, spectrum, np.stack([one, one]))


def mean_amplitude(target: Target, ground: Ground, array: ArrayState) -> ComplexArray:
    """Return a level body's amplitude in the ground, HH and VV (2, frequency), m, mean over the array's pairs.

    It is the signature table's, without the way through the ground and back
    (:meth:`Ground.entry_squared` and :meth:`Ground.dispersion`), for waves that are plane over the
    body.
    """
    layer = ground.medium(target.depth)
    aspects, amplitudes = _amplitudes(target, ground.media[layer], ground.frequency)
    point = np.tile([target.x, target.y, -target.depth], (array.tx.size, 1))
    sine = [ground.ray(array.position[antenna], point).sine for antenna in (array.tx, array.rx)]
    separation, azimuth = _azimuths(target, array)
    weight = node_weights(
        np.mean(sine, axis=0), separation, azimuth - (math.pi / 2 - target.heading), aspects
    )
    return np.asarray(
        np.einsum("ajs,ajspf->pf", weight[..., 0, :].mean(axis=-1), amplitudes[..., :2, :])
    )


def _few(
    weight: FloatArray, spectra: NDArray[np.complex64]
) -> Iterator[tuple[FloatArray, NDArray[np.complex64]]]:
    """Few weights (pair,) and spectra that sum to ``Σ_n weight[n]·spectra[n]`` in every pair."""
    values, vectors = np.linalg.eigh(weight @ weight.T)
    kept = vectors[:, values > _LEAST_WEIGHT**2 * values[-1]].astype(np.float32)
    yield from zip(kept.T @ weight, np.tensordot(kept.T, spectra, 1), strict=True)


def _taper(
    target: Target, sine: float, ground: Ground, layer: int, array: ArrayState
) -> ComplexArray:
    """Relative growth per metre of ground range of the wave on a body, there and back, H and V (2, frequency).

    Tables are for plane waves. Over a body at hand range, pattern and transmission change, and the
    wave front is curved: to first order in size over range ``F + j·g/(2k0)·∂F/∂sinθ``, g being this
    growth plus 1/(2R·sinθ) for that.
    """
    away = -bisectors(target.x, target.y, array).mean(axis=0)
    steps = np.array([[-_STEP], [_STEP]]) * away / np.linalg.norm(away)
    places = np.concatenate([np.array([target.x, target.y]) + steps, np.zeros((2, 1))], axis=1)
    gains = np.abs(antenna_gains(places, array)).swapaxes(1, 2)[
        :, [0, 2]
    ]  # (antenna, H and V, place)
    growth = np.log(gains[..., 1] / gains[..., 0]) / (2 * _STEP)
    slant = float(np.linalg.norm(array.position.mean(axis=0) - np.array([target.x, target.y, 0.0])))
    change = (1 - sine**2) / slant  # of the sine of incidence per metre
    logs = [
        np.log(np.abs(ground.entry_squared(sine + d, layer))) for d in (-_SINE_STEP, _SINE_STEP)
    ]
    entry = (logs[1] - logs[0]) / (2 * _SINE_STEP) * change
    return np.asarray(2 * growth.mean(axis=0)[:, None] + entry + 1 / (2 * slant * sine))


def _lean(
    target: Target, sine: float, permittivity: float, array: ArrayState
) -> tuple[float, float]:
    """Tangent of the axis's tilt towards the radar, and the angle by which the rest turns the body on the ray, rad."""
    lean = math.tan(target.tilt) * np.array([math.sin(target.azimuth), math.cos(target.azimuth)])
    towards = bisectors(target.x, target.y, array).mean(axis=0)
    along = float(towards @ lean)
    across = float(towards @ np.array([lean[1], -lean[0]]))
    return along, math.atan2(across, sine / math.sqrt(permittivity))


def _leaning(sine: FloatArray, lean: float, permittivity: float) -> FloatArray:
    """Sine in air at which a level body shows the face that a leaning one shows: in the soil θ_t less the lean."""
    index = math.sqrt(permittivity)
    return np.asarray(index * np.sin(np.arcsin(np.minimum(sine / index, 1.0)) - math.atan(lean)))


def _azimuths(target: Target, array: ArrayState) -> tuple[FloatArray, FloatArray]:
    """Azimuth of each pair's receiver from its transmitter, seen from the target, and of their bisector from x, rad."""
    offset = array.position - np.array([target.x, target.y, 0.0])
    unit = (offset[:, 0] + 1j * offset[:, 1]) / np.hypot(offset[:, 0], offset[:, 1])
    sent = unit[array.tx]
    taken = unit[array.rx]
    return np.angle(taken / sent), np.angle(sent + taken)


def node_weights(
    sine: FloatArray, separation: FloatArray, aspect: FloatArray, aspects: FloatArray
) -> FloatArray:
    """Weights (aspect, sine, separation, 3, pair) of a table's nodes for given directions.

    Polynomials through all sines (clipped to the table's), even or odd polynomials in the
    separation, and in the aspect cosines, or sines for what a box's mirror planes turn round. The
    three are for HH and VV, even in separation and aspect, for (HV + VH)/2, odd in the aspect, and
    for (HV - VH)/2, odd in the separation. Separation is the azimuth of the receiver
    counterclockwise from the transmitter, aspect that of their bisector from a box's long side.
    """
    along = _lagrange(SINE, np.clip(sine, SINE[0] - 0.05, SINE[-1]))
    between = np.clip(separation, -SEPARATION[-1] * 1.3, SEPARATION[-1] * 1.3)
    even = _lagrange(SEPARATION**2, between**2)
    odd = np.zeros_like(even)
    odd[1:] = _lagrange(SEPARATION[1:] ** 2, between**2) * between / SEPARATION[1:, None]
    cosines, sines = _aspect_weights(aspect, aspects)
    turned = np.stack([cosines, sines, cosines], axis=1)[:, None, None]  # (aspect, 1, 1, 3, pair)
    apart = np.stack([even, even, odd], axis=1)  # (separation, 3, pair)
    return np.asarray(turned * along[:, None, None] * apart)


def _lagrange(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Weights (node, point) of the polynomial through all nodes."""
    out = np.ones((nodes.size, at.size))
    for i, node in enumerate(nodes):
        for other in np.delete(nodes, i):
            out[i] *= (at - other) / (node - other)
    return out


def _aspect_weights(aspect: FloatArray, aspects: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights (aspect, pair) of cosines, and of sines, through all aspects from one mirror plane to the next."""
    last = aspects.size - 1
    if last == 0:
        return np.ones((1, aspect.size)), np.ones((1, aspect.size))
    order = np.arange(last + 1)
    ends = np.where(order % last == 0, 0.5, 1.0)
    node = np.outer(order, order) * np.pi / last
    turn = np.outer(order, aspect) * np.pi / aspects[-1]
    cosines = 2 / last * ends[:, None] * ((ends * np.cos(node)) @ np.cos(turn))
    return cosines, 2 / last * np.sin(node) @ np.sin(turn)


@lru_cache(maxsize=256)
def _basis(
    target: Target, ground: Ground, layer: int
) -> tuple[FloatArray, NDArray[np.complex64], NDArray[np.complex64]]:
    """Aspects of a target's table, its amplitudes in this ground at its depth, and their slopes in the sine."""
    aspects, found = _amplitudes(target, ground.media[layer], ground.frequency)
    found = found * _ANTENNAS
    slopes = np.einsum("ij,ajspf->aispf", _DIFFERENCE / math.sqrt(_relative(target)), found)
    return aspects, found, slopes.astype(np.complex64)


def _amplitudes(
    target: Target, permittivity: ComplexArray, frequency: FloatArray
) -> tuple[FloatArray, NDArray[np.complex64]]:
    """Aspects and amplitudes (aspect, sine, separation, 4, frequency) of a target's own body or of the generic one."""
    if target.body is not None:
        table = find_table(target.body)
        return table.aspects, table.at(frequency, permittivity, target.depth)
    # A body that is larger, or of another permittivity, is the generic one at other tones in
    # another soil: Maxwell's equations scale (but for the air over the soil, whose share is then
    # approximate).
    size = target.radius / _TABLE_RADIUS
    relative = _relative(target)
    where = (frequency * size * math.sqrt(relative), permittivity / relative, target.depth / size)
    table = packaged_table("metal-at" if target.dielectric is None else "plastic-at-solid")
    found = table.at(*where)
    gap = min(target.air_gap / size / _TABLE_GAP, _WIDEST_GAP)
    if target.dielectric is not None and gap > 0:
        found = found + np.float32(gap) * (packaged_table("plastic-at").at(*where) - found)
    return table.aspects, np.float32(size) * found


def _slopes(nodes: FloatArray) -> FloatArray:
    """Matrix that takes a polynomial's values at nodes to its slopes there."""
    step = 1e-4
    return (_lagrange(nodes, nodes + step) - _lagrange(nodes, nodes - step)).T / (2 * step)


def _relative(target: Target) -> float:
    """Permittivity of a generic dielectric body over that of the table's."""
    if target.body is not None or target.dielectric is None:
        return 1.0
    return target.dielectric / _TABLE_PERMITTIVITY


def _add_rims(echoes: Echoes, target: Target, ground: Ground, array: ArrayState) -> None:
    """Add the near and far flash of every rim that is seen through the ground."""
    sine = incidence(target.x, target.y, 0.0, array)
    layer = ground.medium(target.depth)
    index = math.sqrt(ground.real[layer])
    towards = bisectors(target.x, target.y, array)
    along, across = _lean(target, sine, ground.real[layer], array)
    cover = (
        _cover_factor(sine, target, ground)
        if layer == 0 and target.dielectric is None
        else np.ones((2, 1))
    )
    entry = ground.entry_squared(sine, layer)
    for rim in bodies.visible_rims(target.outline, min(sine / index, 0.999)):
        if target.dielectric is not None and rim.drop > 0:
            continue  # the layers' sum already holds the body's bottom
        side = 1.0 if rim.near else -1.0
        # The axis leans towards the radar: the near rim sinks, the far one rises.
        depth = max(target.depth + rim.drop + side * rim.radius * along, 0.0)
        point = np.empty((array.tx.size, 3))
        point[:, :2] = np.array([target.x, target.y]) + side * rim.radius * towards
        point[:, 2] = -depth
        path = (
            ground.ray(array.position[array.tx], point).path
            + ground.ray(array.position[array.rx], point).path
        )
        size = bodies.rim_amplitude(
            rim, index * ground.wavenumber, sine / index
        ) * ground.dispersion(sine, depth)
        copolar = size * entry * _strength(rim, target, sine, ground, layer)
        copolar = copolar * (cover if rim.drop == 0 and not rim.near else 1.0)
        echoes.add(path, np.array([target.x, target.y, -depth]), rotated(copolar, across))


def _strength(
    rim: bodies.Rim, target: Target, sine: float, ground: Ground, layer: int
) -> ComplexArray:
    """Coefficients H and V (2, frequency) of a rim: of a metal wedge, or of a dielectric body's layers."""
    if target.dielectric is None:
        return np.array([[rim.h], [rim.v]], complex)
    gap = min(target.air_gap, 0.9 * target.height)
    layers = [(gap, 1.0), (target.height - gap, target.dielectric)]
    both = bodies.layers_strength(sine, ground.wavenumber, ground.media[layer], layers)
    return both if rim.near else -both


def _cover_factor(sine: float, target: Target, ground: Ground) -> ComplexArray:
    """Waves that bounce between a metal top and the surface on their way to the far rim and back.

    Each bounce ``r21·Γ·e^{-2jqd}`` starts ``2d·tanθ_t`` nearer the radar, where the top must reach:
    as many are summed as fit on the diameter, the last in part. The near rim has no top before it
    and sees none. Squared, for by reciprocity the way out has the same bounces as the way in.
    """
    normal = np.sqrt(ground.media[0] - sine**2)
    delay = np.exp(-2j * ground.wavenumber * normal * target.depth)
    bounce = -ground.reflection(sine) * np.array([[-1.0], [1.0]]) * delay
    shift = 2 * target.depth * sine / math.sqrt(ground.real[0] - sine**2)
    fitting = min(2 * target.radius / max(shift, 1e-9), 1e3)
    whole = math.floor(fitting)
    rest: ComplexArray = (1 - bounce ** (whole + 1)) / (1 - bounce) + (
        fitting - whole
    ) * bounce ** (whole + 1)
    return rest**2


_DIFFERENCE = _slopes(SINE)
# Tables count H along z x k, antennas along k x z: what crosses changes its sign.
_ANTENNAS = np.array([1, 1, -1, -1], np.float32)[:, None]
