"""Changes of a scene that the studies share: turned by half a turn, and with some entries replaced."""

from __future__ import annotations

import math
from typing import Any

from flgpr.simulate import Scene, world_description
from flgpr.types import Entries


def turned(scene: Scene, seed: int) -> Scene:
    """Turn a lane by half a turn with all that the seed put there.

    Targets stay in their order, which seen from the other end is the opposite one.

    Parameters
    ----------
    scene : Scene
        The lane.
    seed : int
        Seed of what the scene leaves to chance.
    """
    data = world_description(scene, seed)
    for entry in (*data["targets"], *data["objects"], *data["patches"]):
        entry["x"] = -entry["x"]
        entry["y"] = scene.length - entry["y"]
        if "azimuth" in entry:
            entry["azimuth"] += math.pi
    return Scene.model_validate(data)


def changed(scene: Scene, targets: list[Any] | None = None, **tables: Entries) -> Scene:
    """Return a scene with some entries of its tables replaced.

    Parameters
    ----------
    scene : Scene
        The scene.
    targets : list, optional
        Targets in place of its own.
    **tables
        Entries to replace, by table.
    """
    data = scene.model_dump(exclude_unset=True)
    for table, entries in tables.items():
        data[table] = {**data.get(table, {}), **entries}
    if targets is not None:
        data["targets"] = targets
    return Scene.model_validate(data)
