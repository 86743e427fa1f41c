"""Alarms of a map, what they find, and the table of variants."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from flgpr.scoring import mcnemar_test
from flgpr_ground.oracle import STEP
from fused_maps.lanes import HALO, LOW, RATE, RATES, Lane, distances
from fused_maps.learnt import Trained
from fused_maps.signatures import Signatures


def smoothed(values: np.ndarray) -> np.ndarray:
    """Smooth a map as `fused` does; places that were never seen have the least value."""
    filled = np.where(np.isfinite(values), values, np.nanmin(values))
    return gaussian_filter(filled, 0.15 / STEP, mode="nearest")


def alarms_of(lane: Lane, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (alarm, 2) and values of the local maxima within 0.5 m."""
    v, u = np.mgrid[-2:3, -2:3]
    disc = (u**2 + v**2) * STEP**2 <= 0.5**2
    row, column = np.nonzero(values == maximum_filter(values, footprint=disc, mode="nearest"))
    places = np.column_stack([lane.x_min + STEP * column, lane.y_min + STEP * row])
    return places, values[row, column]


@dataclass
class Found:
    """False alarms per m² at which every target is found."""

    far: np.ndarray
    kinds: np.ndarray
    sites: np.ndarray

    @classmethod
    def on(cls, lanes: Sequence[Lane], maps: Sequence[np.ndarray]) -> Found:
        """Score maps of lanes as one list."""
        false, best, kinds, sites, area = [], [], [], [], 0.0
        for lane, values in zip(lanes, maps, strict=True):
            places, height = alarms_of(lane, values)
            false.append(height[distances(places, lane.targets) > HALO])
            for target, kind in zip(lane.targets, lane.kinds, strict=True):
                near = np.linalg.norm(places - target, axis=1) <= HALO
                best.append(height[near].max() if near.any() else -np.inf)
                kinds.append(kind)
                sites.append(lane.site)
            area += lane.area()
        ordered = np.sort(np.concatenate(false))
        values = np.array(best)
        far = (len(ordered) - np.searchsorted(ordered, values)) / area
        far[~np.isfinite(values)] = np.inf
        return cls(far, np.array(kinds), np.array(sites))

    def log_far(self) -> np.ndarray:
        """Return log10 of the false alarms, between one on the lanes and more than counts."""
        return np.log10(np.clip(self.far, 3e-4, 0.3))

    def row(self, name: str, reference: Found) -> str:
        """Return a row of the table."""
        cells = [name]
        for kind in ("metal", "plastic", "ap"):
            found = [int((self.far[self.kinds == kind] < rate).sum()) for rate in RATES]
            cells.append(", ".join(str(number) for number in found))
        mine = self.kinds != "simulant"
        cells.append(", ".join(str(int((self.far[mine] < rate).sum())) for rate in RATES))
        ours, theirs = self.far[mine] < RATE, reference.far[mine] < RATE
        alone, others = int((ours & ~theirs).sum()), int((theirs & ~ours).sum())
        cells.append(f"{alone}, {others} ({mcnemar_test(alone, others):.2g})")
        for kind in ("metal", "plastic"):
            change = (self.log_far() - reference.log_far())[self.kinds == kind]
            error = change.std(ddof=1) / math.sqrt(len(change))
            cells.append(f"{change.mean():+.3f} ± {error:.3f}")
        return f"| {' | '.join(cells)} |"


class Bench:
    """The lanes of one tier, every site with what the other sites teach."""

    def __init__(self, tier: str, lanes: list[Lane], signatures: dict[str, Signatures]) -> None:
        self.tier = tier
        self.lanes = lanes
        self.signatures = signatures
        self.trained = {}
        for lane in lanes:
            others = [
                other for other in lanes
                if other.site != lane.site and other.design in ("metal", "plastic")
            ]  # fmt: skip
            self.trained.setdefault(lane.site, Trained(others, signatures))
        self.reference: Found | None = None

    def by_site(self, learn: Callable[[Trained], object]) -> dict[str, object]:
        """Return what is learnt for every site."""
        return {site: learn(trained) for site, trained in self.trained.items()}

    def tell(self, name: str, value: Callable[[Lane], np.ndarray]) -> None:
        """Print the row of a variant; ``value`` is a map (y, x). The first is the reference."""
        found = Found.on(self.lanes, [smoothed(value(lane)) for lane in self.lanes])
        if self.reference is None:
            self.reference = found
            mines = {kind: int((found.kinds == kind).sum()) for kind in ("metal", "plastic", "ap")}
            print(f"\n{self.tier}: {mines}\n")
            print("| map | metal | plastic | AP | all | alone (p) | metal | plastic |")
            print("|---|---|---|---|---|---|---|---|")
        print(found.row(name, self.reference), flush=True)


def level(lane: Lane, bands: Sequence[int] = LOW) -> np.ndarray:
    """Return the mean contrast (look,) in HH and VV of some sub-bands, dB."""
    return lane.contrast[:, :2, list(bands)].mean(axis=(1, 2))
