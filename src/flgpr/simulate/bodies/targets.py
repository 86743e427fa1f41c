"""Echoes of bodies in the ground: from their full-wave signatures, and by rays where none holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from flgpr.simulate.bodies import rims as bodies
from flgpr.simulate.bodies.echoes import (
    Echo,
    LayeredGround,
    antenna_gains,
    bisectors,
    incidence,
    ring_points,
    rotated,
    without_difference,
)
from flgpr.simulate.bodies.signature import FREQUENCY, SEPARATION, SINE, find_table, packaged_table
from flgpr.simulate.bodies.standing import standing_echoes
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.scene import Target
from flgpr.types import Complex128Array, ComplexArray, FloatArray

# Times the table's 1.5 cm: up to here the gap's echo is taken as linear in its thickness.
_WIDEST_GAP = 1.5
# Of the nodes' weights: what is summed, relative to the greatest.
_LEAST_WEIGHT = 1e-4
# Steps of difference quotients: m, and of the sine.
_STEP = 0.05
_SINE_STEP = 0.005
# Of the generic bodies.
_TABLE_GAP = 0.015
_TABLE_RADIUS = 0.16
_TABLE_PERMITTIVITY = 2.9


def target_echoes(target: Target, ground: LayeredGround, array: ArrayState) -> Iterator[Echo]:
    """Return a target's echoes.

    A buried target echoes by its signature, a target on the ground and one that no table describes
    by rays.

    Parameters
    ----------
    target : Target
        The target.
    ground : LayeredGround
        The ground that it lies in or on.
    array : ArrayState
        The antennas, their heights counted from that ground.
    """
    if target.depth < 0:
        return standing_echoes(target, ground, array)
    if target.profile is None and float(ground.frequency.mean()) <= FREQUENCY[-1]:
        return _signature(target, ground, array)
    return _rims(target, ground, array)


def _signature(target: Target, ground: LayeredGround, array: ArrayState) -> Iterator[Echo]:
    """Yield the echoes of a table's nodes, weighted in each pair by its incidence, bistatic angle and aspect."""
    layer = ground.medium(target.depth)
    permittivity = ground.real[layer]
    aspects, basis, slope = _basis(target, ground, layer)
    sent, taken = ground.rays(array, _repeated(target, array))
    sine = (sent.sine + taken.sine) / 2
    mean_sine = float(sine.mean())
    separation, azimuth = _azimuths(target, array)
    lean, across = _lean(target, mean_sine, permittivity, array)
    table_sine = _leaning(sine, lean, permittivity) / math.sqrt(_relative_permittivity(target))
    weight = node_weights(table_sine, separation, _aspect(azimuth, target), aspects)

    # Near the radar the wave is not plane over the body: F + j·g/(2k0)·∂F/∂sinθ, see _taper.
    near_factor = 0.5j / ground.wavenumber * _taper(target, mean_sine, ground, layer, array)
    entry = ground.entry_squared(mean_sine, layer) * ground.dispersion(mean_sine, target.depth)
    # Cross amplitudes take the mean of H and V.
    entry_cross = np.sqrt(entry[0] * entry[1])
    near_cross = (near_factor[0] + near_factor[1]) / 2
    entry = np.stack([*entry, entry_cross, entry_cross])
    near_factor = np.stack([*near_factor, near_cross, near_cross])
    spectra = ((basis + near_factor * slope) * entry).astype(np.complex64)
    spectra = spectra.reshape(-1, 4, ground.frequency.size)

    surface = np.array([target.x, target.y, 0.0])
    path = sent.path + taken.path
    for channels, kind in (([0, 1], 0), ([2], 1), ([3], 2)):
        if kind == 1 and aspects.size == 1:
            continue  # (HV + VH)/2 of round bodies is zero
        nodes = weight[..., kind, :].reshape(len(spectra), -1)
        for pair_weight, node_spectrum in _principal_weights(nodes, spectra[:, channels]):
            spectrum = np.zeros((4, node_spectrum.shape[-1]), complex)
            spectrum[channels] = node_spectrum
            if kind == 0:
                spectrum[:3] = rotated(node_spectrum, across)
            yield Echo(path, surface, spectrum, np.stack([pair_weight, pair_weight]))


def _repeated(target: Target, array: ArrayState) -> FloatArray:
    """Return the middle of a target's top once for every pair (pair, 3)."""
    return np.tile([target.x, target.y, -target.depth], (array.tx.size, 1))


def _aspect(azimuth: FloatArray, target: Target) -> FloatArray:
    """Return azimuths from x, rad, as counted from a box's long side."""
    return azimuth - (math.pi / 2 - target.heading)


