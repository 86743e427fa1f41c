"""A scene as solids of gprMax: boxes of soil, spheres and rods of objects, discs of targets."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from typing import Literal

import numpy as np

from flgpr.simulate.bodies.rims import Profile
from flgpr.simulate.bodies.signature import Body
from flgpr.simulate.bodies.signature.table import find_body
from flgpr.simulate.ground.roughness import surface_heights
from flgpr.simulate.scene.scene import Scene, SceneObject, Target
from flgpr.simulate.scene.world import World
from flgpr.types import AnyArray, ArrayLike, Notes
from flgpr_exchange.gprmax.grid import CellGrid, RelaxingMedium, numbers, rectangles

Medium = float | Literal["metal"]
_ROCK = 6.0  # permittivity, as the simulator's own rocks


def densest_body(world: World) -> float:
    """Return the greatest permittivity of the dielectric bodies in a world, 1 without any."""
    values = [1.0]
    for target in world.targets:
        if target.body is not None:
            values.append(find_body(target.body).densest())
        elif target.dielectric is not None:
            values.append(target.dielectric)
    values += [_ROCK for scene_object in world.objects if scene_object.kind == "rock"]
    return max(values)


def scene_text(
    scene: Scene,
    world: World,
    grid: CellGrid,
    soils: list[RelaxingMedium],
    seed: int,
    omissions: Notes,
) -> tuple[str, dict[str, float]]:
    """Return everything that does not change from run to run: soil, surface, objects, targets.

    Parameters
    ----------
    scene : Scene
        Its soil and surface.
    world : World
        Its targets and objects.
    grid : CellGrid
        Where the nodes lie.
    soils : list of RelaxingMedium
        Of each layer, the uppermost first.
    seed : int
        Draws the surface's heights.
    omissions : list of str
        What cannot be written joins it, in words.

    Returns
    -------
    text : str
        Lines of gprMax's commands.
    surface : dict of str to float
        Rms of the surface's heights before and after they are rounded to nodes, m.

    Raises
    ------
    ValueError
        If a target does not lie on the lane.
    """
    lines = []
    for number, soil in enumerate(soils, start=1):
        lines.append(f"#material: {numbers(soil.permittivity, soil.conductivity)} 1 0 soil{number}")
        if soil.poles:
            poles = numbers(*itertools.chain(*soil.poles))
            lines.append(f"#add_dispersion_debye: {len(soil.poles)} {poles} soil{number}")
    ground, rough = _ground(scene, grid, seed, len(soils))
    lines += ground
    for target in world.targets:
        if not grid.contains((target.x, target.y, 0.0), target.extent[0]):
            raise ValueError(
                f"every target must lie on the lane, got one at x = {target.x:g}, "
                f"y = {target.y:g} m"
            )
    lines += _objects(world.objects, grid, rough["rms_height"], omissions)
    materials = Materials()
    for target in world.targets:
        if target.body is None:
            lines += _generic_mine(target, grid, materials, omissions)
        else:
            lines += body_lines(find_body(target.body), target, grid, materials, omissions)
    return "\n".join([*materials.lines(), *lines]) + "\n", rough


def _ground(
    scene: Scene, grid: CellGrid, seed: int, soils: int
) -> tuple[list[str], dict[str, float]]:
    """Return the boxes of all soils, and how rough the surface is before and after rounding."""
    cell = grid.cell
    level = round(-grid.origin[2] / cell)
    steps, rms_height = _surface_steps(scene, grid, seed)
    lowest = int(steps.min())
    highest = int(steps.max())
    below = level * cell
    edges = [level + lowest]
    for layer in scene.soil.layers:
        below -= layer.thickness
        edges.append(max(round(below / cell), 0))
    edges = [*edges, 0][: soils + 1]
    width, length, _ = grid.shape
    lines = []
    for number, (top, floor) in enumerate(itertools.pairwise(edges), start=1):
        if top > floor:
            lines.append(_box(0, width, 0, length, floor, top, cell, f"soil{number}"))
    for step in range(lowest + 1, highest + 1):
        for area in rectangles(steps >= step):
            lines.append(_box(*area, level + step - 1, level + step, cell, "soil1"))
    rough = {"rms_height": rms_height, "rms_height_on_grid": float(steps.std() * cell)}
    return lines, rough


def _surface_steps(scene: Scene, grid: CellGrid, seed: int) -> tuple[AnyArray, float]:
    """Return the surface's heights in cells (i, j), and the rms of the exact ones, m."""
    surface = scene.surface
    rough = surface.rms_height + surface.unevenness > 0
    if not (rough and (surface.echo or surface.phase_screen)):
        return np.zeros(grid.shape[:2], dtype=int), 0.0
    heights = surface_heights(surface, seed)
    # Inside the absorbing layers the ground goes on as it enters them.
    x, y = (
        (np.clip(np.arange(count), grid.absorber, count - 1 - grid.absorber) + 0.5) * grid.cell
        + start
        for count, start in zip(grid.shape[:2], grid.origin[:2], strict=True)
    )
    exact = np.stack([heights(x[i], y) for i in range(x.size)])
    return np.rint(exact / grid.cell).astype(int), float(exact.std())


