"""Holes dug and filled again: where they are, what they do to a target's echo, and their own."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground.inclusions import disc_flash
from flgpr.simulate.ground.roughness import bragg_factors
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Patch, Scene, Target
from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats


class Hole(NamedTuple):
    """A refilled hole, with the index of the target in it, if any.

    Lengths are in m. ``looseness`` is the density of the fill over that of the soil around,
    ``moisture`` its additional volumetric moisture, m³/m³, and ``cap`` the height of its top over
    the surface.
    """

    x: float
    y: float
    radius: float
    depth: float
    looseness: float
    moisture: float
    cap: float
    target: int | None = None

    def fill(self, soil: Complex128Array, frequency: FloatArray) -> Complex128Array:
        """Return the permittivity of the fill by refractive mixing (Birchak et al. 1974).

        The solids and water of the soil thin out with its density, and the water added takes the
        place of air.

        Parameters
        ----------
        soil : ndarray (frequency,) of complex
            Permittivity of the soil around.
        frequency : ndarray (frequency,)
            Frequencies, Hz.
        """
        thinned_soil = (np.sqrt(soil) - 1) * self.looseness
        added_water = (np.sqrt(water(frequency)) - 1) * self.moisture
        index = 1 + thinned_soil + added_water
        return np.where(index.real > 1, index, 1.0) ** 2


def water(frequency: ArrayLike) -> Complex128Array:
    """Return the permittivity of fresh water at 20 °C at frequencies in Hz.

    A Debye relaxation (Ulaby, Moore & Fung 1986, App. E).
    """
    f = floats(frequency)
    return np.asarray(4.9 + 75.2 / (1 + 2j * np.pi * f * 9.23e-12))


def draw_holes(scene: Scene, targets: tuple[Target, ...], seed: int) -> tuple[Hole, ...]:
    """Draw the holes over targets, in their order, and then the empty ones in the lane.

    Decoys of a later drive are the last.
    """
    if not scene.holes.on:
        return ()
    over_targets = _holes_over_targets(scene, targets, seed)
    empty = _empty_holes(scene, stream(seed, "holes"), scene.holes.empty)
    decoys = _empty_holes(scene, stream(seed, "decoys", scene.drive), scene.change.decoys)
    return (*over_targets, *empty, *decoys)


def _holes_over_targets(scene: Scene, targets: tuple[Target, ...], seed: int) -> list[Hole]:
    """Draw which buried targets lie in a hole, and those holes."""
    table = scene.holes
    holes = []
    for index, target in enumerate(targets):
        rng = stream(seed, "hole", index)
        if target.depth < 0 or rng.random() >= table.over:
            continue
        width, height = target.extent
        radius = width + rng.uniform(*table.margin)
        depth = target.depth + height
        holes.append(Hole(target.x, target.y, radius, depth, *_draw_fill(scene, rng), index))
    return holes


def _empty_holes(scene: Scene, rng: np.random.Generator, density: float) -> list[Hole]:
    """Draw so many holes per m² in the lane that hold nothing."""
    table = scene.holes
    holes = []
    for _ in range(rng.poisson(density * scene.lane.area)):
        x = rng.uniform(scene.x_min, scene.x_max)
        y = rng.uniform(0, scene.length)
        radius = rng.uniform(*table.radius)
        depth = rng.uniform(*table.depth)
        holes.append(Hole(x, y, radius, depth, *_draw_fill(scene, rng)))
    return holes


def _draw_fill(scene: Scene, rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw the looseness, additional moisture and cap height of a hole's fill."""
    table = scene.holes
    looseness = rng.uniform(*table.looseness)
    moisture = rng.normal(0, table.moisture)
    cap = rng.normal(0, table.cap)
    return looseness, moisture, cap


def hole_patches(scene: Scene, holes: tuple[Hole, ...]) -> tuple[Patch, ...]:
    """Return patches of rougher ground where holes were filled."""
    gain_db = scene.holes.rough_db
    if gain_db == 0:
        return ()
    return tuple(Patch(x=h.x, y=h.y, radius=h.radius, gain_db=gain_db) for h in holes)


