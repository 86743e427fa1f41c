"""What each piece of knowledge is worth to a detector: oracles that lose one at a time, on both tiers.

``python evidence/ladder.py GROUND OUT [--tier T] [--every 1] [--site S] [--figure FILE.png]`` looks at the lanes of a
folder of ``flgpr benchmark run`` and opens its sealed truth, which is entered in the log OUT/looks.jsonl.
``--summary`` only makes the tables and the figure again. No detector is chosen or tuned by it.

The oracle of `flgpr benchmark oracle` knows of a mine in looks k its echo s_k and the covariance R_k of clutter, but
not the phase between looks. Its statistic is sum ln I0(2 |s_k^H R_k^-1 x_k|), x_k divided by its own rms in whitened
clutter. Every other rung changes one thing in it:

- `phases`: the phase of every look is known, too: sum 2 Re s_k^H R_k^-1 x_k;
- `level unknown`: each look has an amplitude of its own: sum |s_k^H R_k^-1 x_k|^2 / s_k^H R_k^-1 s_k;
- `white clutter`: of R_k the diagonal alone is known, the power of every polarization, sub-band and pixel;
- `flat ground`: s_k is that of the body under flat, level ground without a hole, not tilted;
- `depth and soil unknown`: the greatest value over a grid of depths and soils, flat ground;
- `body unknown`: the mean likelihood over bodies, at the mine's own depth and in its soil, flat ground;
- `metal signatures`: the generic metal mine at all depths and in all soils of the grid in place of the body, as `fused`
  has it;
- `metal, white clutter` and `metal, white, level unknown`: those together;
- `one look`: the nearest look alone.

Signatures of a set are scaled to the energy of the mine's own echo in whitened clutter, so that shape is lost and not
level. A statistic is tried on all places of the site's target-free lane; local maxima that reach the mine's value are
the false alarms with which it is found (flgpr.proving_ground.oracle). It is no bound where false alarms are many.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.special import ive

from flgpr.model import Grid, ground_points
from flgpr.proving_ground.ground import Ground, GroundLane
from flgpr.proving_ground.oracle import (
    STEP,
    chips_at,
    cleaned_lane,
    count_maxima,
    divided_by_rms,
    inverse_covariance,
    lanes_of_site,
    looks_at,
    looks_at_mines,
    places_in_sight,
)
from flgpr.proving_ground.running import ALARMS, SEALED, entry_folder, passphrase, read_ground
from flgpr.scoring import clopper_pearson, label_alarms, match
from flgpr.scoring.lane_roc import far_area
from flgpr.simulate import BARE, EVEN, Scene, Simulator, draw_world
from flgpr.store import read_table
from flgpr.store.tables import read_columns
from flgpr.trials import open_truth

RUNGS = {
    "phases": "and the phases between looks",
    "oracle": "all but the phases",
    "level unknown": "without the level",
    "flat ground": "without hole, tilt and roughness",
    "depth and soil unknown": "without depth and soil",
    "body unknown": "without the body",
    "white clutter": "without correlations of clutter",
    "metal signatures": "metal signatures, all depths and soils",
    "metal, white clutter": "the same, white clutter",
    "metal, white, level unknown": "the same, level unknown",
    "one look": "one look",
}
ENTRIES = {"fused": "fused", "wang2007": "C_HH (wang2007)"}
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
LEVELS = (0.5, 0.7)  # of Pd
FAR = 0.02  # per m²
GROUPS = ("mines", "metal", "plastic", "ap")


class Candidate(NamedTuple):
    """One signature that a mine is tried with."""

    group: str  # "flat", "grid", "bodies" or "metal"
    target: dict  # entries of the target that differ from the mine's
    soil: tuple[float, float] | None  # permittivity and loss tangent; None for the site's


def candidates() -> list[Candidate]:
    """Return all signatures that a mine is tried with, its own aside."""
    rows = [Candidate("flat", {}, None)]
    for depth in DEPTHS:
        for soil in SOILS:
            rows.append(Candidate("grid", {"depth": depth}, soil))
    rows += [Candidate("bodies", body, None) for body in BODIES]
    for depth in DEPTHS:
        for soil in SOILS:
            rows.append(Candidate("metal", {"kind": "metal", "depth": depth}, soil))
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
    cleaned = setup.cleaned
    grid = cleaned.grid
    simulators = []
    for candidate in candidates():
        scene = candidate_scene(lane.scene, mine, candidate)
        simulators.append(Simulator(scene, lane.sensor, lane.seed))
    looks = []
    for index, scan in enumerate(cleaned.imager.scans.tolist()):
        numbers, places = places_in_sight(setup, point[None], setup.setup.pose(index))
        if not len(numbers):
            continue
        level = cleaned.gains[index][..., None, None] * cleaned.background.gain
        level = chips_at(level, grid, places)[0]
        pixels = chips_at(np.moveaxis(grid.points(), 2, 0)[None], grid, places)
        pixels = pixels.reshape(3, -1).T
        operator = cleaned.imager.operator_on(scan, pixels, cleaned.imager.subbands)
        signals = np.stack([simulator.bodies(scan) for simulator in simulators])
        looks.append(operator.adjoint(signals).reshape(len(simulators), -1) / level)
    return np.array(looks)


# The ground without targets


class BareGround:
    """Target-free ground of a site: all looks at its places, whitened in two ways.

    Covariances are those of a metre of distance ahead, as the oracle has them.
    """

    def __init__(self, setup, lane: GroundLane) -> None:
        borders = lane.lane
        self.grid = Grid.spanning(
            (borders.x_min, borders.x_max), (borders.y_min, borders.y_max), STEP
        )
        self.area = borders.area
        looks = looks_at(setup, self.grid.points().reshape(-1, 3))
        self.place = looks.place
        self.ahead = looks.ahead
        metre = looks.ahead.astype(int)
        self.inverses = {"full": {}, "diagonal": {}}
        self.chips = {"full": looks.chip, "diagonal": looks.chip.copy()}
        for number in np.unique(metre):
            chip = looks.chip[metre == number]
            power = (np.abs(chip) ** 2).mean(axis=0, dtype=float)
            self.inverses["full"][int(number)] = inverse_covariance(chip)
            self.inverses["diagonal"][int(number)] = np.diag(1 / power)
            for kind, inverses in self.inverses.items():
                evened = divided_by_rms(chip, inverses[int(number)])
                self.chips[kind][metre == number] = evened

    def inverse(self, kind: str, ahead: float) -> np.ndarray:
        """Return the inverse covariance of the metre nearest to a distance (m)."""
        inverses = self.inverses[kind]
        return inverses[min(inverses, key=lambda metre: abs(metre + 0.5 - ahead))]

    def nearest(self, ahead: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the places seen, and the number of the look nearest to a distance at each."""
        order = np.lexsort((-np.abs(self.ahead - ahead), self.place))
        last = np.r_[self.place[order][1:] != self.place[order][:-1], True]
        return self.place[order][last], order[last]

    def count(self, statistic: np.ndarray, level: float) -> int:
        """Count the false alarms that reach a level."""
        return count_maxima(statistic.reshape(self.grid.ny, self.grid.nx), level)


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
        filters = []
        energies = []
        for y, echo in zip(ahead, echoes, strict=True):
            filtered = echo @ ground.inverse(kind, y).T
            filters.append(filtered)
            energies.append((filtered.conj() * echo).sum(axis=1).real)
        filter_array = np.array(filters)
        energy = np.array(energies)
        total = np.maximum(energy.sum(axis=0), 1e-30)
        scale = np.sqrt(total[0] / total)
        return cls(filter_array * scale[:, None], energy * scale**2)


