"""Bodies made of layers and zones, as the packaged mines are, in input files of gprMax."""

from __future__ import annotations

import itertools
import math
from typing import Literal

import numpy as np

from flgpr.simulate.bodies.signature import Body
from flgpr.simulate.scene.scene import Target
from flgpr.types import ArrayLike, Notes
from flgpr_exchange.gprmax.grid import CellGrid, numbers

Medium = float | Literal["metal"]


class Materials:
    """Names of the dielectrics in the files: metal and air have names of gprMax's own."""

    def __init__(self) -> None:
        self.names: dict[float, str] = {}  #: by relative permittivity

    def name_of(self, medium: Medium) -> str:
        """Return the name of a medium, which is written if it was not asked for before."""
        if medium == "metal":
            return "pec"
        if medium == 1.0:
            return "free_space"
        return self.names.setdefault(medium, f"body{len(self.names) + 1}")

    def lines(self) -> list[str]:
        """Return the lines that define all dielectrics."""
        return [f"#material: {eps:g} 0 1 0 {name}" for eps, name in self.names.items()]


def body_lines(
    body: Body, target: Target, grid: CellGrid, materials: Materials, omissions: Notes
) -> list[str]:
    """Return the lines of a body in the ground, layer by layer.

    A layer is a solid of its widest zone; the zones within overwrite it, the innermost last. A
    round body leans as the target does; a box has its heading and stands upright.

    Parameters
    ----------
    body : Body
        What the target is made of.
    target : Target
        Where it lies.
    grid : CellGrid
        Of the model.
    materials : Materials
        Those that are needed join it.
    omissions : list of str
        What is not written as it is joins it, in words.
    """
    name = f"the {body.name} at ({target.x:g}, {target.y:g}) m"
    if body.shape == "box" and target.tilt:
        omissions.append(f"the tilt of {name}: {math.degrees(target.tilt):.1f}°")
    thinnest = thinnest_disc(target, grid) if body.shape == "round" else grid.cell
    thin = [layer.thickness for layer in body.layers if layer.thickness < thinnest]
    if thin:
        omissions.append(
            f"the thickness of {len(thin)} layers of {name}: {1000 * min(thin):.0f} mm and more "
            f"became a cell, {1000 * thinnest:.0f} mm"
        )
    lines: list[str] = []
    edges = itertools.pairwise(body.drops())
    # From the bottom up, so that a thin layer that became a cell is not overwritten.
    for layer, (top, bottom) in reversed(list(zip(body.layers, edges, strict=True))):
        lower = max(bottom, top + thinnest)
        for width, medium in reversed(layer.zones):
            material = materials.name_of(medium)
            if body.shape == "box":
                lines += _box_lines(target, grid, width, body.elongation, top, lower, material)
            else:
                lines.append(disc(target, top, lower, width, grid, material))
    return lines


def disc(
    target: Target, upper: float, lower: float, radius: float, grid: CellGrid, material: str
) -> str:
    """Return the line of a disc about a target's leaning axis, at drops below its top, m."""
    lean = math.sin(target.tilt) * np.array([math.sin(target.azimuth), math.cos(target.azimuth)])
    axis = np.array([*lean, math.cos(target.tilt)])
    top = np.array([target.x, target.y, -target.depth])
    return rod(top - upper * axis, top - lower * axis, radius, grid, material)


def thinnest_disc(target: Target, grid: CellGrid) -> float:
    """Return the thinnest disc about a target's axis, m: gprMax wants its ends on two nodes."""
    return grid.cell / math.cos(target.tilt)


def rod(top: ArrayLike, bottom: ArrayLike, radius: float, grid: CellGrid, material: str) -> str:
    """Return the line of a cylinder between two places of the lane, m."""
    return f"#cylinder: {numbers(*grid.local(top), *grid.local(bottom), radius)} {material}"


def _box_lines(
    target: Target,
    grid: CellGrid,
    half_width: float,
    elongation: float,
    top: float,
    bottom: float,
    material: str,
) -> list[str]:
    """Return the lines of an upright box at the target's heading: two prisms on triangles."""
    # The long side lies along the heading, clockwise from +y.
    along = np.array([math.sin(target.heading), math.cos(target.heading)])
    across = np.array([along[1], -along[0]])
    centre = np.array([target.x, target.y])
    corners = []
    for side, end in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        level = centre + side * half_width * across + end * half_width * elongation * along
        corners.append(grid.local([*level, -target.depth - bottom]))
    lines = []
    for chosen in ((0, 1, 2), (0, 2, 3)):
        places = np.concatenate([corners[number] for number in chosen])
        lines.append(f"#triangle: {numbers(*places, bottom - top)} {material}")
    return lines