def mean_amplitude(target: Target, ground: LayeredGround, array: ArrayState) -> Complex128Array:
    """Return a level body's amplitude in the ground, HH and VV (2, frequency), m.

    It is the mean over the array's pairs of the signature table's, without the way through the
    ground and back (:meth:`LayeredGround.entry_squared` and :meth:`LayeredGround.dispersion`), for
    waves that are plane over the body.

    Parameters
    ----------
    target : Target
        A target in the ground, whose tilt is left out.
    ground : LayeredGround
        The ground that it lies in.
    array : ArrayState
        The antennas, their heights counted from that ground.

    Returns
    -------
    ndarray (2, frequency) of complex
        Amplitudes HH and VV, m.
    """
    layer = ground.medium(target.depth)
    aspects, amplitudes = _amplitudes(target, ground.media[layer], ground.frequency)
    sent, taken = ground.rays(array, _repeated(target, array))
    sine = (sent.sine + taken.sine) / 2
    separation, azimuth = _azimuths(target, array)
    weight = node_weights(sine, separation, _aspect(azimuth, target), aspects)
    mean_weight = weight[..., 0, :].mean(axis=-1)
    return np.einsum("ajs,ajspf->pf", mean_weight, amplitudes[..., :2, :])


def _principal_weights(
    weight: FloatArray, spectra: ComplexArray
) -> Iterator[tuple[FloatArray, ComplexArray]]:
    """Yield few weights (pair,) and spectra whose products sum to ``Σ_n weight[n]·spectra[n]``.

    The nodes' weights differ little from pair to pair, so that few principal components hold them.
    """
    values, vectors = np.linalg.eigh(weight @ weight.T)
    strong = values > _LEAST_WEIGHT**2 * values[-1]
    principal = vectors[:, strong].astype(np.float32)
    principal_weights = principal.T @ weight
    principal_spectra = np.tensordot(principal.T, spectra, 1)
    yield from zip(principal_weights, principal_spectra, strict=True)


def _taper(
    target: Target, sine: float, ground: LayeredGround, layer: int, array: ArrayState
) -> Complex128Array:
    """Return the relative growth of the wave per metre of ground range, both ways (2, frequency).

    Tables are for plane waves. Over a body at hand range, pattern and transmission change, and the
    wave front is curved: to first order in size over range ``F + j·g/(2k0)·∂F/∂sinθ``, g being this
    growth plus 1/(2R·sinθ) for that.
    """
    surface = np.array([target.x, target.y, 0.0])
    slant = float(np.linalg.norm(array.position.mean(axis=0) - surface))

    # Antennas: a step to either side of the body, away from the radar.
    outward = -bisectors(target.x, target.y, array).mean(axis=0)
    steps = np.array([[-_STEP], [_STEP]]) * outward / np.linalg.norm(outward)
    positions = np.concatenate([surface[:2] + steps, np.zeros((2, 1))], axis=1)
    gains = np.abs(antenna_gains(positions, array)).swapaxes(1, 2)
    copolar_gains = gains[:, [0, 2]]  # (antenna, H and V, position)
    growth = np.log(copolar_gains[..., 1] / copolar_gains[..., 0]) / (2 * _STEP)

    # Transmission into the ground, by way of the sine of the angle of incidence.
    sine_change = (1 - sine**2) / slant  # per metre
    log_below = np.log(np.abs(ground.entry_squared(sine - _SINE_STEP, layer)))
    log_above = np.log(np.abs(ground.entry_squared(sine + _SINE_STEP, layer)))
    entry = (log_above - log_below) / (2 * _SINE_STEP) * sine_change

    return 2 * growth.mean(axis=0)[:, None] + entry + 1 / (2 * slant * sine)


def _lean(
    target: Target, sine: float, permittivity: float, array: ArrayState
) -> tuple[float, float]:
    """Return how a target's axis leans.

    The first value is the tangent of the tilt towards the radar, the second the angle, rad, by
    which the tilt across turns the body about the ray.
    """
    lean = math.tan(target.tilt) * np.array([math.sin(target.azimuth), math.cos(target.azimuth)])
    towards = bisectors(target.x, target.y, array).mean(axis=0)
    along = float(towards @ lean)
    across = float(towards @ np.array([lean[1], -lean[0]]))
    return along, math.atan2(across, sine / math.sqrt(permittivity))


def _leaning(sine: FloatArray, lean: float, permittivity: float) -> FloatArray:
    """Return the sine in air at which a level body shows the face that a leaning one shows.

    In the soil that is θ_t less the lean.
    """
    index = math.sqrt(permittivity)
    in_soil = np.arcsin(np.minimum(sine / index, 1.0))
    return index * np.sin(in_soil - math.atan(lean))