def statistics(values: dict[str, np.ndarray], filters: dict[str, Filters]) -> dict[str, np.ndarray]:
    """Return the statistic (place,) of every rung from filtered looks (place, look, signature)."""
    groups = np.array(["own", *[row.group for row in candidates()]])

    def of(kind: str, group: str) -> np.ndarray:
        return values[kind][..., groups == group]

    def unknown_level(kind: str, group: str) -> np.ndarray:
        energy = np.maximum(filters[kind].energy[:, groups == group], 1e-30)
        return (np.abs(of(kind, group)) ** 2 / energy).sum(axis=1)

    bodies = log_bessel(of("full", "bodies")).sum(axis=1)
    greatest = bodies.max(axis=1)
    mean_of_bodies = greatest + np.log(np.exp(bodies - greatest[:, None]).mean(axis=1))
    return {
        "phases": 2 * of("full", "own").real.sum(axis=(1, 2)),
        "oracle": log_bessel(of("full", "own")).sum(axis=(1, 2)),
        "level unknown": unknown_level("full", "own")[:, 0],
        "flat ground": log_bessel(of("full", "flat")).sum(axis=(1, 2)),
        "depth and soil unknown": log_bessel(of("full", "grid")).sum(axis=1).max(axis=1),
        "body unknown": mean_of_bodies,
        "white clutter": log_bessel(of("diagonal", "own")).sum(axis=(1, 2)),
        "metal signatures": log_bessel(of("full", "metal")).sum(axis=1).max(axis=1),
        "metal, white clutter": log_bessel(of("diagonal", "metal")).sum(axis=1).max(axis=1),
        "metal, white, level unknown": unknown_level("diagonal", "metal").max(axis=1),
    }


