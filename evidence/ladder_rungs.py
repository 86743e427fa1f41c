"""Rungs of the ladder of oracles (`ladder.py`): what each knows of a mine, and its false alarms.

The oracle of `flgpr benchmark oracle` knows of a mine in looks k its echo s_k and the covariance R_k of clutter, but
not the phase between looks. Its statistic is sum ln I0(2 |s_k^H R_k^-1 x_k|), x_k divided by its own rms in whitened
clutter. Every other rung changes one thing in it. The rungs are in two parts, which are computed apart.

Part `bodies`, what is known of bodies, clutter and looks:

- `phases`: the phase of every look is known, too: sum 2 Re s_k^H R_k^-1 x_k;
- `level unknown`: each look has an amplitude of its own: sum |s_k^H R_k^-1 x_k|^2 / s_k^H R_k^-1 s_k;
- `white clutter`: of R_k the diagonal alone is known, the power of every polarization, sub-band and pixel;
- `flat ground`: s_k is that of the body alone under flat, level ground without a hole, not tilted;
- `depth and soil unknown`: the greatest value over a grid of depths and soils, flat ground;
- `body unknown`: the mean likelihood over bodies, at the mine's own depth and in its soil, flat ground;
- `metal signatures`: the generic metal mine at all depths and in all soils of the grid in place of the body, as `fused`
  has it;
- `metal, white clutter` and `metal, white, level unknown`: those together;
- `one look`: the nearest look alone.

Part `position`, what `flat ground` hides, one thing at a time: s_k is the echo of the lane's own bodies, but

- `hole unknown`: they lie in soil that was never dug;
- `tilt unknown`: they lie level;
- `roughness unknown`: the ground over them is smooth. Its ruts, and its waves of 3 m and more, remain;
- `cover unknown`: no grass stands over them, and no bush, post or stone shades them.

Signatures are scaled to the energy of the mine's own echo in whitened clutter, so that shape is lost and not level.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ive

from flgpr.model import ground_points
from flgpr.simulate import BARE, EVEN, Scene, Simulator, world_description
from flgpr_ground.ground import GroundLane
from flgpr_ground.oracle import BareGround, chips_at, divided_by_rms, places_in_sight

DEPTHS = (0.02, 0.07, 0.12)  # m: none is that of a body of the ground
SOILS = ((3.0, 0.02), (5.0, 0.05), (9.0, 0.1))  # permittivity, loss tangent
BODIES = (
    {"kind": "metal"},
    {"kind": "plastic", "body": "tm-62p"},
    {"kind": "plastic", "body": "vs-1.6"},
    {"kind": "plastic", "body": "vs-2.2"},
    {"kind": "plastic", "body": "m19"},
    {"kind": "ap", "body": "pmn"},
    {"kind": "ap", "body": "pma-1"},
    {"kind": "simulant"},
)

HIDDEN = ("hole", "tilt", "roughness", "cover")
"""What is hidden of how the lane's bodies lie, one at a time."""


# Signatures of other bodies and other ground


class Candidate(NamedTuple):
    """One signature that a mine is tried with."""

    group: str  # "flat", "grid", "bodies" or "metal"
    target: dict  # entries of the target that differ from the mine's
    soil: tuple[float, float] | None  # permittivity and loss tangent; None for the site's


def candidates() -> list[Candidate]:
    """Return all signatures that a mine is tried with, its own aside."""
    grid = list(itertools.product(DEPTHS, SOILS))
    rows = [Candidate("flat", {}, None)]
    rows += [Candidate("grid", {"depth": depth}, soil) for depth, soil in grid]
    rows += [Candidate("bodies", body, None) for body in BODIES]
    rows += [Candidate("metal", {"kind": "metal", "depth": depth}, soil) for depth, soil in grid]
    return rows


def candidate_scene(scene: Scene, mine, candidate: Candidate) -> Scene:
    """Return a scene with one body in place of a mine, under flat ground without a hole.

    Track and terrain are those of the lane, so that the antennas are where they were.
    """
    entries = {"x": mine.x, "y": mine.y, "heading": mine.heading, "depth": mine.depth}
    if "kind" in candidate.target:
        entries |= candidate.target
    else:
        entries |= {"kind": mine.kind, "body": mine.body} | candidate.target
        if mine.body is None:
            entries |= {"radius": mine.radius, "height": mine.height}
    # A top above the ground is that of a body on it, which has no hole and scatters otherwise.
    entries["depth"] = max(entries["depth"], 0.0)
    text = scene.model_dump()
    text |= {"site": None, "targets": [entries], "draws": [], "objects": [], "patches": []}
    text |= {"clutter": BARE, "holes": {"on": False}, "grass": {"on": False}, **EVEN}
    text["surface"] |= {"echo": False, "phase_screen": False}
    text["shadow"] |= {"on": False}
    if candidate.soil is not None:
        permittivity, loss = candidate.soil
        text["soil"] = {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss}
    return Scene.model_validate(text)