def _azimuths(target: Target, array: ArrayState) -> tuple[FloatArray, FloatArray]:
    """Return two azimuths of each pair as seen from the target, rad.

    The first is that of the receiver from the transmitter, the second that of their bisector from
    x.
    """
    offset = array.position - np.array([target.x, target.y, 0.0])
    unit = (offset[:, 0] + 1j * offset[:, 1]) / np.hypot(offset[:, 0], offset[:, 1])
    sent = unit[array.tx]
    taken = unit[array.rx]
    return np.angle(taken / sent), np.angle(sent + taken)


def node_weights(
    sine: FloatArray, separation: FloatArray, aspect: FloatArray, aspects: FloatArray
) -> FloatArray:
    """Return the weights of a table's nodes for given directions.

    They are polynomials through all sines (clipped to the table's), even or odd polynomials in the
    separation, and in the aspect cosines, or sines for what a box's mirror planes turn round.

    Parameters
    ----------
    sine : ndarray (pair,)
        Sine of the angle of incidence in air.
    separation : ndarray (pair,)
        Azimuth of the receiver counterclockwise from the transmitter, rad.
    aspect : ndarray (pair,)
        Azimuth of their bisector from a box's long side, rad.
    aspects : ndarray (aspect,)
        The table's aspects, rad.

    Returns
    -------
    ndarray (aspect, sine, separation, 3, pair)
        For HH and VV, even in separation and aspect, for (HV + VH)/2, odd in the aspect, and for
        (HV - VH)/2, odd in the separation.
    """
    along = _lagrange(SINE, np.clip(sine, SINE[0] - 0.05, SINE[-1]))
    between = np.clip(separation, -SEPARATION[-1] * 1.3, SEPARATION[-1] * 1.3)
    even = _lagrange(SEPARATION**2, between**2)
    odd = np.zeros_like(even)
    odd[1:] = _lagrange(SEPARATION[1:] ** 2, between**2) * between / SEPARATION[1:, None]
    cosines, sines = _aspect_weights(aspect, aspects)
    turned = np.stack([cosines, sines, cosines], axis=1)[:, None, None]  # (aspect, 1, 1, 3, pair)
    apart = np.stack([even, even, odd], axis=1)  # (separation, 3, pair)
    return turned * along[:, None, None] * apart


