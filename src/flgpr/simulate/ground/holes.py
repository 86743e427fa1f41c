"""Holes dug and filled again: where they are, what they do to the way to a target, and their own echo."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.bodies.echoes import Ground
from flgpr.simulate.ground.inclusions import disc_flash
from flgpr.simulate.ground.roughness import bragg_factors
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Patch, Scene, Target


class Hole(NamedTuple):
    """A refilled hole, with the index of the target in it, if any.

    ``looseness`` is the density of the fill over that of the soil around, ``moisture`` its additional volumetric
    moisture, m³/m³, ``cap`` the height of its top over the surface.
    """

    x: float
    y: float
    radius: float
    depth: float
    looseness: float
    moisture: float
    cap: float
    target: int | None = None

    def fill(self, soil: ComplexArray, frequency: FloatArray) -> ComplexArray:
        """Permittivity of the fill (frequency,) for that of the soil around: refractive mixing (Birchak et al. 1974).

        The solids and water of the soil thin out with its density, and the water added takes the place of air.
        """
        index = (
            1
            + (np.sqrt(soil) - 1) * self.looseness
            + (np.sqrt(water(frequency)) - 1) * self.moisture
        )
        return np.asarray(np.where(index.real > 1, index, 1.0) ** 2)


def water(frequency: ArrayLike) -> ComplexArray:
    """Permittivity of fresh water at 20 °C by frequency (Hz): Debye (Ulaby, Moore & Fung 1986, App. E)."""
    return np.asarray(4.9 + 75.2 / (1 + 2j * np.pi * np.asarray(frequency, dtype=float) * 9.23e-12))


def draw_holes(scene: Scene, targets: tuple[Target, ...], seed: int) -> tuple[Hole, ...]:
    """Draw the holes over targets, in their order, and then the empty ones in the lane."""
    table = scene.holes
    if not table.on:
        return ()
    return (*_over_targets(scene, targets, seed), *_empty(scene, seed))


def _over_targets(scene: Scene, targets: tuple[Target, ...], seed: int) -> list[Hole]:
    holes = []
    table = scene.holes
    for index, target in enumerate(targets):
        rng = stream(seed, "hole", index)
        if target.depth < 0 or rng.random() >= table.over:
            continue
        width, height = target.extent
        radius = width + rng.uniform(*table.margin)
        holes.append(
            Hole(target.x, target.y, radius, target.depth + height, *_fill(scene, rng), index)
        )
    return holes


def _empty(scene: Scene, seed: int) -> list[Hole]:
    rng = stream(seed, "holes")
    table = scene.holes
    return [
        Hole(
            rng.uniform(scene.x_min, scene.x_max),
            rng.uniform(0, scene.length),
            rng.uniform(*table.radius),
            rng.uniform(*table.depth),
            *_fill(scene, rng),
        )
        for _ in range(rng.poisson(table.empty * scene.lane.area))
    ]


def _fill(scene: Scene, rng: np.random.Generator) -> tuple[float, float, float]:
    table = scene.holes
    return rng.uniform(*table.looseness), rng.normal(0, table.moisture), rng.normal(0, table.cap)


def hole_patches(scene: Scene, holes: tuple[Hole, ...]) -> tuple[Patch, ...]:
    """Rougher ground where a hole was filled."""
    if scene.holes.rough_db == 0:
        return ()
    return tuple(Patch(x=h.x, y=h.y, radius=h.radius, gain_db=scene.holes.rough_db) for h in holes)


def hole_factor(
    hole: Hole, depth: float, sine: float, ground: Ground
) -> tuple[float, ComplexArray]:
    """Change of the way to a point in a hole, against the undisturbed soil, at a depth under the mean surface.

    ``extra`` is the path gained one way at the band's middle, m; ``factor`` (frequency,) what is left of the amplitude
    both ways, and the phase beyond ``extra``. The cap lies on top of the depth; the sine is that in air.
    """
    fill = hole.fill(ground.media[0], ground.frequency)
    thickness = max(min(depth, hole.depth) + hole.cap, 0.0)
    above = thickness - min(depth, hole.depth)  # of the cap: soil instead of air
    cosine = math.sqrt(1 - sine**2)
    passed = thickness * np.sqrt(fill - sine**2) - above * cosine
    passed = passed - min(depth, hole.depth) * np.sqrt(ground.media[0] - sine**2)
    extra = float(passed[ground.frequency.size // 2].real)
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
    """Amplitude of the near (``side`` 1) or far (-1) flash of a hole's upper edge (Born), m; the lower's is opposite.

    ``k0²/4π·δε·πa²`` times :func:`~flgpr.simulate.ground.inclusions.disc_flash` and the depth's end point
    ``1/(2jk0·sqrt(ε - sin²θ))``, weakened by the wall's unevenness, ``exp(-(2k0·w·sinθ)²/2)``.
    """
    across = 2 * wavenumber * wall * sine
    end = 1 / (2j * wavenumber * math.sqrt(soil - sine**2))
    flash = disc_flash(hole.radius, wavenumber, sine, side) * end * math.exp(-0.5 * across**2)
    return complex(math.sqrt(4 * math.pi) * wavenumber**2 / 4 * contrast * hole.radius**2 * flash)


def cap_flash(
    hole: Hole, soil: complex, sine: float, wavenumber: float, side: float
) -> tuple[complex, complex]:
    """Amplitude of the flash of the cap's edge, HH and VV, m.

    Small perturbation by the deterministic height ``h·(1 - r²/a²)``: ``k0²cos²θ·α/π`` times its transform
    ``4πh·J_2(Ka)/K²``, K = 2k0·sinθ, in its leading term of large Ka.
    """
    k = 2 * wavenumber * sine
    cosine = math.sqrt(1 - sine**2)
    phase = np.exp(-1.25j * np.pi * side)
    transform = 4 * np.pi * hole.cap / k**2 * np.sqrt(1 / (2 * np.pi * k * hole.radius)) * phase
    level = math.sqrt(4 * math.pi) * wavenumber**2 * cosine**2 / np.pi * transform
    alpha_h, alpha_v = bragg_factors(np.array(cosine), np.array(sine), np.array(soil))
    return complex(level * alpha_h), complex(level * alpha_v)
