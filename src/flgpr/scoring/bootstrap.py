"""Uncertainty of a curve by resampling of targets, lanes and stretches of lane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from flgpr.model import Lane
from flgpr.scoring.area import union_area
from flgpr.scoring.curve import check_level
from flgpr.scoring.lane_roc import AreaRule, far_area
from flgpr.scoring.matching import Match, Subset, positions, select_targets
from flgpr.types import ArrayLike, FloatArray, IntArray, floats


@dataclass(frozen=True)
class ResamplingDesign:
    """What is resampled: clusters of targets, lanes, and blocks of lane.

    The factors may cross (the same mine in two passes). Each is therefore drawn by itself with
    replacement, and a target or false alarm has the product of its factors' weights (pigeonhole
    bootstrap, Owen 2007).
    """

    lanes: int  #: number of lanes; they are drawn only if there are several
    clusters: int  #: number of clusters of targets
    #: target_cluster, target_lane: (target,) cluster and lane of every chosen target
    target_cluster: IntArray
    target_lane: IntArray
    block_lane: IntArray  #: (block,) lane of every block
    #: (block,) area of every block outside the halos, m², in proportion to ``area``
    block_area: FloatArray
    #: first block, start (m), length (m) and number of the blocks of each lane
    block_y: tuple[tuple[int, float, float, int], ...]
    area: float  #: area that the FAR of the whole list refers to, m²

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw weights of the targets and of the blocks; some target always has weight."""
        while True:
            lane = _draw_counts(rng, self.lanes) if self.lanes > 1 else np.ones(1)
            cluster = _draw_counts(rng, self.clusters)
            target = cluster[self.target_cluster] * lane[self.target_lane]
            block = _draw_counts(rng, len(self.block_lane)) * lane[self.block_lane]
            if target.any() and (block * self.block_area).sum() > 0:
                return target, block


@dataclass(frozen=True)
class Scores:
    """Alarms of a detector as resampling needs them: scores of targets, and false alarms."""

    #: (target,) confidence of each chosen target's best alarm, -inf where there is none
    target: FloatArray
    false: FloatArray  #: (false,) confidences of the false alarms, falling
    block: IntArray  #: (false,) block each of them lies in
    above: IntArray  #: (target,) number of false alarms at or above each target's score

    def pd_at(
        self, far: FloatArray, target: FloatArray, block: FloatArray, area: float
    ) -> FloatArray:
        """Return the weighted Pd at allowed false alarm rates."""
        rate = np.cumsum(block[self.block]) / area
        first = np.searchsorted(rate, far, side="right")
        barrier = np.append(self.false, -np.inf)[first]
        order = np.argsort(-self.target)
        found_weight = np.append(0.0, np.cumsum(target[order]))
        n_found = np.searchsorted(-self.target[order], -barrier, side="left")
        return found_weight[n_found] / target.sum()

    def shares(self, far_max: float, block: FloatArray, area: float) -> FloatArray:
        """Compute what each target adds to PD_mean: 1 - FAR/far_max at which it is found.

        It is at least 0, and 0 for a target that is not found.
        """
        rate = np.append(0.0, np.cumsum(block[self.block])) / area
        share = np.maximum(0.0, 1 - rate[self.above] / far_max)
        return np.where(np.isneginf(self.target), 0.0, share)


