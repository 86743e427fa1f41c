"""The simulated lanes of Wang et al. 2007, as far as the paper describes them.

What the paper leaves open is fixed here and in ``lanes.toml``, before anything is scored, and
stated on the page: the soil, the bodies of the mines, how the targets are spread over the lanes,
how many mines the blind lanes hold, and how the vehicle drives.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Sensor
from flgpr.simulate.bodies.signature.table import body_size
from flgpr_papers.kit.mines import mix_draws
from flgpr_papers.kit.study_worlds import AS_FOUND, OWN, study_world

LaneScenes = dict[str, tuple[Scene, int]]
"""Scene and seed of each lane by its name."""
F1_BAND = (0.75e9, 1.35e9)
"""Sub-band F1 (Sec. II), Hz."""
TRACK = {"step": (1.0, 3.0), "wander": 0.1, "attitude": 0.004, "bounce": 0.005}
# "the vehicle moved out of the mine lane to avoid obstacles"
DEPARTURE = {"start": 150.0, "length": 8.0}
# of either kind per blind lane; the paper's authors never learned how many there were
BLIND_MINES = 12
_SURFACE = -0.15  # depth of a mine 15 cm high that lies on the ground


class CalibrationTargets(NamedTuple):
    """Length of a calibration lane and its numbers of targets."""

    length: float  #: m
    surface: tuple[int, int]  #: metal and plastic mines on the surface
    metal: tuple[int, int, int]  #: metal mines at 5, 10 and 15 cm
    plastic: tuple[int, int]  #: plastic mines at 5 and 10 cm
    simulant: tuple[int, int]  #: simulants at 5 and 10 cm


# 15 surface mines, 12 metal and 20 plastic ones buried, and 16 simulants in all (Sec. III).
_CALIBRATION = {
    "c1": CalibrationTargets(300.0, (3, 2), (1, 2, 1), (3, 3), (3, 2)),
    "c2": CalibrationTargets(320.0, (2, 3), (2, 1, 1), (4, 3), (2, 3)),
    "c3": CalibrationTargets(340.0, (3, 2), (1, 1, 2), (3, 4), (3, 3)),
}
_BLIND = ("b1", "b2", "b3", "b4")
# scatterers per m²: ten per finest cell of F1, where a sensor takes three of its own by default
_BLIND_DENSITY = 100.0


def calibration_scenes(world: str = OWN) -> LaneScenes:
    """Return the three calibration lanes of a world, by name."""
    declared = study_world("wang2007", world)
    draws_by_lane = {}
    for name, targets in _CALIBRATION.items():
        draws_by_lane[name] = _calibration_draws(targets)
    draws_by_lane = deal_bodies(draws_by_lane, declared.mixes)
    scenes = {}
    for seed, (name, draws) in enumerate(draws_by_lane.items(), start=101):
        length = _CALIBRATION[name].length
        track = {**TRACK, "departures": [DEPARTURE]} if name == "c2" else TRACK
        scenes[name] = (_scene(name, length, draws, track, declared.sites["lane"]), seed)
    return scenes


def _calibration_draws(targets: CalibrationTargets) -> list[dict[str, Any]]:
    """Return the draws of a calibration lane."""
    surface_metal, surface_plastic = targets.surface
    draws = [
        _draw("metal", _SURFACE, surface_metal),
        _draw("plastic", _SURFACE, surface_plastic),
    ]
    for depth, count in zip((0.05, 0.10, 0.15), targets.metal, strict=True):
        draws.append(_draw("metal", depth, count))
    for depth, count in zip((0.05, 0.10), targets.plastic, strict=True):
        draws.append(_draw("plastic", depth, count))
    for depth, count in zip((0.05, 0.10), targets.simulant, strict=True):
        draws.append(_draw("simulant", depth, count))
    return draws


def blind_scenes(world: str = OWN) -> LaneScenes:
    """Return the four blind lanes of a world, with mines at 7.5 cm, by name."""
    declared = study_world("wang2007", world)
    draws = [_draw("metal", 0.075, BLIND_MINES), _draw("plastic", 0.075, BLIND_MINES)]
    draws_by_lane = deal_bodies({name: draws for name in _BLIND}, declared.mixes)
    site = declared.sites["lane"]
    surface = {"density": _BLIND_DENSITY}
    scenes = {}
    for seed, name in enumerate(_BLIND, start=201):
        scenes[name] = (_scene(name, 1200.0, draws_by_lane[name], TRACK, site, surface), seed)
    return scenes


def quick_scenes(site: str | None = None, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return small calibration and blind lanes that only show that everything runs.

    They have few targets and thinned surface clutter.

    Parameters
    ----------
    site : str, optional
        Site of the lanes: a packaged one, or the path of a file. The mines have generic bodies
        then, as on roads as found.
    world : str
        World whose site and bodies the lanes have, where there is no ``site``.
    """
    declared = study_world("wang2007", world if site is None else AS_FOUND)
    site_name = declared.sites["lane"] if site is None else site
    calibration_draws = [
        _draw("metal", _SURFACE, 1),
        _draw("metal", 0.05, 1),
        _draw("plastic", _SURFACE, 1),
        _draw("plastic", 0.05, 1),
        _draw("simulant", 0.05, 1),
    ]
    calibration = deal_bodies({name: calibration_draws for name in _CALIBRATION}, declared.mixes)
    blind_draws = [_draw("metal", 0.075, 2), _draw("plastic", 0.075, 2)]
    blind = deal_bodies({"b1": blind_draws}, declared.mixes)
    return _quick_lanes(calibration, 101, site_name), _quick_lanes(blind, 201, site_name)


