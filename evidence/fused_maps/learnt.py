"""What the lanes of the other sites teach: the covariance of clutter, and directions of signatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flgpr.stages.likelihood import LikelihoodSettings
from flgpr.stages.textured_clutter import ratio
from fused_maps.lanes import METRES, NEAREST, Lane
from fused_maps.signatures import CLASSES, Signatures

RATIOS = LikelihoodSettings(sensor="sri-array").ratios


@dataclass
class Clutter:
    """What whitens chips of some sub-bands by metre ahead."""

    bands: tuple[int, ...]
    covariance: np.ndarray  # (metre, value, value), of unit power
    whitener: np.ndarray  # (metre, value, value)

    @classmethod
    def of(cls, bands: Sequence[int], covariance: np.ndarray) -> Clutter:
        """Return the clutter of a covariance (metre, value, value)."""
        size = covariance.shape[-1]
        power = np.trace(covariance, axis1=1, axis2=2).real
        even = covariance * (size / power)[:, None, None]
        whitener = np.linalg.inv(np.linalg.cholesky(even + 1e-3 * np.eye(size)))
        return cls(tuple(bands), even, whitener.astype(np.complex64))

    @property
    def values(self) -> int:
        """Number of values of a chip."""
        return self.covariance.shape[-1]

    def white(self, lane: Lane) -> np.ndarray:
        """Return the whitened chips (look, value) of a lane."""
        return self.whitened(lane.chips(self.bands), lane.metre)

    def whitened(self, chips: np.ndarray, metre: np.ndarray) -> np.ndarray:
        """Return whitened chips (look, value)."""
        white = np.empty_like(chips)
        for number in np.unique(metre):
            at = metre == number
            white[at] = chips[at] @ self.whitener[number].T
        return white


def sums_of(chips: np.ndarray, metre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of x x^H by metre, every chip over its own power, and their numbers."""
    size = chips.shape[1]
    total = np.zeros((METRES, size, size), complex)
    count = np.zeros(METRES)
    for number in np.unique(metre):
        some = chips[metre == number]
        power = (np.abs(some) ** 2).mean(axis=1, keepdims=True)
        some = some / np.sqrt(np.maximum(power, 0.05))
        total[number] = some.T @ some.conj()
        count[number] = len(some)
    return total, count


def with_neighbours(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the covariance of every metre and of those before and after it."""
    covariance = []
    for metre in range(METRES):
        near = slice(max(metre - 1, 0), metre + 2)
        covariance.append(total[near].sum(axis=0) / max(count[near].sum(), 1))
    return np.array(covariance)


def rank_of(bands: Sequence[int]) -> int:
    """Return the number of directions for some sub-bands: 12 for three, four more for each."""
    return 12 + 4 * (len(bands) - 3)


@dataclass
class Trained:
    """What the lanes of the other sites teach, for the lanes of one site."""

    lanes: list[Lane]
    signatures: dict[str, Signatures]
    known: dict[tuple[int, ...], tuple[Clutter, dict[str, list]]] = field(default_factory=dict)

    def classes(self, bands: Sequence[int]) -> tuple[Clutter, dict[str, list]]:
        """Return the clutter, and the directions of every class of bodies in it."""
        key = tuple(bands)
        if key not in self.known:
            clutter = self.clutter(bands)
            found = {}
            for name, bodies in CLASSES.items():
                found[name] = self.directions(clutter, bodies, rank_of(bands))
            self.known[key] = (clutter, found)
        return self.known[key]

    def clutter(self, bands: Sequence[int]) -> Clutter:
        """Return the clutter of target-free ground."""
        total, count = 0.0, 0.0
        for lane in self.lanes:
            of_lane = sums_of(lane.chips(bands)[lane.free], lane.metre[lane.free])
            total, count = total + of_lane[0], count + of_lane[1]
        return Clutter.of(bands, with_neighbours(total, count))

    def directions(
        self, clutter: Clutter, bodies: Sequence[str], rank: int, ahead: float | None = None
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the principal vectors of bodies in whitened clutter, and their shares, by metre.

        With ``ahead`` all chips are moved to a place so far ahead of the body.
        """
        chips, places = [], []
        bands = clutter.bands
        for body in bodies:
            of_body = self.signatures[body]
            for lane in self.lanes[::2]:
                some = of_body.in_units(lane)[:, :, :, list(bands)]
                if ahead is not None:
                    some = of_body.moved(some, ahead, bands)
                chips.append(some.reshape(-1, clutter.values))
                places.append(of_body.place[..., 1].ravel() - NEAREST)
        chip, place = np.concatenate(chips), np.concatenate(places)
        found = []
        for metre in range(METRES):
            near = np.abs(place - metre - 0.5) < 1.0
            white = chip[near] @ clutter.whitener[metre].T
            white = white / np.linalg.norm(white, axis=1, keepdims=True)
            _, strength, vectors = np.linalg.svd(white, full_matrices=False)
            share = strength**2 / (strength**2).sum()
            found.append((vectors.conj()[:rank].astype(np.complex64), share[:rank]))
        return found


def ratios_of(white: np.ndarray, metre: np.ndarray, directions: list) -> np.ndarray:
    """Return the log-likelihood ratio of every whitened look."""
    value = np.empty(len(white))
    for number in np.unique(metre):
        at = metre == number
        value[at] = ratio(white[at], *directions[number], RATIOS)
    return value
