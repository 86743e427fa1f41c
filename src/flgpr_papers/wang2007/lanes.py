"""The simulated lanes of Wang et al. 2007, as far as the paper describes them.

What the paper leaves open is fixed here and in ``lanes.toml``, before anything is scored, and
stated on the page: the soil, the bodies of the mines, how the targets are spread over the lanes,
how many mines the blind lanes hold, and how the vehicle drives.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Sensor
from flgpr.simulate.bodies.signature.table import body_size
from flgpr.types import Entries
from flgpr_papers.kit.mines import mix_counts
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OWN, StudyWorld, study_world

LaneScenes = dict[str, tuple[Scene, int]]
"""Scene and seed of each lane by its name."""
F1_BAND = (0.75e9, 1.35e9)
"""Sub-band F1 (Sec. II), Hz."""
TRACK = {"step": (1.0, 3.0), "wander": 0.1, "attitude": 0.004, "bounce": 0.005}
_FORMS = tomllib.loads(packaged_text("wang2007", "lanes"))["forms"]


def calibration_scenes(world: str = OWN, replicate: int = 0) -> LaneScenes:
    """Return the three calibration lanes of a world, by name.

    A replicate other than 0 has the same mines on lanes of other seeds.
    """
    lanes = _scenes("calibration", study_world("wang2007", world))
    return {name: (scene, seed + 1000 * replicate) for name, (scene, seed) in lanes.items()}


def blind_scenes(world: str = OWN) -> LaneScenes:
    """Return the four blind lanes of a world, with mines at 7.5 cm, by name."""
    return _scenes("blind", study_world("wang2007", world))


def quick_scenes(world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return small calibration and blind lanes of a world that only show that everything runs.

    They have few targets and thinned surface clutter.
    """
    declared = study_world("wang2007", world)
    return _scenes("quick-calibration", declared), _scenes("quick-blind", declared)


def _scenes(form: str, world: StudyWorld) -> LaneScenes:
    """Return the lanes of a form of the study, seeded in order."""
    declared = _FORMS[form]
    targets = {}
    for name, lane in declared["lanes"].items():
        keys = ("kind", "depth", "count")
        targets[name] = [dict(zip(keys, draw, strict=True)) for draw in lane["targets"]]
    dealt = deal_bodies(targets, world.mixes)
    scenes = {}
    for seed, (name, lane) in enumerate(declared["lanes"].items(), start=declared["seed"]):
        tables = {
            "name": name,
            "site": world.sites["lane"],
            "length": lane["length"],
            "draws": dealt[name],
            "track": TRACK | declared.get("track", {}) | lane.get("track", {}),
            "surface": declared.get("surface", {}),
        }
        scenes[name] = (Scene.model_validate(tables), seed)
    return scenes


def deal_bodies(
    lanes: Mapping[str, list[Entries]], mixes: Mapping[str, str]
) -> dict[str, list[Entries]]:
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
    pools: Counter[tuple[str, bool]] = Counter()
    for draws in lanes.values():
        for draw in draws:
            pools[draw["kind"], draw["depth"] < 0] += draw["count"]
    stacks = {}
    for (kind, lies), count in pools.items():
        if kind in mixes:
            stacks[kind, lies] = _stack(mixes[kind], count)
    dealt: dict[str, list[Entries]] = {name: [] for name in lanes}
    for name, draws in lanes.items():
        for draw in draws:
            stack = stacks.get((draw["kind"], draw["depth"] < 0))
            if stack is None:
                dealt[name].append(draw)
                continue
            bodies = Counter(next(stack) for _ in range(draw["count"]))
            for body, count in bodies.items():
                depth = -body_size(body)["height"] if draw["depth"] < 0 else draw["depth"]
                dealt[name].append({**draw, "body": body, "depth": depth, "count": count})
    return dealt


def _stack(mix: str, count: int) -> Iterator[str]:
    """Yield the bodies of ``count`` mines of a mix, each body in turn while any are left."""
    remaining = Counter(mix_counts(mix, count))
    while remaining:
        for body in list(remaining):
            yield body
            remaining -= Counter([body])


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