def _quick_lanes(
    draws_by_lane: Mapping[str, list[dict[str, Any]]], first_seed: int, site: str
) -> LaneScenes:
    """Return short lanes with few scans, seeded in order."""
    track = {**TRACK, "step": (2.6, 3.0), "start": -14.0}
    surface = {"density": 20.0}
    scenes = {}
    for seed, (name, draws) in enumerate(draws_by_lane.items(), start=first_seed):
        scenes[name] = (_scene(name, 36.0, draws, track, site, surface), seed)
    return scenes


def deal_bodies(
    lanes: Mapping[str, list[dict[str, Any]]], mixes: Mapping[str, str]
) -> dict[str, list[dict[str, Any]]]:
    """Assign the bodies of mixes to the draws of several lanes, over all lanes and depths.

    The shares of a mix hold over all lanes together: a draw of three mines alone cannot have those
    of four bodies. Mines on the surface and buried ones are dealt separately. A body that lies on
    the ground has the depth of its own height.

    Parameters
    ----------
    lanes : dict of list
        Draws of each lane, with ``kind``, ``depth`` and ``count``.
    mixes : dict
        Mix by kind of target; kinds without one keep their generic body.

    Returns
    -------
    dict of list
        The draws of each lane, one per body at a depth.
    """
    stacks = {}
    for pool, count in _counts(lanes).items():
        kind, _ = pool
        if kind in mixes:
            stacks[pool] = _stack(mixes[kind], count)
    dealt: dict[str, list[dict[str, Any]]] = {}
    for name, draws in lanes.items():
        dealt[name] = []
        for draw in draws:
            stack = stacks.get(_pool(draw))
            if stack is None:
                dealt[name].append(draw)
                continue
            bodies = Counter(next(stack) for _ in range(draw["count"]))
            for body, count in bodies.items():
                dealt[name].append(_body_draw(draw, body, count))
    return dealt


def _pool(draw: Mapping[str, Any]) -> tuple[str, bool]:
    """Return the mines whose bodies are dealt together: kind, and whether on the surface."""
    return draw["kind"], draw["depth"] < 0


def _counts(lanes: Mapping[str, list[dict[str, Any]]]) -> dict[tuple[str, bool], int]:
    """Return the number of mines of every pool."""
    counts: dict[tuple[str, bool], int] = {}
    for draws in lanes.values():
        for draw in draws:
            pool = _pool(draw)
            counts[pool] = counts.get(pool, 0) + draw["count"]
    return counts


def _stack(mix: str, count: int) -> Iterator[str]:
    """Yield the bodies of ``count`` mines of a mix, each body in turn while any are left."""
    remaining = {}
    for draw in mix_draws(mix, 0.0, count):
        remaining[draw["body"]] = draw["count"]
    while remaining:
        for body in list(remaining):
            yield body
            remaining[body] -= 1
            if not remaining[body]:
                del remaining[body]


def _body_draw(draw: Mapping[str, Any], body: str, count: int) -> dict[str, Any]:
    """Return a draw of mines with a body; a surface mine stands on the ground."""
    depth = -body_size(body)["height"] if draw["depth"] < 0 else draw["depth"]
    return {**draw, "body": body, "depth": depth, "count": count}


def f1_alone(recipe: str) -> str:
    """Return the text of a recipe of the paper with the sub-band F1 alone."""
    return re.sub(r"(?m)^F[0234] .*\n", "", recipe)


def sensor(band: tuple[float, float] | None = None) -> Sensor:
    """Load the radar array of the paper.

    Parameters
    ----------
    band : tuple of float, optional
        Band (Hz) whose tones alone the radar has; all of its tones without one.
    """
    radar = load_sensor("sri-array")
    if band is None:
        return radar
    low, high = band
    axis = radar.tones.axis()
    inside = axis[(axis >= low) & (axis <= high)]
    tones = radar.tones.model_copy(update={"start": inside[0], "count": inside.size})
    return radar.model_copy(update={"tones": tones})


def _scene(
    name: str,
    length: float,
    draws: list[dict[str, Any]],
    track: dict[str, Any],
    site: str,
    surface: dict[str, Any] | None = None,
) -> Scene:
    """Return the scene of a lane."""
    tables = {
        "name": name,
        "site": site,
        "length": length,
        "draws": draws,
        "track": track,
        "surface": surface or {},
    }
    return Scene.model_validate(tables)


def _draw(kind: str, depth: float, count: int) -> dict[str, Any]:
    """Return a draw of mines of a kind at a depth."""
    return {"kind": kind, "depth": depth, "count": count}