def rates(
    ground: BareGround, ahead: np.ndarray, chips: np.ndarray, echoes: np.ndarray
) -> dict[str, float]:
    """Compute the false alarms per m² of a mine on every rung.

    Parameters
    ----------
    ground : BareGround
        Target-free ground of the site.
    ahead : (look,) ndarray
        Distances ahead, m.
    chips : (look, value) ndarray of complex
        The looks at the mine.
    echoes : (look, signature, value) ndarray of complex
        The mine's own echo and all candidates.
    """
    found = _rates(ground, ahead, chips, echoes)
    near = [int(np.argmin(ahead))]
    found["one look"] = _rates(ground, ahead[near], chips[near], echoes[near])["oracle"]
    return found


def _rates(ground: BareGround, ahead, chips, echoes) -> dict[str, float]:
    """Compute the rates of all rungs on some looks."""
    filters = {kind: Filters.of(ground, kind, ahead, echoes) for kind in ground.inverses}
    places = ground.grid.nx * ground.grid.ny
    shape = (places, len(ahead), echoes.shape[1])
    at_mine = {}
    over_ground = {}
    for kind, of_kind in filters.items():
        at_mine[kind] = np.empty((1, *shape[1:]), complex)
        over_ground[kind] = np.zeros(shape, np.complex64)
        for look, y in enumerate(ahead):
            own = divided_by_rms(chips[look][None], ground.inverse(kind, y))
            conjugate = of_kind.filter[look].conj().T
            at_mine[kind][:, look] = own @ conjugate
            seen, number = ground.nearest(y)
            over_ground[kind][seen, look] = ground.chips[kind][number] @ conjugate.astype(
                np.complex64
            )
    levels = statistics(at_mine, filters)
    maps = statistics(over_ground, filters)
    found = {}
    for rung, level in levels.items():
        found[rung] = ground.count(maps[rung], float(level[0])) / ground.area
    return found


# All mines of the ground


def name_of(ground: Ground) -> str:
    """Return the name of a tier, or of a ground without tiers."""
    return ground.tier or "ground"


def look_at_site(
    ground: Ground, folder: Path, site: str, truth: pd.DataFrame, every: int, recipe: str
) -> Iterator[dict]:
    """Yield the false alarms per m² of every mine of a site, rung by rung."""
    bare, tested = lanes_of_site(ground, site)
    if bare is None:
        return
    start = time.process_time()
    ground_looks = BareGround(cleaned_lane(str(folder), bare, recipe), bare)
    print(f"{bare.name}: {time.process_time() - start:.0f} s", flush=True)
    for lane in tested:
        start = time.process_time()
        setup = cleaned_lane(str(folder), lane, recipe)
        targets = truth[truth["lane"] == lane.name].reset_index(drop=True)
        targets = targets.iloc[::every].reset_index(drop=True)
        looks, own = looks_at_mines(setup, lane, targets)
        print(f"{lane.name}: looks, {time.process_time() - start:.0f} s", flush=True)
        world = draw_world(lane.scene, lane.seed)
        points = ground_points(targets)
        for number, target in enumerate(targets.to_dict("records")):
            at = looks.place == number
            mine = world.targets[int(target["target_id"].rpartition("-T")[2]) - 1]
            others = candidate_echoes(setup, lane, mine, points[number])
            echoes = np.concatenate([own[at][:, None], others], axis=1)
            row = {"tier": name_of(ground), "site": site, "target_id": target["target_id"]}
            row |= {"kind": target["kind"], "body": target.get("body", ""), "looks": int(at.sum())}
            yield row | rates(ground_looks, looks.ahead[at], looks.chip[at], echoes)
        print(f"{lane.name}: {time.process_time() - start:.0f} s", flush=True)