def _box(i0: int, i1: int, j0: int, j1: int, k0: int, k1: int, cell: float, material: str) -> str:
    """Return the line of a box between nodes."""
    corners = numbers(*(n * cell for n in (i0, j0, k0, i1, j1, k1)))
    return f"#box: {corners} {material}"


def _objects(
    objects: tuple[SceneObject, ...], grid: CellGrid, rms_height: float, omissions: Notes
) -> list[str]:
    """Return the lines of rocks and posts; all else joins the omissions."""
    lines = []
    outside = 0
    without_body: Counter[str] = Counter()
    for scene_object in objects:
        x, y, radius = scene_object.x, scene_object.y, scene_object.radius
        if not grid.contains((x, y, 0.0), radius):
            outside += 1
        elif scene_object.kind == "rock":
            lines.append(f"#sphere: {numbers(*grid.local((x, y, 0.0)), radius)} rock")
        elif scene_object.kind == "post" and scene_object.height >= grid.cell:
            # Deep enough to reach the ground in the deepest trough.
            foot = -grid.cell * math.ceil(3 * rms_height / grid.cell)
            lines.append(rod((x, y, scene_object.height), (x, y, foot), radius, grid, "pec"))
        else:
            without_body[scene_object.kind] += 1
    if any(line.startswith("#sphere") for line in lines):
        lines.insert(0, f"#material: {_ROCK:g} 0 1 0 rock")
    for kind, count in without_body.items():
        omissions.append(f"{count} of kind {kind}: no body to write")
    if outside:
        omissions.append(f"{outside} objects that stand outside the model")
    return lines


def _generic_mine(
    target: Target, grid: CellGrid, materials: Materials, omissions: Notes
) -> list[str]:
    """Return the lines of a generic mine, a body of revolution about its leaning axis.

    These are discs of its profile, the air gap under its top last.
    """
    medium: Medium = "metal" if target.dielectric is None else target.dielectric
    material = materials.name_of(medium)
    thinnest = thinnest_disc(target, grid)
    name = f"the {target.kind} at ({target.x:g}, {target.y:g}) m"
    cell = f"became a cell, {1000 * thinnest:.0f} mm"
    height = target.extent[1]
    if height < thinnest:
        omissions.append(f"the height of {name}: {1000 * height:.0f} mm {cell}")
    discs = _discs(target.outline, max(thinnest, 1e-9))
    lines = [disc(target, upper, lower, radius, grid, material) for radius, upper, lower in discs]
    gap = 0.0
    if target.dielectric is not None:
        gap = min(target.air_gap, 0.9 * target.height)
    if 0 < gap < thinnest:
        omissions.append(f"the air gap of {name}: {1000 * gap:.0f} mm {cell}")
        gap = thinnest
    if gap > 0:
        lines.append(disc(target, 0.0, gap, discs[0][0], grid, "free_space"))
    return lines


def _discs(profile: Profile, thinnest: float) -> list[tuple[float, float, float]]:
    """Return the discs (radius, upper drop, lower drop), m, of a body of revolution.

    None is thinner than ``thinnest``; discs of one radius are joined.
    """
    bottom = profile[-1][1]
    height = max(bottom, thinnest)
    count = max(1, math.floor(height / thinnest + 1e-9))
    discs: list[tuple[float, float, float]] = []
    for upper, lower in itertools.pairwise(np.linspace(0.0, height, count + 1).tolist()):
        middle = min((upper + lower) / 2, 0.999 * bottom)
        widest = 0.0  # radius of the profile there
        for (r0, d0), (r1, d1) in itertools.pairwise(profile):
            if min(d0, d1) <= middle <= max(d0, d1) and d0 != d1:
                widest = max(widest, r0 + (r1 - r0) * (middle - d0) / (d1 - d0))
        if discs and abs(discs[-1][0] - widest) < 1e-12:
            discs[-1] = (widest, discs[-1][1], lower)
        elif widest > 0:
            discs.append((widest, upper, lower))
    return discs


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
