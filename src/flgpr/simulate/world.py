"""The drawn world: targets, objects and wet patches of a scene, from its seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flgpr.model import OBJECT_COLUMNS, TRUTH_COLUMNS, check_objects, check_truth, empty_table
from flgpr.simulate.draw import stream
from flgpr.simulate.holes import Hole, draw_holes, hole_patches
from flgpr.simulate.scene import Patch, Scene, Target, Thing

_MARGIN = 35.0  # m of ground before and behind the lane that the radar may see


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
        lane = self.scene.lane
        rows = [
            {
                "target_id": f"T{i + 1:03d}",
                "x": t.x,
                "y": t.y,
                "kind": t.kind,
                "depth": t.depth,
                "radius": t.extent[0],
                "height": t.extent[1],
                "lane": self.scene.name,
            }
            for i, t in enumerate(self.targets)
            if lane.contains(t.x, t.y)
        ]
        return check_truth(pd.DataFrame(rows)) if rows else empty_table(TRUTH_COLUMNS)

    def objects_table(self) -> pd.DataFrame:
        """Table of everything else that stands in or beside the lane, empty holes too; it never scores."""
        things: list[tuple[float, float, str, float, float]] = []
        things += [(o.x, o.y, o.kind, o.radius, o.height) for o in self.objects]
        things += [(h.x, h.y, "hole", h.radius, h.cap) for h in self.holes if h.target is None]
        rows = [
            {"object_id": f"O{i + 1:04d}"} | dict(zip(("x", "y", "kind", "radius", "height"), thing, strict=True))
            for i, thing in enumerate(things)
        ]
        return check_objects(pd.DataFrame(rows)) if rows else empty_table(OBJECT_COLUMNS)


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
    middle, half = (scene.x_min + scene.x_max) / 2, (scene.x_max - scene.x_min) / 2
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
                gap=rng.uniform(0.01, 0.02) if draw.kind == "plastic" and draw.body is None else None,
                heading=headings[slot] if draw.body is not None else 0.0,
                tilt=math.hypot(lean, roll) if draw.depth >= 0 else 0.0,
                azimuth=math.atan2(roll, lean),
            )
        )
    return targets


def _draw_rocks(scene: Scene, seed: int) -> list[Thing]:
    rng = stream(seed, "rocks")
    side = scene.clutter.roadside[1]
    span = scene.length + 2 * _MARGIN
    count = rng.poisson(scene.clutter.rocks * 2 * side * span)
    return [
        Thing(
            kind="rock",
            x=rng.uniform(-side, side),
            y=rng.uniform(-_MARGIN, scene.length + _MARGIN),
            radius=min(0.02 + rng.exponential(0.02), 0.12),
        )
        for _ in range(count)
    ]


def _draw_roadside(scene: Scene, seed: int) -> list[Thing]:
    rng = stream(seed, "roadside")
    near, far = scene.clutter.roadside
    span = scene.length + 2 * _MARGIN
    things = []
    for kind, density in (("bush", scene.clutter.bushes), ("post", scene.clutter.posts)):
        for _ in range(rng.poisson(density * span)):
            x = rng.uniform(near, far) * rng.choice([-1, 1])
            y = rng.uniform(-_MARGIN, scene.length + _MARGIN)
            if kind == "bush":
                radius, height, level = rng.uniform(0.2, 0.7), rng.uniform(0.3, 1.0), rng.uniform(-20, -3)
                things.append(Thing(kind="bush", x=x, y=y, radius=radius, height=height, rcs_db=level))
            else:
                radius, height = rng.uniform(0.02, 0.06), rng.uniform(0.3, 1.0)
                things.append(Thing(kind="post", x=x, y=y, radius=radius, height=height))
    return things


def _draw_patches(scene: Scene, seed: int) -> list[Patch]:
    rng = stream(seed, "patches")
    side = scene.clutter.roadside[1]
    count = rng.poisson(scene.clutter.patches * 2 * side * (scene.length + 2 * _MARGIN))
    return [
        Patch(
            x=rng.uniform(-side, side),
            y=rng.uniform(-_MARGIN, scene.length + _MARGIN),
            radius=rng.uniform(0.4, 1.5),
            gain_db=rng.uniform(2, 6),
        )
        for _ in range(count)
    ]
