"""The drawn world: targets, objects and wet patches of a scene, and the vehicle's way, from its seed."""

from __future__ import annotations

import math
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
from flgpr.model.arrays import FloatArray
from flgpr.simulate.ground.holes import Hole, draw_holes, hole_patches
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Patch, Scene, Target, Thing

EVEN: dict[str, dict[str, bool]] = {
    part: {"on": False} for part in ("stones", "roots", "lenses", "heterogeneity")
}
"""Parts of a scene whose soil has nothing in it but its targets and holes."""
ALONE: dict[str, Any] = {"surface": {"echo": False}, "holes": {"on": False}, **EVEN}
"""Parts of a scene whose ground returns nothing but its targets."""
BARE = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
"""Clutter of a lane on which nothing more is to be drawn."""
MARGIN = 35.0
"""Ground before and behind the lane that the radar may see, m."""


@dataclass(frozen=True)
class World:
    """What a seed made of a scene."""

    scene: Scene
    seed: int
    targets: tuple[Target, ...]  #: as all else with a place, given and drawn
    objects: tuple[Thing, ...]
    patches: tuple[Patch, ...]
    holes: tuple[Hole, ...] = ()  #: refilled holes, over targets and empty

    def truth(self) -> pd.DataFrame:
        """Truth table of the targets that lie in the lane."""
        rows = [
            (f"T{i + 1:03d}", t.x, t.y, t.kind, t.depth, *t.extent, self.scene.name)
            for i, t in enumerate(self.targets)
            if self.scene.lane.contains(t.x, t.y)
        ]
        return check_truth(_table(rows, TRUTH_COLUMNS))

    def objects_table(self) -> pd.DataFrame:
        """Table of everything else that stands in or beside the lane, empty holes too; it never scores."""
        things: list[tuple[Any, ...]] = [
            (o.x, o.y, o.kind, o.radius, o.height) for o in self.objects
        ]
        things += [(h.x, h.y, "hole", h.radius, h.cap) for h in self.holes if h.target is None]
        rows = [(f"O{i + 1:04d}", *thing) for i, thing in enumerate(things)]
        return check_objects(_table(rows, OBJECT_COLUMNS))


def _table(rows: list[tuple[Any, ...]], columns: tuple[Column, ...]) -> pd.DataFrame:
    return (
        pd.DataFrame(rows, columns=[column.name for column in columns])
        if rows
        else empty_table(columns)
    )


def draw_world(scene: Scene, seed: int) -> World:
    """Draw the targets, objects and patches of a scene: the same seed gives the same world, bit for bit."""
    targets = (*scene.targets, *_draw_targets(scene, seed))
    objects = (*scene.objects, *_draw_rocks(scene, seed), *_draw_roadside(scene, seed))
    holes = draw_holes(scene, targets, seed)
    patches = (*scene.patches, *_draw_patches(scene, seed), *hole_patches(scene, holes))
    return World(scene, seed, targets, objects, patches, holes)


def _draw_targets(scene: Scene, seed: int) -> list[Target]:
    """Put the drawn targets on an even grid along the lane in random order, off it by their jitter."""
    rng = stream(seed, "targets")
    wanted = [draw for draw in scene.draws for _ in range(draw.count)]
    order = rng.permutation(len(wanted))
    pitch = scene.length / max(len(wanted), 1)
    middle = (scene.x_min + scene.x_max) / 2
    half = (scene.x_max - scene.x_min) / 2
    targets = []
    headings = stream(seed, "headings").uniform(0, math.pi, len(wanted))
    for slot, index in enumerate(order):
        draw = wanted[index]
        room = max(half - draw.radius - 0.1, 0.0)
        offset = np.clip(rng.normal(0, draw.position_jitter), -0.3 * pitch, 0.3 * pitch)
        lean, roll = rng.normal(0, draw.tilt, 2)
        depth = draw.depth + rng.normal(0, draw.depth_jitter)
        targets.append(
            Target(
                kind=draw.kind,
                x=middle + rng.uniform(-room, room),
                y=(slot + 0.5) * pitch + offset,
                depth=max(depth, 0.0) if draw.depth >= 0 else draw.depth,
                body=draw.body,
                radius=draw.radius,
                height=draw.height,
                gap=rng.uniform(0.01, 0.02)
                if draw.kind == "plastic" and draw.body is None
                else None,
                heading=headings[slot] if draw.body is not None else 0.0,
                tilt=math.hypot(lean, roll) if draw.depth >= 0 else 0.0,
                azimuth=math.atan2(roll, lean),
            )
        )
    return targets


