"""What a scene holds, as tables for a drawing, before anything is simulated."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from flgpr.model import Lane
from flgpr.simulate.effort import check_effort
from flgpr.simulate.scene.scene import Scene
from flgpr.simulate.scene.world import draw_world
from flgpr.types import FloatArray, floats

_MARGIN = 0.5  # m of ground beside lane and roadside


@dataclass(frozen=True)
class ScenePreview:
    """The drawn world of a scene, in the lane frame, m."""

    title: str
    lane: Lane
    targets: pd.DataFrame  #: ``kind``, ``x``, ``y``, ``top`` and ``bottom`` (depths below ground)
    objects: pd.DataFrame  #: ``kind``, ``x``, ``y`` of everything else with a position
    patches: FloatArray  #: (patch, 3): x, y and radius of wet patches and refilled holes
    half_width: float  #: largest distance from the lane's axis that a drawing needs


def preview_scene(scene: Scene, seed: int, force: bool = False) -> ScenePreview:
    """Draw the world of a scene and return what stands where.

    Parameters
    ----------
    scene : Scene
        The scene.
    seed : int
        The same seed gives the world of the simulation.
    force : bool
        Whether to draw even what takes very much memory or time.

    Returns
    -------
    ScenePreview
        Tables in the lane frame, m.

    Raises
    ------
    ValueError
        If the scene holds more than can be drawn in reasonable memory and time.
    """
    check_effort(scene, None, force)
    world = draw_world(scene, seed)
    targets = []
    for target in world.targets:
        bottom = target.depth + target.height
        targets.append((target.kind, target.x, target.y, target.depth, bottom))
    objects = [(item.kind, item.x, item.y) for item in world.objects]
    circles = [(patch.x, patch.y, patch.radius) for patch in world.patches]
    lane = scene.lane
    farthest = max(scene.clutter.roadside[1], abs(lane.x_min), abs(lane.x_max))
    return ScenePreview(
        title=f"{scene.name}, seed {seed}",
        lane=lane,
        targets=pd.DataFrame(targets, columns=["kind", "x", "y", "top", "bottom"]),
        objects=pd.DataFrame(objects, columns=["kind", "x", "y"]),
        patches=floats(circles).reshape(-1, 3),
        half_width=farthest + _MARGIN,
    )
