"""Lanes seen again: with all that a seed put there told one by one, from the other end, or with parts changed."""

from __future__ import annotations

import math
from typing import Any

from flgpr.simulate import Scene, draw_world

EVEN: dict[str, dict[str, bool]] = {part: {"on": False} for part in ("stones", "roots", "lenses", "heterogeneity")}
"""Parts of a scene whose soil has nothing in it but its targets and holes."""
ALONE: dict[str, Any] = {"surface": {"echo": False}, "holes": {"on": False}, **EVEN}
"""Parts of a scene whose ground returns nothing but its targets."""
BARE = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
"""Clutter of a lane on which nothing more is to be drawn."""


def told(scene: Scene, seed: int) -> dict[str, Any]:
    """Tell a scene with the targets, objects and patches that the seed put there; nothing is left to be drawn."""
    world, data = draw_world(scene, seed), scene.model_dump(exclude_unset=True, exclude={"draws"})
    data |= {part: [one.model_dump() for one in getattr(world, part)] for part in ("targets", "objects", "patches")}
    return data | {"clutter": BARE}


def turned(scene: Scene, seed: int) -> Scene:
    """Turn a lane by half a turn with all that the seed put there, as a vehicle sees it that comes from the other end.

    Targets keep their order.
    """
    data = told(scene, seed)
    for thing in (*data["targets"], *data["objects"], *data["patches"]):
        thing["x"], thing["y"] = -thing["x"], scene.length - thing["y"]
        if "azimuth" in thing:
            thing["azimuth"] += math.pi
    return Scene.model_validate(data)


def changed(scene: Scene, targets: list[Any] | None = None, **parts: dict[str, Any]) -> Scene:
    """Make a scene anew with some entries of its parts replaced."""
    data = scene.model_dump(exclude_unset=True)
    for part, entries in parts.items():
        data[part] = {**data.get(part, {}), **entries}
    return Scene.model_validate(data if targets is None else data | {"targets": targets})
