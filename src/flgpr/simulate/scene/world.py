"""The drawn world: targets, objects and patches of a scene, and its track, from a seed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import (
    OBJECT_COLUMNS,
    TRUTH_COLUMNS,
    Column,
    check_objects,
    check_truth,
    empty_table,
)
from flgpr.simulate.ground.holes import Hole, draw_holes, hole_patches
from flgpr.simulate.scene.draw import Wander, stream
from flgpr.simulate.scene.scene import Departure, Patch, Scene, SceneObject, Target, TargetDraw
from flgpr.types import FloatArray, floats

EVEN: dict[str, dict[str, bool]] = {
    table: {"on": False} for table in ("stones", "roots", "lenses", "heterogeneity")
}
"""Tables of a scene whose soil has nothing in it but its targets and holes."""
ALONE: dict[str, Any] = {"surface": {"echo": False}, "holes": {"on": False}, **EVEN}
"""Tables of a scene whose ground returns nothing but its targets."""
BARE = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
"""Clutter table of a lane on which nothing more is to be drawn."""
MARGIN = 35.0
"""Ground before and behind the lane that the radar may see, m."""
_SPEED = 2.0  # of the vehicle, m/s


@dataclass(frozen=True)
class World:
    """What a seed makes of a scene: everything that has a place, given and drawn."""

    scene: Scene
    seed: int
    targets: tuple[Target, ...]
    objects: tuple[SceneObject, ...]
    patches: tuple[Patch, ...]
    holes: tuple[Hole, ...] = ()  #: refilled holes, over targets and empty

    def truth(self) -> pd.DataFrame:
        """Return the truth table of the targets that lie in the lane."""
        rows = []
        laid = []
        for index, target in enumerate(self.targets):
            if not self.scene.lane.contains(target.x, target.y):
                continue
            name = f"T{index + 1:03d}"
            xy = (target.x, target.y)
            size = target.extent
            rows.append((name, *xy, target.kind, target.depth, *size, self.scene.name))
            laid.append(target.laid)
        truth = check_truth(_table(rows, TRUTH_COLUMNS))
        return truth.assign(laid=laid) if self.scene.drives else truth

    def objects_table(self) -> pd.DataFrame:
        """Return the table of all else that stands in or beside the lane, empty holes too.

        Nothing in it is scored.
        """
        entries: list[tuple[Any, ...]] = []
        for scene_object in self.objects:
            entries.append(
                (
                    scene_object.x,
                    scene_object.y,
                    scene_object.kind,
                    scene_object.radius,
                    scene_object.height,
                )
            )
        for hole in self.holes:
            if hole.target is None:
                entries.append((hole.x, hole.y, "hole", hole.radius, hole.cap))
        rows = [(f"O{index + 1:04d}", *entry) for index, entry in enumerate(entries)]
        return check_objects(_table(rows, OBJECT_COLUMNS))


def _table(rows: list[tuple[Any, ...]], columns: tuple[Column, ...]) -> pd.DataFrame:
    """Return a table of rows; without rows its columns still have their types."""
    if not rows:
        return empty_table(columns)
    return pd.DataFrame(rows, columns=[column.name for column in columns])


def draw_world(scene: Scene, seed: int) -> World:
    """Draw the targets, objects, patches and holes of a scene.

    Parameters
    ----------
    scene : Scene
        What is given and what is to be drawn.
    seed : int
        The same seed gives the same world, bit for bit.

    Returns
    -------
    World
        What is given before what is drawn.
    """
    targets = (*scene.targets, *_draw_targets(scene, seed))
    objects = (*scene.objects, *_draw_rocks(scene, seed), *_draw_roadside(scene, seed))
    holes = draw_holes(scene, targets, seed)
    targets, holes = _at_drive(scene.drive, targets, holes)
    patches = (*scene.patches, *_draw_patches(scene, seed), *hole_patches(scene, holes))
    return World(scene, seed, targets, objects, patches, holes)


def _at_drive(
    drive: int, targets: tuple[Target, ...], holes: tuple[Hole, ...]
) -> tuple[tuple[Target, ...], tuple[Hole, ...]]:
    """Return the targets that lie there at a drive, and the holes that have been dug until then."""
    numbers: dict[int, int] = {}  # of the targets that lie there, among themselves
    dug = []
    for index, target in enumerate(targets):
        if target.laid <= drive and not (target.lifted is not None and target.lifted <= drive):
            numbers[index] = len(numbers)
    for hole in holes:
        if hole.target is None or targets[hole.target].laid <= drive:
            number = None if hole.target is None else numbers.get(hole.target)
            dug.append(hole._replace(target=number))
    return tuple(targets[index] for index in numbers), tuple(dug)


def _draw_targets(scene: Scene, seed: int) -> list[Target]:
    """Draw targets on an even grid along the lane in random order, off it by their jitter."""
    rng = stream(seed, "targets")
    draws: list[TargetDraw] = []
    for draw in scene.draws:
        draws.extend([draw] * draw.count)
    order = rng.permutation(len(draws))
    pitch = scene.length / max(len(draws), 1)
    headings = stream(seed, "headings").uniform(0, math.pi, len(draws))
    targets = []
    for slot, index in enumerate(order):
        target = _draw_target(scene, draws[index], slot, pitch, headings[slot], rng)
        targets.append(target)
    return targets


def _draw_target(
    scene: Scene,
    draw: TargetDraw,
    slot: int,
    pitch: float,
    heading: float,
    rng: np.random.Generator,
) -> Target:
    """Draw the target in a slot of the grid; the order of the random numbers fixes the world."""
    middle = (scene.x_min + scene.x_max) / 2
    half_width = (scene.x_max - scene.x_min) / 2
    # No target comes within 10 cm of the lane's edge.
    room = max(half_width - draw.radius - 0.1, 0.0)
    offset = np.clip(rng.normal(0, draw.position_jitter), -0.3 * pitch, 0.3 * pitch)
    lean, roll = rng.normal(0, draw.tilt, 2)
    depth = draw.depth + rng.normal(0, draw.depth_jitter)
    x = middle + rng.uniform(-room, room)
    buried = draw.depth >= 0
    gap = None
    if draw.kind == "plastic" and draw.body is None:
        gap = rng.uniform(0.01, 0.02)
    return Target(
        kind=draw.kind,
        x=x,
        y=(slot + 0.5) * pitch + offset,
        depth=max(depth, 0.0) if buried else draw.depth,
        body=draw.body,
        radius=draw.radius,
        height=draw.height,
        gap=gap,
        heading=heading if draw.body is not None else 0.0,
        tilt=math.hypot(lean, roll) if buried else 0.0,
        azimuth=math.atan2(roll, lean),
        laid=draw.laid,
        lifted=draw.lifted,
    )


def _places_beside(
    scene: Scene, rng: np.random.Generator, density: float
) -> Iterator[tuple[float, float]]:
    """Draw positions on and beside the lane, m, of so many things per m², one after the other."""
    side = scene.clutter.roadside[1]
    count = rng.poisson(density * 2 * side * (scene.length + 2 * MARGIN))
    for _ in range(count):
        x = rng.uniform(-side, side)
        yield x, rng.uniform(-MARGIN, scene.length + MARGIN)


def _draw_rocks(scene: Scene, seed: int) -> list[SceneObject]:
    """Draw the rocks on and beside the lane; their radii are 2 cm and exponential above it."""
    rng = stream(seed, "rocks")
    moving = stream(seed, "moved rocks", scene.drive)
    moved_share = scene.change.rocks
    side = scene.clutter.roadside[1]
    rocks = []
    for x, y in _places_beside(scene, rng, scene.clutter.rocks):
        radius = min(0.02 + rng.exponential(0.02), 0.12)
        if moved_share > 0:
            chance, across, along = moving.random(3)
            if chance < moved_share:
                x, y = side * (2 * across - 1), along * (scene.length + 2 * MARGIN) - MARGIN
        rocks.append(SceneObject(kind="rock", x=x, y=y, radius=radius))
    return rocks


def _draw_roadside(scene: Scene, seed: int) -> list[SceneObject]:
    """Draw the bushes and then the posts on both sides of the lane."""
    rng = stream(seed, "roadside")
    nearest, farthest = scene.clutter.roadside
    drawn = []
    for kind, density in (("bush", scene.clutter.bushes), ("post", scene.clutter.posts)):
        for _ in range(rng.poisson(density * (scene.length + 2 * MARGIN))):
            # In this order: the random numbers fix the world of a seed.
            entries: dict[str, Any] = {
                "kind": kind,
                "x": rng.uniform(nearest, farthest) * rng.choice([-1, 1]),
                "y": rng.uniform(-MARGIN, scene.length + MARGIN),
                "radius": rng.uniform(0.2, 0.7) if kind == "bush" else rng.uniform(0.02, 0.06),
                "height": rng.uniform(0.3, 1.0),
            }
            if kind == "bush":
                entries["rcs_db"] = rng.uniform(-20, -3)
            drawn.append(SceneObject(**entries))
    return drawn


def _draw_patches(scene: Scene, seed: int) -> list[Patch]:
    """Draw the wet patches on and beside the lane."""
    rng = stream(seed, "patches")
    patches = []
    for x, y in _places_beside(scene, rng, scene.clutter.patches):
        radius = rng.uniform(0.4, 1.5)
        gain_db = rng.uniform(2, 6)
        patches.append(Patch(x=x, y=y, radius=radius, gain_db=gain_db))
    return patches


def world_description(scene: Scene, seed: int) -> dict[str, Any]:
    """Return a scene's entries with the targets, objects and patches that the seed draws.

    Nothing is left to be drawn: a scene of these entries has the same world for every seed, but for
    the holes, whose patches are therefore not listed.

    Parameters
    ----------
    scene : Scene
        What is given and what is to be drawn.
    seed : int
        Seed of the world.

    Returns
    -------
    dict
        Entries of a :class:`Scene`.
    """
    world = draw_world(scene, seed)
    # Patches over holes stand last, and are made again from the holes.
    of_holes = len(hole_patches(scene, world.holes))
    patches = world.patches[: len(world.patches) - of_holes]
    entries = scene.model_dump(exclude_unset=True, exclude={"draws"})
    entries["targets"] = [target.model_dump() for target in world.targets]
    entries["objects"] = [scene_object.model_dump() for scene_object in world.objects]
    entries["patches"] = [patch.model_dump() for patch in patches]
    entries["clutter"] = BARE
    return entries


def draw_track(scene: Scene, height: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Draw the poses and times of all scans.

    The vehicle drives at 2 m/s and takes one scan a second while it stands.

    Parameters
    ----------
    scene : Scene
        Its ``track`` says how the vehicle drives.
    height : float
        Height of the array over the mean ground, m.
    seed : int
        Seed of the world.

    Returns
    -------
    pose : ndarray (scan, 6)
        Poses in the lane frame, m and rad.
    time : ndarray (scan,)
        Times from the first scan on, s.

    Raises
    ------
    ValueError
        If the track holds no scan.
    """
    track = scene.track
    rng = stream(seed, "track", scene.drive - 1)
    y, seconds = _positions(scene, rng)
    pose = np.zeros((y.size, 6))
    pose[:, 1] = y
    if track.wander > 0:
        pose[:, 0], slope = Wander(rng, track.wander, track.wander_length)(y)
        pose[:, 3] = np.arctan(slope)
    pose[:, 0] += (scene.x_min + scene.x_max) / 2 + scene.change.beside
    # In this order: the random numbers fix the track of a seed.
    pose[:, 2] = height + scene.change.higher + rng.normal(0, track.bounce, y.size)
    pose[:, 4:] = rng.normal(0, track.attitude, (y.size, 2))
    return floats(pose), floats(seconds)


def _positions(scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return positions along the lane, m, and times, s, of all scans."""
    track = scene.track
    if track.positions is not None:
        exact = floats(track.positions)
        return exact, np.arange(exact.size, dtype=np.float64)
    start, end = scene.track_ends
    stops = sorted(track.stops)
    y = []
    seconds = []
    position = start
    clock = 0.0
    while position <= end:
        departure = _departure_at(scene, position)
        if departure is not None:
            clock += departure.length / _SPEED
            position = departure.start + departure.length
            continue
        y.append(position)
        seconds.append(clock)
        while stops and stops[0][0] <= position:
            _, scans = stops.pop(0)
            for _ in range(scans):
                clock += 1.0
                y.append(position)
                seconds.append(clock)
        stride = rng.uniform(*track.step)
        position += stride
        clock += stride / _SPEED
    if not y:
        raise ValueError(
            f"track must hold at least one scan, got none from {start:g} m to {end:g} m"
        )
    return floats(y), floats(seconds)


def _departure_at(scene: Scene, position: float) -> Departure | None:
    """Return the departure that holds a position along the lane, or None."""
    for departure in scene.track.departures:
        if departure.start <= position < departure.start + departure.length:
            return departure
    return None