def band(
    matched: Match,
    subset: Subset = None,
    far: ArrayLike | None = None,
    *,
    area: AreaRule = "union",
    frame_area: float | None = None,
    level: float = 0.95,
    draws: int = 1000,
    seed: int = 0,
    block: float = 10.0,
    cluster: str | None = None,
) -> pd.DataFrame:
    """Compute a simultaneous confidence band of Pd over FAR by bootstrap.

    Targets are drawn in clusters, and so are lanes and blocks of lane. The band is Pd ± c·s: s is
    the standard deviation of the resampled curves, not less than the binomial one with two
    successes and two failures added (resampling sees no spread where all targets are found), and c
    the level's quantile of the largest standardised deviation over the whole grid, not less than
    the normal one. See the docs for its measured coverage.

    Parameters
    ----------
    matched, subset, area, frame_area
        As for :func:`flgpr.scoring.roc_of`.
    far : (point,) array_like, optional
        Grid of false alarm rates, per m²; 0 to 0.1 in 51 points by default.
    level : float
        Probability that the band holds the whole curve.
    draws, seed : int
        Number of resamplings, and their seed.
    block : float
        Length of the blocks of lane whose false alarms are drawn together, m.
    cluster : str, optional
        Column of truth that names the mine where several rows show the same one; by default each
        row is its own.

    Returns
    -------
    DataFrame
        ``far``, ``pd``, ``pd_low``, ``pd_high``.

    Raises
    ------
    ValueError
        If an option is not valid or there is no target.
    """
    rates = np.linspace(0, 0.1, 51) if far is None else far
    grid = np.atleast_1d(floats(rates))
    if grid.ndim != 1 or not (grid >= 0).all():
        raise ValueError(f"far must be rates of at least 0, got {grid}")
    check_level(level)
    design = make_design(
        matched, subset, block=block, cluster=cluster, area=area, frame_area=frame_area
    )
    scores = make_scores(matched, design, subset)
    once = np.ones(len(scores.target))
    every_block = np.ones(len(design.block_lane))
    centre = scores.pd_at(grid, once, every_block, design.area)
    curves = np.array([scores.pd_at(grid, *weights) for weights in draws_of(design, draws, seed)])

    resampled = curves.std(axis=0, ddof=1)
    # Two successes and two failures are added.
    shrunk = (centre * design.clusters + 2) / (design.clusters + 4)
    binomial = np.sqrt(shrunk * (1 - shrunk) / (design.clusters + 4))
    spread = np.maximum(resampled, binomial)
    largest_deviation = (np.abs(curves - centre) / spread).max(axis=1)
    of_level = float(np.quantile(largest_deviation, level))
    of_normal = float(special.ndtri((1 + level) / 2))
    factor = max(of_level, of_normal)

    # Pd rises with FAR, so a bound that dips or juts may be drawn level without losing a curve that
    # was inside.
    low = np.maximum.accumulate(np.clip(centre - factor * spread, 0, 1))
    high = np.minimum.accumulate(np.clip(centre + factor * spread, 0, 1)[::-1])[::-1]
    result = pd.DataFrame({"far": grid, "pd": centre, "pd_low": low, "pd_high": high})
    result.attrs = {
        "level": level,
        "draws": draws,
        "seed": seed,
        "clusters": design.clusters,
        "lanes": design.lanes,
        "factor": factor,
    }
    return result


def pd_mean_interval(
    matched: Match,
    far_max: float = 0.1,
    subset: Subset = None,
    *,
    area: AreaRule = "union",
    frame_area: float | None = None,
    level: float = 0.95,
    draws: int = 1000,
    seed: int = 0,
    block: float = 10.0,
    cluster: str | None = None,
) -> tuple[float, float]:
    """Compute an interval of PD_mean by the bootstrap, expanded for few mines (Hesterberg 2015).

    Parameters
    ----------
    far_max : float
        End of the averaging, per m².
    matched, subset, area, frame_area, level, draws, seed, block, cluster
        As for :func:`band`.

    Returns
    -------
    low, high : float
        Bounds of PD_mean.

    Raises
    ------
    ValueError
        If an option is not valid or there is no target.
    """
    design = make_design(
        matched, subset, block=block, cluster=cluster, area=area, frame_area=frame_area
    )
    scores = make_scores(matched, design, subset)
    means = []
    for target, weight, drawn_area in draws_of(design, draws, seed):
        shares = scores.shares(far_max, weight, drawn_area)
        means.append((target * shares).sum() / target.sum())
    low, high = np.quantile(means, tails(level, design.clusters))
    return float(low), float(high)


def tails(level: float, clusters: int) -> tuple[float, float]:
    """Compute the probabilities whose percentiles bound a mean of so many mines.

    Resampling n mines sees a spread too small by sqrt(1 - 1/n) and tails too thin by Student's t
    against the normal distribution; percentiles further out make up for both (Hesterberg 2015).
    They are 0 and 1 for a single mine.

    Parameters
    ----------
    level : float
        Level of the interval.
    clusters : int
        Number n of mines.

    Returns
    -------
    lower, upper : float
        Probabilities.
    """
    check_level(level)
    if clusters < 2:
        return 0.0, 1.0
    student = special.stdtrit(clusters - 1, (1 + level) / 2)
    reach = math.sqrt(clusters / (clusters - 1)) * student
    return float(special.ndtr(-reach)), float(special.ndtr(reach))


