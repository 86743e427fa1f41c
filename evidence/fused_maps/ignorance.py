"""Experiment: what it costs not to know which signature a mine has."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from fused_maps.lanes import FOUR, HALO, METRES, RATE, Lane, distances
from fused_maps.learnt import Clutter
from fused_maps.looks_at_some import free_places, looks_at_some
from fused_maps.scores import Bench, alarms_of
from fused_maps.signatures import Signatures, phases_of


class Bank:
    """Signatures with which the looks at a place are compared, one and the same in all of them.

    The statistic is the mixture over chosen signatures and over powers, phases of looks unknown.
    """

    POWERS = (10.0, 30.0, 100.0, 300.0)
    MOVES = (-0.08, -0.04, 0.0, 0.04, 0.08)  # m ahead

    def __init__(self, lane: Lane, clutter: Clutter, signatures: dict[str, Signatures]) -> None:
        self.lane = lane
        self.clutter = clutter
        parts, names, soils, copies, moves = [], [], [], [], []
        for name, of_body in signatures.items():
            plain = of_body.in_units(lane)[:, :, :, list(clutter.bands)]
            for move in self.MOVES:
                chips = plain * phases_of(np.full(plain.shape[:2], move), clutter.bands)
                chips = of_body.by_metre(chips).reshape(len(chips), METRES, -1)
                white = [chips[:, m] @ clutter.whitener[m].T for m in range(METRES)]
                parts.append(np.stack(white, axis=1))
                names += [name] * len(chips)
                soils += of_body.soil.tolist()
                copies += range(len(chips))
                moves += [move] * len(chips)
        bank = np.concatenate(parts)
        self.bank = (bank / np.linalg.norm(bank, axis=2)[:, :, None]).astype(np.complex64)
        self.names = np.array(names)
        self.soils = np.array(soils)
        self.copies = np.array(copies)
        self.moves = np.array(moves)
        order = np.argsort(lane.place, kind="stable")
        self.first = np.flatnonzero(np.diff(lane.place[order], prepend=-1))
        self.seen = lane.place[order][self.first]
        self.ground = self.shares(clutter.white(lane), lane.metre)[order]
        self._thresholds: dict[bytes, float] = {}

    def shares(self, white: np.ndarray, metre: np.ndarray) -> np.ndarray:
        """Return the shares (look, signature) of the power of whitened looks."""
        found = np.empty((len(white), len(self.bank)), np.float32)
        for number in np.unique(metre):
            at = metre == number
            found[at] = np.abs(white[at] @ self.bank[:, number].conj().T) ** 2
        return found / (np.abs(white) ** 2).sum(axis=1)[:, None]

    def statistic(self, share: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return the statistic of places whose looks begin at rows ``first``."""
        by_power = []
        for power in self.POWERS:
            rest = np.maximum(1 - share * (power / (1 + power)), 1e-6)
            by_look = -self.clutter.values * np.log(rest) - math.log1p(power)
            by_power.append(np.add.reduceat(by_look, first, axis=0))
        return logsumexp(np.concatenate(by_power, axis=1), axis=1)

    def threshold(self, chosen: np.ndarray) -> float:
        """Return the statistic of chosen signatures at 0.02 false alarms per m² on the lane."""
        key = chosen.tobytes()
        if key not in self._thresholds:
            lane = self.lane
            values = np.full(lane.places, -np.inf)
            values[self.seen] = self.statistic(self.ground[:, chosen], self.first)
            places, height = alarms_of(lane, values.reshape(lane.rows, lane.columns))
            false = np.sort(height[distances(places, lane.targets) > HALO])[::-1]
            self._thresholds[key] = float(false[int(RATE * lane.area())])
        return self._thresholds[key]

    def banks(self, body: str, copy: int, soil: int) -> tuple[np.ndarray, ...]:
        """Return which signatures are compared, from the body's own to all of them."""
        is_body = self.names == body
        own = is_body & (self.copies == copy)
        in_soil = self.soils == soil
        return (
            own & (self.moves == 0),
            is_body & in_soil & ~own,
            is_body & ~own,
            in_soil & ~own,
            ~own,
            np.ones(len(own), bool),
        )

    def found(self, body: str, of_body: Signatures, soil: int) -> np.ndarray:
        """Return which bodies are found at drawn places of the lane (body, bank)."""
        rng = np.random.default_rng(51)
        free = free_places(self.lane)
        own = of_body.by_metre(of_body.in_units(self.lane))
        some = (of_body.soil == soil) & (of_body.depth > -0.1)
        hits = []
        for copy in np.flatnonzero(some)[::2]:
            no_ring = np.zeros((len(self.lane.chip), 1))
            looks = looks_at_some(self.lane, no_ring, rng.choice(free, 20))
            looks.chip += own[copy][looks.metre]
            chips = looks.chip[:, :, list(self.clutter.bands)].reshape(len(looks.chip), -1)
            share = self.shares(self.clutter.whitened(chips, looks.metre), looks.metre)
            first = np.searchsorted(looks.place, np.arange(looks.count))
            for chosen in self.banks(body, int(copy), soil):
                hits.append(self.statistic(share[:, chosen], first) > self.threshold(chosen))
        banks = len(self.banks(body, 0, soil))
        return np.array(hits).reshape(-1, banks, 20).swapaxes(1, 2).reshape(-1, banks)


def try_ignorance(bench: Bench) -> None:
    """Tell how often a body put into measured ground is found, by what is known of it.

    The threshold is that of 0.02 false alarms per m² of the same signatures on the same lane.
    """
    nearest_soil = {"sand": 0, "earth": 2, "gravel": 1}  # to the site's; few are found in clay
    print(f"\n{bench.tier}: share found of bodies put into the lane `plastic` of a site\n")
    heads = (
        "site",
        "body",
        "itself",
        "other copies",
        "all soils",
        "all bodies, its soil",
        "all others",
        "all",
    )
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for lane in bench.lanes:
        if lane.design != "plastic" or lane.site not in nearest_soil:
            continue
        bank = Bank(lane, bench.trained[lane.site].clutter(FOUR), bench.signatures)
        for body in ("metal", "tm-62p", "vs-1.6", "m19"):
            found = bank.found(body, bench.signatures[body], nearest_soil[lane.site])
            cells = " | ".join(f"{value:.2f}" for value in found.mean(axis=0))
            print(f"| {lane.site} | {body} | {cells} |", flush=True)