def candidate_echoes(setup, lane: GroundLane, mine, point: np.ndarray) -> np.ndarray:
    """Return the echoes (look, candidate, value) of all candidates in the looks at a mine."""
    scenes = [candidate_scene(lane.scene, mine, candidate) for candidate in candidates()]
    return echoes_at(setup, lane, scenes, point[None])


# Signatures of the lane's own bodies, of which one thing is hidden


def hidden_scene(scene: Scene, seed: int, hidden: str) -> Scene:
    """Return the scene of a lane whose bodies echo as if one thing were not there.

    All else that acts on their echoes is what the seed draws on the lane: bodies, holes, heights, objects and track.

    Parameters
    ----------
    scene : Scene
        The lane's scene.
    seed : int
        The lane's seed.
    hidden : str
        One of ``HIDDEN``, or "nothing".

    Raises
    ------
    ValueError
        If it is neither.
    """
    entries = world_description(scene, seed)

    def change(table: str, **settings: bool) -> None:
        entries[table] = {**entries.get(table, {}), **settings}

    # What scatters by itself takes long to draw, and does not act on the echoes of bodies.
    entries |= EVEN
    change("surface", echo=False)
    if hidden == "hole":
        change("holes", on=False)
    elif hidden == "tilt":
        for target in entries["targets"]:
            target["tilt"] = 0.0
    elif hidden == "roughness":
        change("surface", phase_screen=False)
    elif hidden == "cover":
        change("grass", on=False)
        change("shadow", on=False)
    elif hidden != "nothing":
        raise ValueError(f"hidden must be one of {', '.join(HIDDEN)} or nothing, got {hidden!r}")
    return Scene.model_validate(entries)


def hidden_echoes(
    setup, lane: GroundLane, mines: pd.DataFrame, hidden: tuple[str, ...] = HIDDEN
) -> np.ndarray:
    """Return the echoes (look, hidden, value) at the mines of a lane, in the order of `looks_at_mines`."""
    scenes = [hidden_scene(lane.scene, lane.seed, what) for what in hidden]
    return echoes_at(setup, lane, scenes, ground_points(mines))


def echoes_at(setup, lane: GroundLane, scenes: Sequence[Scene], points: np.ndarray) -> np.ndarray:
    """Return the echoes (look, scene, value) of the bodies of scenes in the looks at points of a lane.

    They are images of chips over the lane's background, scan by scan.
    """
    grid = setup.near
    coordinates = np.moveaxis(grid.points(), 2, 0)[None]
    simulators = [Simulator(scene, lane.sensor, lane.seed) for scene in scenes]
    looks = []
    for index, scan in enumerate(setup.near_imager.scans.tolist()):
        numbers, places = places_in_sight(setup, points, setup.setup.pose(index))
        if not len(numbers):
            continue
        count = len(places)
        levels = setup.gains[index][..., None, None] * setup.background.gain
        level = chips_at(levels, grid, places)
        pixels = chips_at(coordinates, grid, places).reshape(count, 3, -1)
        pixels = np.moveaxis(pixels, 1, 2).reshape(-1, 3)
        operator = setup.near_imager.operator_on(scan, pixels, setup.near_imager.subbands)
        signals = np.stack([simulator.bodies(scan) for simulator in simulators])
        image = operator.adjoint(signals)
        chips = image.reshape(*image.shape[:3], count, -1)
        chips = np.moveaxis(chips, 3, 0).reshape(count, len(scenes), -1)
        looks.append(chips / level[:, None])
    return np.concatenate(looks)


def log_bessel(z: np.ndarray) -> np.ndarray:
    """Return ln I0(2 |z|)."""
    twice = 2 * np.abs(z)
    return np.log(ive(0, twice)) + twice


class Filters(NamedTuple):
    """Matched filters of all signatures in the looks at a mine, in one kind of clutter."""

    filter: np.ndarray  # (look, signature, value)
    energy: np.ndarray  # (look, signature) s^H R^-1 s

    @classmethod
    def of(cls, ground: BareGround, kind: str, ahead: np.ndarray, echoes: np.ndarray) -> Filters:
        """Scale all signatures to the energy of the first, the mine's own, and filter them."""
        filter_array = np.array(
            [echo @ ground.inverse(y, kind).T for y, echo in zip(ahead, echoes, strict=True)]
        )
        energy = (filter_array.conj() * echoes).sum(axis=2).real
        total = np.maximum(energy.sum(axis=0), 1e-30)
        scale = np.sqrt(total[0] / total)
        return cls(filter_array * scale[:, None], energy * scale**2)


# Statistics and false alarms

Values = dict[str, np.ndarray]