def of_entry(ground: Ground, folder: Path, entry: str, truth: pd.DataFrame) -> dict[str, float]:
    """Return the false alarms per m² with which an entry finds each mine of the standard split."""
    file = entry_folder(folder, entry, ground) / "standard" / ALARMS
    if not file.is_file():
        return {}
    lanes = {lane.name: lane.lane for lane in ground.tested("standard")}
    own = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    matched = match(read_table(file, "alarms"), own, lanes, ground.table.halo)
    area = far_area(matched, "union")
    labelled = label_alarms(matched)
    false = np.sort(labelled.loc[labelled["label"] == "false", "confidence"].to_numpy())
    found = dict.fromkeys(own["target_id"], math.inf)
    for row in labelled[labelled["label"] == "detection"].itertuples():
        before = len(false) - np.searchsorted(false, row.confidence)
        found[own["target_id"][row.target]] = before / area
    return found


# Tables and figure


def far_at(far: np.ndarray, level: float) -> float:
    """Return the false alarms per m² at which a share of the mines is found."""
    ordered = np.sort(far)
    return float(ordered[math.ceil(level * len(ordered)) - 1])


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return false alarms at a Pd and mines found at a rate, with intervals, by tier and kind.

    The intervals of false alarms are the bootstrap's over mines (2000 samples, 95 %), those of
    counts exact.
    """
    rows = []
    rng = np.random.default_rng(51)
    columns = [name for name in (*RUNGS, *ENTRIES) if name in table]
    for tier, of_tier in table.groupby("tier", sort=False):
        for group in GROUPS:
            mines = of_tier[of_tier["kind"] != "simulant"]
            if group != "mines":
                mines = mines[mines["kind"] == group]
            if not len(mines):
                continue
            samples = rng.integers(0, len(mines), (2000, len(mines)))
            for column in columns:
                far = mines[column].fillna(math.inf).to_numpy()
                row = {"tier": tier, "group": group, "rung": column, "mines": len(mines)}
                for level in LEVELS:
                    drawn = np.sort([far_at(far[sample], level) for sample in samples])
                    row[f"far_at_{level:g}"] = far_at(far, level)
                    row[f"low_{level:g}"] = drawn[49]
                    row[f"high_{level:g}"] = drawn[1949]
                found = int((far <= FAR).sum())
                low, high = clopper_pearson(found, len(far))
                row |= {"found": found, "pd": found / len(far), "pd_low": low, "pd_high": high}
                rows.append(row)
    return pd.DataFrame(rows)


def report(rows: pd.DataFrame, least: float) -> None:
    """Print the tables; ``least`` is one false alarm over the ground, per m²."""

    def cell(value: float) -> str:
        if not math.isfinite(value):
            return "never"
        return f"< {least:.2g}" if value == 0 else f"{value:.2g}"

    for tier, of_tier in rows.groupby("tier", sort=False):
        for group, of_group in of_tier.groupby("group", sort=False):
            count = of_group["mines"].iloc[0]
            print(f"\n{tier}, {group}: {count}\n")
            print("| knows | at Pd 0.5 | at Pd 0.7 | found at 0.02 per m² |\n|---|---|---|---|")
            for row in of_group.to_dict("records"):
                cells = []
                for level in LEVELS:
                    low, high = cell(row[f"low_{level:g}"]), cell(row[f"high_{level:g}"])
                    cells.append(f"{cell(row[f'far_at_{level:g}'])} ({low} to {high})")
                name = RUNGS.get(row["rung"], ENTRIES.get(row["rung"], ""))
                share = f"{row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f})"
                print(f"| {name} | {' | '.join(cells)} | {row['found']}, {share} |")


def draw(rows: pd.DataFrame, least: float, path: Path) -> None:
    """Draw false alarms at Pd 0.5, and mines found at 0.02 per m², by rung, on both tiers."""
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    names = {**RUNGS, **ENTRIES}
    order = [name for name in names if (rows["rung"] == name).any()]
    tiers = list(dict.fromkeys(rows["tier"]))
    styles = dict(zip(tiers, (("o", "C0", 0.15), ("s", "C1", -0.15)), strict=False))
    for panel, (group, quantity) in zip(
        panels, (("metal", "far"), ("plastic", "far"), ("mines", "pd")), strict=True
    ):
        for tier, (marker, colour, shift) in styles.items():
            some = rows[(rows["tier"] == tier) & (rows["group"] == group)].set_index("rung")
            if not len(some):
                continue
            some = some.reindex(order)
            place = -np.arange(len(order)) + shift
            if quantity == "pd":
                low, value, high = some["pd_low"], some["pd"], some["pd_high"]
            else:
                floor = least / 2  # none over the ground
                low, value, high = (
                    some[column].clip(floor, 3.0)
                    for column in ("low_0.5", "far_at_0.5", "high_0.5")
                )
            panel.hlines(place, low, high, color=colour, lw=1.3)
            fill = colour if marker == "o" else "white"
            panel.plot(value, place, marker, color=colour, mfc=fill, ms=5, label=tier)
        if quantity == "far":
            panel.set(xscale="log", xlabel="false alarms per m² at Pd 0.5", title=group)
            panel.axvline(least, color="0.7", ls=":", lw=1)
        else:
            panel.set(xlim=(0, 1), xlabel="Pd at 0.02 false alarms per m²", title="all mines")
        panel.grid(axis="x", alpha=0.3)
    panels[0].set_yticks(-np.arange(len(order)), [names[name] for name in order])
    panels[2].legend(fontsize=9)
    figure.savefig(path, dpi=85, metadata={"Software": None})


def main(arguments: list[str] | None = None) -> None:
    """Climb the ladder, or tell of what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ground", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tier")
    parser.add_argument("--site", action="append")
    parser.add_argument("--every", type=int, default=1, help="look at every so-manieth target")
    parser.add_argument("--recipe", default="wang2007", help="whose images are looked at")
    parser.add_argument("--summary", action="store_true")
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args(arguments)
    tiers = read_ground(given.ground).chosen_tiers(given.tier)
    sites = sorted({site for ground in tiers for site in ground.sites})
    for site in given.site or []:
        if site not in sites:
            parser.error(f"--site must be one of {', '.join(sites)}, got {site}")
    given.out.mkdir(parents=True, exist_ok=True)
    log = given.out / "looks.jsonl"
    truth = open_truth(given.ground / "lanes" / SEALED, passphrase(tiers[0]), log)[0]
    files = []
    for ground in tiers:
        for site in ground.sites:
            if given.site and site not in given.site:
                continue
            file = given.out / f"ladder-{name_of(ground)}-{site}.csv"
            files.append(file)
            if given.summary or file.is_file():
                continue
            rows = list(look_at_site(ground, given.ground, site, truth, given.every, given.recipe))
            pd.DataFrame(rows).to_csv(file, index=False, float_format="%.6g")
    table = pd.concat([read_columns(file) for file in files if file.is_file()], ignore_index=True)
    for ground in tiers:
        for entry in ENTRIES:
            found = of_entry(ground, given.ground, entry, truth)
            own = table["tier"] == name_of(ground)
            if found:
                table.loc[own, entry] = table.loc[own, "target_id"].map(found)
    rows = summary(table)
    rows.to_csv(given.out / "ladder.csv", index=False, float_format="%.5g")
    bare = [lane for ground in tiers for lane in ground.lanes.values() if lane.empty]
    least = 1 / min((lane.lane.area for lane in bare), default=math.inf)
    report(rows, least)
    if given.figure is not None:
        draw(rows, least, given.figure)


if __name__ == "__main__":
    main()