def _lagrange(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Return the weights (node, point) of the polynomial through all nodes."""
    weights = np.ones((nodes.size, at.size))
    for i, node in enumerate(nodes):
        for other in np.delete(nodes, i):
            weights[i] *= (at - other) / (node - other)
    return weights


def _aspect_weights(aspect: FloatArray, aspects: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights (aspect, pair) of cosines, and of sines, through all aspects.

    The aspects go from one mirror plane to the next.
    """
    last = aspects.size - 1
    if last == 0:
        return np.ones((1, aspect.size)), np.ones((1, aspect.size))
    order = np.arange(last + 1)
    ends = np.where(order % last == 0, 0.5, 1.0)
    node = np.outer(order, order) * np.pi / last
    turn = np.outer(order, aspect) * np.pi / aspects[-1]
    cosines = 2 / last * ends[:, None] * ((ends * np.cos(node)) @ np.cos(turn))
    sines = 2 / last * np.sin(node) @ np.sin(turn)
    return cosines, sines


@lru_cache(maxsize=256)
def _basis(
    target: Target, ground: LayeredGround, layer: int
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return a target's aspects, its amplitudes in this ground, and their slopes in the sine."""
    aspects, amplitudes = _amplitudes(target, ground.media[layer], ground.frequency)
    amplitudes = amplitudes * _ANTENNAS
    difference = _DIFFERENCE / math.sqrt(_relative_permittivity(target))
    slopes = np.einsum("ij,ajspf->aispf", difference, amplitudes)
    return aspects, amplitudes, slopes.astype(np.complex64)


def _amplitudes(
    target: Target, permittivity: Complex128Array, frequency: FloatArray
) -> tuple[FloatArray, ComplexArray]:
    """Return aspects and amplitudes (aspect, sine, separation, 4, frequency) of a target's body.

    Without a body of its own it is the generic one of metal or plastic.
    """
    if target.body is not None:
        table = find_table(target.body)
        return table.aspects, table.at(frequency, permittivity, target.depth)
    # A body that is larger, or of another permittivity, is the generic one at other tones in
    # another soil: Maxwell's equations scale (but for the air over the soil, whose share is then
    # approximate).
    size = target.radius / _TABLE_RADIUS
    relative = _relative_permittivity(target)
    scaled_frequency = frequency * size * math.sqrt(relative)
    scaled_soil = permittivity / relative
    scaled_depth = target.depth / size
    table = packaged_table("metal-at" if target.dielectric is None else "plastic-at-solid")
    amplitudes = table.at(scaled_frequency, scaled_soil, scaled_depth)
    gap = min(target.air_gap / size / _TABLE_GAP, _WIDEST_GAP)
    if target.dielectric is not None and gap > 0:
        with_gap = packaged_table("plastic-at").at(scaled_frequency, scaled_soil, scaled_depth)
        amplitudes = amplitudes + np.float32(gap) * (with_gap - amplitudes)
    return table.aspects, np.float32(size) * amplitudes


def _slope_matrix(nodes: FloatArray) -> FloatArray:
    """Return the matrix that takes a polynomial's values at nodes to its slopes there."""
    step = 1e-4
    return (_lagrange(nodes, nodes + step) - _lagrange(nodes, nodes - step)).T / (2 * step)


def _relative_permittivity(target: Target) -> float:
    """Return the permittivity of a generic dielectric body over that of the table's."""
    if target.body is not None or target.dielectric is None:
        return 1.0
    return target.dielectric / _TABLE_PERMITTIVITY


def _rims(target: Target, ground: LayeredGround, array: ArrayState) -> Iterator[Echo]:
    """Yield the near and far flash of every rim that is seen through the ground."""
    sine = incidence(target.x, target.y, 0.0, array)
    layer = ground.medium(target.depth)
    index = math.sqrt(ground.real[layer])
    towards = bisectors(target.x, target.y, array)
    along, across = _lean(target, sine, ground.real[layer], array)
    cover = None
    if layer == 0 and target.dielectric is None:
        cover = _cover_factor(sine, target, ground)
    entry = ground.entry_squared(sine, layer)
    for rim in bodies.visible_rims(target.outline, min(sine / index, 0.999)):
        if target.dielectric is not None and rim.drop > 0:
            continue  # the layers' sum already holds the body's bottom
        side = 1.0 if rim.is_near else -1.0
        # The axis leans towards the radar: the near rim sinks, the far one rises.
        depth = max(target.depth + rim.drop + side * rim.radius * along, 0.0)
        points = ring_points(target, side * rim.radius, towards, -depth)
        sent, taken = ground.rays(array, points)

        size = bodies.rim_amplitude(rim, index * ground.wavenumber, sine / index)
        size = size * ground.dispersion(sine, depth)
        copolar = size * entry * _strength(rim, target, sine, ground, layer)
        if cover is not None and rim.drop == 0 and not rim.is_near:
            copolar = copolar * cover
        position = np.array([target.x, target.y, -depth])
        spectrum = without_difference(rotated(copolar, across))
        yield Echo(sent.path + taken.path, position, spectrum)


def _strength(
    rim: bodies.Rim, target: Target, sine: float, ground: LayeredGround, layer: int
) -> Complex128Array:
    """Return the coefficients H and V (2, frequency) of a rim.

    They are those of a metal wedge, or of a dielectric body's layers.
    """
    if target.dielectric is None:
        return np.array([[rim.h], [rim.v]], complex)
    gap = min(target.air_gap, 0.9 * target.height)
    layers = [(gap, 1.0), (target.height - gap, target.dielectric)]
    near_rim = bodies.layers_strength(sine, ground.wavenumber, ground.media[layer], layers)
    return near_rim if rim.is_near else -near_rim


def _cover_factor(sine: float, target: Target, ground: LayeredGround) -> Complex128Array:
    """Return the factor (2, frequency) of waves between a metal top and the surface.

    They bounce on their way to the far rim and back. Each bounce ``r21·Γ·e^{-2jqd}`` starts
    ``2d·tanθ_t`` nearer the radar, where the top must reach: as many are summed as fit on the
    diameter, the last as the share of it that fits. The near rim has no top before it and sees
    none. Squared, for by reciprocity the way out has the same bounces as the way in.
    """
    # r21 = -r12 of the surface from below, Γ of metal for H and V.
    normal = np.sqrt(ground.media[0] - sine**2)
    delay = np.exp(-2j * ground.wavenumber * normal * target.depth)
    bounce = -ground.reflection(sine) * np.array([[-1.0], [1.0]]) * delay

    shift = 2 * target.depth * sine / math.sqrt(ground.real[0] - sine**2)
    fitting = min(2 * target.radius / max(shift, 1e-9), 1e3)
    complete = math.floor(fitting)
    next_bounce = bounce ** (complete + 1)
    factor: Complex128Array = (1 - next_bounce) / (1 - bounce) + (fitting - complete) * next_bounce
    return factor**2


_DIFFERENCE = _slope_matrix(SINE)
# Tables count H along z x k, antennas along k x z: what crosses changes its sign.
_ANTENNAS = np.array([1, 1, -1, -1], np.float32)[:, None]
