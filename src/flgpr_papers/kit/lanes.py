"""Lanes seen again: with all that a seed put there told one by one, from the other end, or with parts changed."""

from __future__ import annotations

import math
from typing import Any

from flgpr.simulate import Scene, told


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
