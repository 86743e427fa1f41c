"""What a scene says that can hardly be meant: told before it is drawn or simulated, never refused."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from flgpr.simulate.scene.scene import Scene, Target
from flgpr.simulate.scene.world import draw_world

_NAMES = 3  # that a line lists
_AIR = 1e-6  # m under a body from which on it hangs in the air


def scene_doubts(scene: Scene, seed: int) -> list[str]:
    """Return a line on each kind of doubt about the targets and the track of a scene.

    Parameters
    ----------
    scene : Scene
        The scene, at the drive that is looked at.
    seed : int
        Of everything drawn.

    Returns
    -------
    list of str
        Targets outside the lane, in the air and in one another, stops and departures that the
        track does not reach.
    """
    targets = draw_world(scene, seed).targets
    outside = []
    floating = []
    for number, target in enumerate(targets, 1):
        if not scene.lane.contains(target.x, target.y):
            outside.append(f"T{number:03d}")
        if target.depth + target.extent[1] < -_AIR:
            floating.append(f"T{number:03d}")
    told = {
        "outside the lane, and not in the truth": outside,
        "in the air, with a depth below -height": floating,
        "in one another": _overlaps(targets),
    }
    lines = [f"targets {how}: {_counted(names)}" for how, names in told.items() if names]
    return lines + _track_doubts(scene)


def _overlaps(targets: tuple[Target, ...]) -> list[str]:
    """Return the pairs of targets whose upright cylinders share some ground."""
    if len(targets) < 2:
        return []
    places = [(target.x, target.y) for target in targets]
    widest = max(target.extent[0] for target in targets)
    pairs = []
    for first, second in sorted(cKDTree(places).query_pairs(2 * widest)):
        one, other = targets[first], targets[second]
        apart = np.hypot(one.x - other.x, one.y - other.y)
        above, below = sorted((one, other), key=lambda target: target.depth)
        if apart < one.extent[0] + other.extent[0] and below.depth < above.depth + above.extent[1]:
            pairs.append(f"T{first + 1:03d} and T{second + 1:03d}")
    return pairs


def _track_doubts(scene: Scene) -> list[str]:
    """Return lines on entries of the track that do nothing, or not where they say."""
    track = scene.track
    if track.positions is not None:
        others = ("start", "stop", "step", "stops", "departures")
        idle = [name for name in others if name in track.model_fields_set]
        return [f"track.{name} does nothing beside track.positions" for name in idle]
    start, end = scene.track_ends
    ends = f"the track, y {start:g} to {end:g} m"
    lines = []
    for place, _ in track.stops:
        if not start <= place <= end:
            lines.append(f"track.stops: {place:g} m lies outside {ends}")
    for departure in track.departures:
        if departure.start > end or departure.start + departure.length <= start:
            lines.append(f"track.departures: {departure.start:g} m lies outside {ends}")
    return lines


def _counted(names: list[str]) -> str:
    """Return how many names there are, and the first of them."""
    more = ", ..." if len(names) > _NAMES else ""
    return f"{len(names)} ({', '.join(names[:_NAMES])}{more})"