class Signals(NamedTuple):
    """Looks at places, filtered with signatures."""

    groups: np.ndarray  # (signature,) name of the group that it belongs to
    values: Values  # (place, look, signature) by kind of clutter
    filters: dict[str, Filters]

    def of(self, group: str, kind: str = "full") -> np.ndarray:
        """Return the filtered looks (place, look, signature) of a group."""
        return self.values[kind][..., self.groups == group]

    def likelihoods(self, group: str, kind: str = "full") -> np.ndarray:
        """Return the log likelihoods (place, signature) of a group, phases of looks unknown."""
        return log_bessel(self.of(group, kind)).sum(axis=1)

    def level_unknown(self, group: str, kind: str = "full") -> np.ndarray:
        """Return the same (place, signature) with an unknown amplitude in each look."""
        energy = np.maximum(self.filters[kind].energy[:, self.groups == group], 1e-30)
        return (np.abs(self.of(group, kind)) ** 2 / energy).sum(axis=1)


def body_statistics(signals: Signals) -> Values:
    """Return the statistic (place,) of every rung of the part `bodies`."""
    bodies = signals.likelihoods("bodies")
    greatest = bodies.max(axis=1)
    mean_of_bodies = greatest + np.log(np.exp(bodies - greatest[:, None]).mean(axis=1))
    return {
        "phases": 2 * signals.of("own").real.sum(axis=(1, 2)),
        "oracle": signals.likelihoods("own")[:, 0],
        "level unknown": signals.level_unknown("own")[:, 0],
        "flat ground": signals.likelihoods("flat")[:, 0],
        "depth and soil unknown": signals.likelihoods("grid").max(axis=1),
        "body unknown": mean_of_bodies,
        "white clutter": signals.likelihoods("own", "diagonal")[:, 0],
        "metal signatures": signals.likelihoods("metal").max(axis=1),
        "metal, white clutter": signals.likelihoods("metal", "diagonal").max(axis=1),
        "metal, white, level unknown": signals.level_unknown("metal", "diagonal").max(axis=1),
    }


def position_statistics(signals: Signals) -> Values:
    """Return the statistic (place,) of the oracle and of every rung of the part `position`."""
    groups = {"oracle": "own"} | {f"{hidden} unknown": hidden for hidden in HIDDEN}
    return {rung: signals.likelihoods(group)[:, 0] for rung, group in groups.items()}


class Part(NamedTuple):
    """Rungs that are computed together."""

    groups: tuple[str, ...]  # of signatures, the mine's own first
    kinds: tuple[str, ...]  # of clutter
    statistics: Callable[[Signals], Values]


def body_part() -> Part:
    """Return the part `bodies`."""
    groups = ("own", *[candidate.group for candidate in candidates()])
    return Part(groups, ("full", "diagonal"), body_statistics)


POSITION_PART = Part(("own", *HIDDEN), ("full",), position_statistics)


def body_rates(
    ground: BareGround, ahead: np.ndarray, chips: np.ndarray, echoes: np.ndarray
) -> dict[str, float]:
    """Compute the false alarms per m² of a mine on every rung of the part `bodies`; see `rates`."""
    part = body_part()
    found = rates(ground, part, ahead, chips, echoes)
    near = [int(np.argmin(ahead))]
    found["one look"] = rates(ground, part, ahead[near], chips[near], echoes[near])["oracle"]
    return found


def rates(
    ground: BareGround, part: Part, ahead: np.ndarray, chips: np.ndarray, echoes: np.ndarray
) -> dict[str, float]:
    """Compute the false alarms per m² of a mine on every rung of a part.

    Parameters
    ----------
    ground : BareGround
        Target-free ground of the site.
    part : Part
        The part.
    ahead : (look,) ndarray
        Distances ahead, m.
    chips : (look, value) ndarray of complex
        The looks at the mine.
    echoes : (look, signature, value) ndarray of complex
        The mine's own echo and all other signatures of the part.
    """
    filters = {kind: Filters.of(ground, kind, ahead, echoes) for kind in part.kinds}
    places = ground.grid.nx * ground.grid.ny
    shape = (places, len(ahead), echoes.shape[1])
    at_mine = {}
    over_ground = {}
    for kind, of_kind in filters.items():
        at_mine[kind] = np.empty((1, *shape[1:]), complex)
        over_ground[kind] = np.zeros(shape, np.complex64)
        for look, y in enumerate(ahead):
            own = divided_by_rms(chips[look][None], ground.inverse(y, kind))
            conjugate = of_kind.filter[look].conj().T
            at_mine[kind][:, look] = own @ conjugate
            seen, number = ground.nearest(y)
            over_ground[kind][seen, look] = ground.chips[kind][number] @ conjugate.astype(
                np.complex64
            )
    groups = np.array(part.groups)
    levels = part.statistics(Signals(groups, at_mine, filters))
    maps = part.statistics(Signals(groups, over_ground, filters))
    found = {}
    for rung, level in levels.items():
        found[rung] = ground.rate(maps[rung], float(level[0]))
    return found