def hole_factor(
    hole: Hole, depth: float, sine: float, ground: LayeredGround
) -> tuple[float, Complex128Array]:
    """Compute how a hole changes the path to a point in it, against the undisturbed soil.

    Parameters
    ----------
    hole : Hole
        The hole; its cap lies on top of the depth.
    depth : float
        Depth of the point below the mean surface, m.
    sine : float
        Sine of the angle of incidence in air.
    ground : LayeredGround
        The soil around, and the frequencies.

    Returns
    -------
    extra : float
        Path gained one way at the band's middle, m.
    factor : ndarray (frequency,) of complex
        Factor of the amplitude both ways, with the phase that ``extra`` leaves.
    """
    fill = hole.fill(ground.media[0], ground.frequency)
    depth_in_hole = min(depth, hole.depth)
    thickness = max(depth_in_hole + hole.cap, 0.0)
    cap = thickness - depth_in_hole  # fill where there was air
    cosine = math.sqrt(1 - sine**2)
    passed = thickness * np.sqrt(fill - sine**2) - cap * cosine
    passed = passed - depth_in_hole * np.sqrt(ground.media[0] - sine**2)
    extra = float(passed[ground.middle].real)
    return extra, np.exp(-2j * ground.wavenumber * (passed - extra))


def wall_flash(
    hole: Hole,
    contrast: complex,
    soil: float,
    wall: float,
    sine: float,
    wavenumber: float,
    side: float,
) -> complex:
    """Return the amplitude of one flash of the upper edge of a hole's wall (Born), m.

    It is ``k0²/4π·δε·πa²`` times :func:`~flgpr.simulate.ground.inclusions.disc_flash` and the end
    point of the integral over depth, ``1/(2jk0·sqrt(ε - sin²θ))``, weakened by the wall's
    unevenness, ``exp(-(2k0·w·sinθ)²/2)``. The flash of the lower edge is the opposite.

    Parameters
    ----------
    hole : Hole
        The hole.
    contrast : complex
        Permittivity of the fill less that of the soil.
    soil : float
        Real permittivity of the soil.
    wall : float
        Rms unevenness w of the wall, m.
    sine : float
        Sine of the angle of incidence in air.
    wavenumber : float
        Wavenumber k0 in air, rad/m.
    side : float
        1 for the near, -1 for the far flash.
    """
    across = 2 * wavenumber * wall * sine
    end = 1 / (2j * wavenumber * math.sqrt(soil - sine**2))
    flash = disc_flash(hole.radius, wavenumber, sine, side) * end * math.exp(-0.5 * across**2)
    return complex(math.sqrt(4 * math.pi) * wavenumber**2 / 4 * contrast * hole.radius**2 * flash)


def cap_flash(
    hole: Hole, soil: complex, sine: float, wavenumber: float, side: float
) -> tuple[complex, complex]:
    """Return the amplitude of one flash of the cap's edge, HH and VV, m.

    Small perturbation by the deterministic height ``h·(1 - r²/a²)``: ``k0²cos²θ·α/π`` times its
    transform ``4πh·J_2(Ka)/K²``, K = 2k0·sinθ, in its leading term of large Ka. Parameters are
    those of :func:`wall_flash`, but that the soil's permittivity is complex.
    """
    k = 2 * wavenumber * sine
    cosine = math.sqrt(1 - sine**2)
    phase = np.exp(-1.25j * np.pi * side)
    transform = 4 * np.pi * hole.cap / k**2 * np.sqrt(1 / (2 * np.pi * k * hole.radius)) * phase
    level = math.sqrt(4 * math.pi) * wavenumber**2 * cosine**2 / np.pi * transform
    alpha_h, alpha_v = bragg_factors(np.array(cosine), np.array(sine), np.array(soil))
    return complex(level * alpha_h), complex(level * alpha_v)