def _draw_rocks(scene: Scene, seed: int) -> list[Thing]:
    rng = stream(seed, "rocks")
    side = scene.clutter.roadside[1]
    ends = (-MARGIN, scene.length + MARGIN)
    count = rng.poisson(scene.clutter.rocks * 2 * side * (scene.length + 2 * MARGIN))
    draws = (
        (rng.uniform(-side, side), rng.uniform(*ends), rng.exponential(0.02)) for _ in range(count)
    )
    return [Thing(kind="rock", x=x, y=y, radius=min(0.02 + size, 0.12)) for x, y, size in draws]


def _draw_roadside(scene: Scene, seed: int) -> list[Thing]:
    rng = stream(seed, "roadside")
    near, far = scene.clutter.roadside
    span = scene.length + 2 * MARGIN
    things = []
    for kind, density in (("bush", scene.clutter.bushes), ("post", scene.clutter.posts)):
        for _ in range(rng.poisson(density * span)):
            x = rng.uniform(near, far) * rng.choice([-1, 1])
            y = rng.uniform(-MARGIN, scene.length + MARGIN)
            if kind == "bush":
                radius = rng.uniform(0.2, 0.7)
                height = rng.uniform(0.3, 1.0)
                level = rng.uniform(-20, -3)
                things.append(
                    Thing(kind="bush", x=x, y=y, radius=radius, height=height, rcs_db=level)
                )
            else:
                radius = rng.uniform(0.02, 0.06)
                height = rng.uniform(0.3, 1.0)
                things.append(Thing(kind="post", x=x, y=y, radius=radius, height=height))
    return things


def _draw_patches(scene: Scene, seed: int) -> list[Patch]:
    rng = stream(seed, "patches")
    side = scene.clutter.roadside[1]
    ends = (-MARGIN, scene.length + MARGIN)
    count = rng.poisson(scene.clutter.patches * 2 * side * (scene.length + 2 * MARGIN))
    return [
        Patch(
            x=rng.uniform(-side, side),
            y=rng.uniform(*ends),
            radius=rng.uniform(0.4, 1.5),
            gain_db=rng.uniform(2, 6),
        )
        for _ in range(count)
    ]


def told(scene: Scene, seed: int) -> dict[str, Any]:
    """Tell a scene with the targets, objects and patches that the seed put there; nothing is left to be drawn."""
    world = draw_world(scene, seed)
    data = scene.model_dump(exclude_unset=True, exclude={"draws"})
    patches = world.patches[
        : len(world.patches) - len(hole_patches(scene, world.holes))
    ]  # those of holes come again
    things = {"targets": world.targets, "objects": world.objects, "patches": patches}
    return (
        data
        | {part: [one.model_dump() for one in some] for part, some in things.items()}
        | {"clutter": BARE}
    )


def draw_track(scene: Scene, height: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Draw poses (scan, 6), ``height`` m up, and times of all scans: at 2 m/s, one a second while it stands."""
    track = scene.track
    rng = stream(seed, "track")
    y, seconds = _positions(scene, rng)
    pose = np.zeros((y.size, 6))
    pose[:, 1] = y
    if track.wander > 0:
        wave = 2 * np.pi / track.wander_length * rng.uniform(0.5, 1.5, 3)
        phase = rng.uniform(0, 2 * np.pi, 3)
        size = track.wander * np.sqrt(2 / 3)
        pose[:, 0] = size * np.sin(np.outer(y, wave) + phase).sum(axis=1)
        pose[:, 3] = np.arctan(size * (wave * np.cos(np.outer(y, wave) + phase)).sum(axis=1))
    pose[:, 0] += (scene.x_min + scene.x_max) / 2
    pose[:, 2] = height + rng.normal(0, track.bounce, y.size)
    pose[:, 4:] = rng.normal(0, track.attitude, (y.size, 2))
    return np.asarray(pose, dtype=np.float64), np.asarray(seconds, dtype=np.float64)


def _positions(scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    track = scene.track
    if track.positions is not None:
        exact = np.asarray(track.positions, dtype=float)
        return exact, np.arange(exact.size, dtype=np.float64)
    place = -20.0 if track.start is None else track.start
    end = scene.length - 5.0 if track.stop is None else track.stop
    stops = sorted(track.stops)
    y = []
    seconds = []
    clock = 0.0
    while place <= end:
        inside = next((d for d in track.departures if d.start <= place < d.start + d.length), None)
        if inside is not None:
            clock += inside.length / 2.0
            place = inside.start + inside.length
            continue
        y.append(place)
        seconds.append(clock)
        while stops and stops[0][0] <= place:
            for _ in range(stops.pop(0)[1]):
                clock += 1.0
                y.append(place)
                seconds.append(clock)
        stride = rng.uniform(*track.step)
        place += stride
        clock += stride / 2.0
    if not y:
        raise ValueError(
            f"track must hold at least one scan, got none from {place:g} m to {end:g} m"
        )
    return np.asarray(y, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