def make_design(
    matched: Match,
    subset: Subset = None,
    *,
    block: float = 10.0,
    cluster: str | None = None,
    area: AreaRule = "union",
    frame_area: float | None = None,
) -> ResamplingDesign:
    """Divide targets and lanes into what is resampled; the parameters are those of :func:`band`."""
    if not (math.isfinite(block) and block > 0):
        raise ValueError(f"block must be a positive length, got {block} m")
    if cluster is not None and cluster not in matched.truth.columns:
        raise ValueError(f"cluster must name a column of truth, got {cluster!r}")
    chosen = select_targets(matched.truth, subset)
    if not chosen.any():
        raise ValueError("truth must have at least one target for a bootstrap, got none")
    total = far_area(matched, area, frame_area)
    names = matched.truth.loc[chosen, cluster] if cluster is not None else np.arange(chosen.sum())
    codes, unique = pd.factorize(np.asarray(names))
    unnamed = int((codes < 0).sum())
    if unnamed:
        raise ValueError(
            f"cluster must name a mine in every row, got {unnamed} rows without {cluster}"
        )

    block_y: list[tuple[int, float, float, int]] = []
    block_area: list[float] = []
    block_lane: list[int] = []
    for number, lane in enumerate(matched.lanes.values()):
        length = lane.y_max - lane.y_min
        blocks = max(1, round(length / block))
        block_y.append((len(block_area), lane.y_min, length / blocks, blocks))
        block_area += _open_areas(matched, number, lane, blocks)
        block_lane += [number] * blocks
    # Rounding may leave a little less than nothing. By the area rule of the FAR the blocks together
    # have another area than the ground outside the halos.
    open_area = np.maximum(block_area, 0.0)
    return ResamplingDesign(
        lanes=len(matched.lanes),
        clusters=len(unique),
        target_cluster=codes.astype(np.int64),
        target_lane=matched.target_lane[chosen],
        block_lane=np.array(block_lane),
        block_area=open_area * (total / open_area.sum()),
        block_y=tuple(block_y),
        area=total,
    )


def _open_areas(matched: Match, number: int, lane: Lane, blocks: int) -> list[float]:
    """Compute the area outside the halos, m², of each of the equal blocks of a lane."""
    targets = positions(matched.truth)[matched.target_lane == number]
    edges = np.linspace(lane.y_min, lane.y_max, blocks + 1)
    areas = []
    for low, high in pairwise(edges):
        block = Lane(lane.x_min, lane.x_max, float(low), float(high))
        in_reach = (targets[:, 1] > low - matched.halo) & (targets[:, 1] < high + matched.halo)
        areas.append(block.area - union_area(targets[in_reach], matched.halo, block))
    return areas


def make_scores(matched: Match, design: ResamplingDesign, subset: Subset = None) -> Scores:
    """Return the scores of matched alarms that resampling needs."""
    chosen = select_targets(matched.truth, subset)
    target = matched.best(chosen)[1][chosen]
    row = np.flatnonzero(matched.false)
    row = row[np.argsort(-matched.confidence[row], kind="stable")]
    false = matched.confidence[row]
    lane = matched.alarm_lane[row]
    y = matched.alarms["y"].to_numpy()[row]
    first, start, length, blocks = (
        np.array(column)[lane] for column in zip(*design.block_y, strict=True)
    )
    # A false alarm at the far border of its lane belongs to the last block.
    block = first + np.minimum(np.floor((y - start) / length), blocks - 1)
    above = np.searchsorted(-false, -target, side="right")
    return Scores(target, false, block.astype(np.int64), above.astype(np.int64))


def draws_of(
    design: ResamplingDesign, draws: int, seed: int
) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Yield weights of targets and of blocks, and the area of the drawn blocks, m²."""
    if draws < 2:
        raise ValueError(f"draws must be at least 2, got {draws}")
    rng = np.random.default_rng(seed)
    for _ in range(draws):
        target, block = design.draw(rng)
        yield target, block, float((block * design.block_area).sum())


def _draw_counts(rng: np.random.Generator, units: int) -> Any:
    """Draw as many units as there are, with replacement, and count how often each is drawn."""
    return np.bincount(rng.integers(units, size=units), minlength=units).astype(np.float64)
