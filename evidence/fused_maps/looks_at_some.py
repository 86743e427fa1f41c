"""Looks at chosen places into which simulated bodies are put."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from fused_maps.lanes import BANDS, NAVIGATION, Lane, weighted_means
from fused_maps.scores import Bench
from fused_maps.signatures import phases_of

SHARES = {
    "metal": 0.45, "tm-62p": 0.12, "vs-1.6": 0.11, "m19": 0.1, "plastic-at": 0.06,
    "plastic-at-cavity": 0.06, "pmn": 0.1,
}  # fmt: skip


@dataclass
class Looks:
    """Looks at some places, with bodies put in or as they are."""

    place: np.ndarray
    metre: np.ndarray
    weight: np.ndarray
    chip: np.ndarray
    ring: np.ndarray  # (look, polarization, sub-band) power about the place
    count: int  # of places

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted mean over looks (place,)."""
        return weighted_means(self.place, self.weight, values, self.count)

    def decibels(self) -> np.ndarray:
        """Return the contrast (look, polarization, sub-band) of chips to their rings, dB."""
        power = (np.abs(self.chip) ** 2).mean(axis=-1)
        return 10 * np.log10(np.maximum(power, 1e-6) / np.maximum(self.ring, 1e-6))


def ring_powers(lane: Lane) -> np.ndarray:
    """Return the mean power (look, polarization, sub-band) of chips 0.7 to 1.5 m about each."""
    power = (np.abs(lane.chip) ** 2).mean(axis=-1).reshape(len(lane.chip), -1)
    ring = np.empty_like(power)
    for scan in np.unique(lane.scan):
        at = np.flatnonzero(lane.scan == scan)
        row, column = np.divmod(lane.place[at], lane.columns)
        row = row - row.min()
        shape = (row.max() + 1, lane.columns)
        image = np.zeros((*shape, power.shape[1]))
        seen = np.zeros((*shape, 1))
        image[row, column] = power[at]
        seen[row, column] = 1

        def total(values: np.ndarray, half: int) -> np.ndarray:
            size = 2 * half + 1
            return uniform_filter(values, (size, size, 1), mode="constant") * size**2

        about = (total(image, 7) - total(image, 3)) / np.maximum(total(seen, 7) - total(seen, 3), 1)
        ring[at] = about[row, column]
    return ring.reshape(len(ring), 3, len(BANDS))


def free_places(lane: Lane) -> np.ndarray:
    """Return the numbers of places away from all targets that were seen."""
    return np.intersect1d(np.flatnonzero(lane.to_target > 1.5), lane.place)


def all_looks(lane: Lane, ring: np.ndarray) -> Looks:
    """Return all looks of a lane as they are."""
    return Looks(lane.place, lane.metre, lane.weight, lane.chip, ring, lane.places)


def looks_at_some(lane: Lane, ring: np.ndarray, chosen: np.ndarray) -> Looks:
    """Return the looks at chosen places, in their order; a place may come twice."""
    order = np.argsort(lane.place, kind="stable")
    ordered = lane.place[order]
    looks, numbers = [], []
    for number, place in enumerate(chosen):
        low, high = np.searchsorted(ordered, [place, place + 1])
        looks.append(order[low:high])
        numbers.append(np.full(high - low, number))
    look = np.concatenate(looks)
    return Looks(
        np.concatenate(numbers), lane.metre[look], lane.weight[look], lane.chip[look].copy(),
        ring[look], len(chosen),
    )  # fmt: skip


def put_in_bodies(some: Looks, lane: Lane, bench: Bench, rng: np.random.Generator) -> None:
    """Put a drawn body into the chips of every place, at the level that it has on this lane."""
    units = {}
    for name, of_body in bench.signatures.items():
        units[name] = of_body.by_metre(of_body.in_units(lane))
    drawn = rng.choice(list(SHARES), some.count, p=list(SHARES.values()))
    first = np.searchsorted(some.place, np.arange(some.count + 1))
    for number, name in enumerate(drawn):
        looks = slice(first[number], first[number + 1])
        body = units[name][rng.integers(len(units[name]))]
        error = rng.normal(0, NAVIGATION, looks.stop - looks.start)
        some.chip[looks] += body[some.metre[looks]] * phases_of(error, range(len(BANDS)))
