"""The lanes of Wang et al. 2007 as far as the paper describes them, simulated.

What the paper leaves open is fixed here, before anything is scored, and stated on the page: the soil, how the targets
are spread over the lanes, how many mines the blind lanes hold, and how the vehicle drives.
"""

from __future__ import annotations

from typing import Any

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Sensor

SITE = "arid-sand"
TRACK = {"step": (1.0, 3.0), "wander": 0.1, "attitude": 0.004, "bounce": 0.005}
DEPARTURE = {"start": 150.0, "length": 8.0}  # "the vehicle moved out of the mine lane to avoid obstacles"
BLIND_MINES = 12  # of either kind per blind lane; the paper's authors never learned how many there were
_SURFACE = -0.15  # depth of a mine 15 cm high that lies on the ground

# Length, surface mines (metal, plastic), buried metal at 5, 10, 15 cm, buried plastic at 5, 10 cm, simulants at 5 and
# 10 cm: 15 surface, 12 metal, 20 plastic and 16 simulants in all.
_CALIBRATION = {
    "c1": (300.0, (3, 2), (1, 2, 1), (3, 3), (3, 2)),
    "c2": (320.0, (2, 3), (2, 1, 1), (4, 3), (2, 3)),
    "c3": (340.0, (3, 2), (1, 1, 2), (3, 4), (3, 3)),
}
_BLIND = ("b1", "b2", "b3", "b4")
_BLIND_DENSITY = 100.0  # scatterers per m²: ten per finest cell of F1, where a sensor takes three of its own by default


def calibration_scenes() -> dict[str, tuple[Scene, int]]:
    """Give the three calibration lanes."""
    scenes = {}
    for seed, (name, (length, surface, metal, plastic, simulant)) in enumerate(_CALIBRATION.items(), start=101):
        draws = [_draw("metal", _SURFACE, surface[0]), _draw("plastic", _SURFACE, surface[1])]
        draws += [_draw("metal", depth, n) for depth, n in zip((0.05, 0.10, 0.15), metal, strict=True)]
        draws += [_draw("plastic", depth, n) for depth, n in zip((0.05, 0.10), plastic, strict=True)]
        draws += [_draw("simulant", depth, n) for depth, n in zip((0.05, 0.10), simulant, strict=True)]
        track = {**TRACK, "departures": [DEPARTURE]} if name == "c2" else TRACK
        scenes[name] = (_scene(name, length, draws, track), seed)
    return scenes


def blind_scenes() -> dict[str, tuple[Scene, int]]:
    """Give the four blind lanes, with mines at 7.5 cm."""
    draws = [_draw("metal", 0.075, BLIND_MINES), _draw("plastic", 0.075, BLIND_MINES)]
    surface = {"density": _BLIND_DENSITY}
    return {name: (_scene(name, 1200.0, draws, TRACK, surface), seed) for seed, name in enumerate(_BLIND, start=201)}


def quick_scenes(site: str = SITE) -> tuple[dict[str, tuple[Scene, int]], dict[str, tuple[Scene, int]]]:
    """Give small lanes that only show that everything runs: few targets, thinned surface clutter."""
    track = {**TRACK, "step": (2.6, 3.0), "start": -14.0}
    surface = {"density": 20.0}
    few = [("metal", _SURFACE), ("metal", 0.05), ("plastic", _SURFACE), ("plastic", 0.05), ("simulant", 0.05)]
    draws = [_draw(kind, depth, 1) for kind, depth in few]
    calibration = {
        name: (_scene(name, 36.0, draws, track, surface, site), seed)
        for seed, name in enumerate(_CALIBRATION, start=101)
    }
    blind = [_draw("metal", 0.075, 2), _draw("plastic", 0.075, 2)]
    return calibration, {"b1": (_scene("b1", 36.0, blind, track, surface, site), 201)}


def sensor(band: tuple[float, float] | None = None) -> Sensor:
    """Load the array of the paper, if wanted with the tones (Hz) of a band alone."""
    radar = load_sensor("sri-array")
    if band is None:
        return radar
    axis = radar.tones.axis()
    inside = axis[(axis >= band[0]) & (axis <= band[1])]
    return radar.model_copy(update={"tones": radar.tones.model_copy(update={"start": inside[0], "count": inside.size})})


def _scene(
    name: str,
    length: float,
    draws: list[dict[str, Any]],
    track: dict[str, Any],
    surface: dict[str, Any] | None = None,
    site: str = SITE,
) -> Scene:
    parts = {"name": name, "site": site, "length": length, "draws": draws, "track": track, "surface": surface or {}}
    return Scene.model_validate(parts)


def _draw(kind: str, depth: float, count: int) -> dict[str, Any]:
    return {"kind": kind, "depth": depth, "count": count}
