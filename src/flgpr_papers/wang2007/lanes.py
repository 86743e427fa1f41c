"""The lanes of Wang et al. 2007 as far as the paper describes them, simulated.

What the paper leaves open is fixed here and in ``lanes.toml``, before anything is scored, and
stated on the page: the soil, the mines' bodies, how the targets are spread over the lanes, how many
mines the blind lanes hold, and how the vehicle drives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

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
DEPARTURE = {
    "start": 150.0,
    "length": 8.0,
}  # "the vehicle moved out of the mine lane to avoid obstacles"
# of either kind per blind lane; the paper's authors never learned how many there were
BLIND_MINES = 12
_SURFACE = -0.15  # depth of a mine 15 cm high that lies on the ground

# Length, surface mines (metal, plastic), buried metal at 5, 10, 15 cm, buried plastic at 5, 10 cm,
# simulants at 5 and 10 cm: 15 surface, 12 metal, 20 plastic and 16 simulants in all.
_CALIBRATION = {
    "c1": (300.0, (3, 2), (1, 2, 1), (3, 3), (3, 2)),
    "c2": (320.0, (2, 3), (2, 1, 1), (4, 3), (2, 3)),
    "c3": (340.0, (3, 2), (1, 1, 2), (3, 4), (3, 3)),
}
_BLIND = ("b1", "b2", "b3", "b4")
# scatterers per m²: ten per finest cell of F1, where a sensor takes three of its own by default
_BLIND_DENSITY = 100.0


def calibration_scenes(world: str = OWN) -> LaneScenes:
    """Return the three calibration lanes of a world."""
    lanes: dict[str, list[dict[str, Any]]] = {}
    for name, (_, surface, metal, plastic, simulant) in _CALIBRATION.items():
        draws = [_draw("metal", _SURFACE, surface[0]), _draw("plastic", _SURFACE, surface[1])]
        draws += [
            _draw("metal", depth, n) for depth, n in zip((0.05, 0.10, 0.15), metal, strict=True)
        ]
        draws += [
            _draw("plastic", depth, n) for depth, n in zip((0.05, 0.10), plastic, strict=True)
        ]
        draws += [
            _draw("simulant", depth, n) for depth, n in zip((0.05, 0.10), simulant, strict=True)
        ]
        lanes[name] = draws
    declared = study_world("wang2007", world)
    lanes = deal_bodies(lanes, declared.mixes)
    scenes = {}
    for seed, (name, draws) in enumerate(lanes.items(), start=101):
        track = {**TRACK, "departures": [DEPARTURE]} if name == "c2" else TRACK
        scenes[name] = (
            _scene(name, _CALIBRATION[name][0], draws, track, declared.sites["lane"]),
            seed,
        )
    return scenes


def blind_scenes(world: str = OWN) -> LaneScenes:
    """Return the four blind lanes of a world, with mines at 7.5 cm."""
    declared = study_world("wang2007", world)
    draws = [_draw("metal", 0.075, BLIND_MINES), _draw("plastic", 0.075, BLIND_MINES)]
    lanes = deal_bodies({name: draws for name in _BLIND}, declared.mixes)
    surface = {"density": _BLIND_DENSITY}
    return {
        name: (_scene(name, 1200.0, lanes[name], TRACK, declared.sites["lane"], surface), seed)
        for seed, name in enumerate(_BLIND, start=201)
    }


def quick_scenes(site: str | None = None, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return small lanes that only show that everything runs: few targets, thinned surface clutter.

    With a ``site``, a packaged one or the path of a file, they lie there with generic bodies, as of
    roads as found.
    """
    declared = study_world("wang2007", world if site is None else AS_FOUND)
    track = {**TRACK, "step": (2.6, 3.0), "start": -14.0}
    surface = {"density": 20.0}
    few = [
        ("metal", _SURFACE),
        ("metal", 0.05),
        ("plastic", _SURFACE),
        ("plastic", 0.05),
        ("simulant", 0.05),
    ]
    draws = [_draw(kind, depth, 1) for kind, depth in few]
    calibration = deal_bodies({name: draws for name in _CALIBRATION}, declared.mixes)
    blind = deal_bodies(
        {"b1": [_draw("metal", 0.075, 2), _draw("plastic", 0.075, 2)]}, declared.mixes
    )
    site_name = declared.sites["lane"] if site is None else site

    def scenes(lanes: Mapping[str, list[dict[str, Any]]], first: int) -> LaneScenes:
        return {
            name: (_scene(name, 36.0, lane_tables, track, site_name, surface), seed)
            for seed, (name, lane_tables) in enumerate(lanes.items(), start=first)
        }

    return scenes(calibration, 101), scenes(blind, 201)


def deal_bodies(
    lanes: Mapping[str, list[dict[str, Any]]], mixes: Mapping[str, str]
) -> dict[str, list[dict[str, Any]]]:
    """Assign the bodies of mixes to the draws of several lanes, over all lanes and depths.

    So the shares of a mix hold over all lanes together, where a draw of three mines can never hold
    those of four bodies; mines on the surface and buried ones are dealt apart. A body that lies on
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
    stacks = {
        key: _stack(mixes[key[0]], count)
        for key, count in _counts(lanes).items()
        if key[0] in mixes
    }
    dealt: dict[str, list[dict[str, Any]]] = {}
    for name, draws in lanes.items():
        dealt[name] = []
        for draw in draws:
            stack = stacks.get(_pool(draw))
            if stack is None:
                dealt[name].append(draw)
                continue
            bodies = [next(stack) for _ in range(draw["count"])]
            dealt[name] += [
                _body_draw(draw, body, bodies.count(body)) for body in dict.fromkeys(bodies)
            ]
    return dealt


def _pool(draw: Mapping[str, Any]) -> tuple[str, bool]:
    """Return among which mines a draw's bodies are dealt.

    Kind, and whether they lie on the surface.
    """
    return draw["kind"], draw["depth"] < 0


def _counts(lanes: Mapping[str, list[dict[str, Any]]]) -> dict[tuple[str, bool], int]:
    """Count the mines that share a deal of bodies."""
    counts: dict[tuple[str, bool], int] = {}
    for draws in lanes.values():
        for draw in draws:
            counts[_pool(draw)] = counts.get(_pool(draw), 0) + draw["count"]
    return counts


def _stack(mix: str, count: int) -> Iterator[str]:
    """Return the bodies of ``count`` mines of a mix, one of each in turn.

    It goes on as long as there are any.
    """
    left = {draw["body"]: draw["count"] for draw in mix_draws(mix, 0.0, count)}
    while left:
        for body in list(left):
            yield body
            left[body] -= 1
            if not left[body]:
                del left[body]


def _body_draw(draw: Mapping[str, Any], body: str, count: int) -> dict[str, Any]:
    """Return a draw of mines with a body; a surface mine stands on the ground."""
    depth = -body_size(body)["height"] if draw["depth"] < 0 else draw["depth"]
    return {**draw, "body": body, "depth": depth, "count": count}


def sensor(band: tuple[float, float] | None = None) -> Sensor:
    """Load the array of the paper, if wanted with the tones (Hz) of a band alone."""
    radar = load_sensor("sri-array")
    if band is None:
        return radar
    axis = radar.tones.axis()
    inside = axis[(axis >= band[0]) & (axis <= band[1])]
    return radar.model_copy(
        update={"tones": radar.tones.model_copy(update={"start": inside[0], "count": inside.size})}
    )


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
