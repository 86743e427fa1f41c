"""Coverage of the intervals of scores: ``python evidence/interval_coverage.py [--lanes N] [--draws N]``."""

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from flgpr.model import Lane
from flgpr.scoring import band, clopper_pearson, match, pd_mean_interval, poisson_interval

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from suite.data import alarms_and_truth

SPACING = 10.0  # m of lane per target
RATE = 0.3  # false alarms per m² of open ground
GAIN = 2.0  # targets score N(GAIN, 1), false alarms N(0, 1)
GRID = np.linspace(0.002, 0.1, 50)


def coverage(lanes: int, draws: int) -> None:
    """Count how often the intervals hold the truth, which is known in closed form."""
    true_pd = stats.norm.sf(stats.norm.isf(np.minimum(GRID / RATE, 1)) - GAIN)
    true_mean = _true_mean(0.1)
    print(f"coverage in per cent at nominal 95, {lanes} lanes each, {draws} resamplings")
    print("  n    Pd(exact)  FAR(exact)  band  PD_mean")
    for n in (12, 20, 50, 200):
        rng = np.random.default_rng(n)
        lane = Lane(0.0, 4.0, 0.0, SPACING * n)
        held = np.zeros(4)
        for _ in range(lanes):
            alarms, truth = alarms_and_truth(n, rng.poisson(RATE * lane.area), lane.y_max, rng)
            matched = match(alarms, truth, lane)
            seed = int(rng.integers(2**31))
            made = band(matched, None, GRID, draws=draws, seed=seed)
            low, high = pd_mean_interval(matched, draws=draws, seed=seed)
            held += [
                *_exact(alarms, n, lane.area - n * np.pi, threshold=1.0),
                bool(((made["pd_low"] <= true_pd) & (true_pd <= made["pd_high"])).all()),
                low <= true_mean <= high,
            ]
        print(f"  {n:<4} {'      '.join(f'{100 * value / lanes:6.1f}' for value in held)}")
    print(f"  Monte Carlo standard error at 95 per cent: {100 * np.sqrt(0.95 * 0.05 / lanes):.1f}")


def _true_mean(far_max: float) -> float:
    far = (np.arange(100_000) + 0.5) * far_max / 100_000
    return float(stats.norm.sf(stats.norm.isf(far / RATE) - GAIN).mean())


def _exact(alarms: pd.DataFrame, n: int, area: float, threshold: float) -> tuple[bool, bool]:
    """Whether the exact intervals hold at one threshold; the first n rows are the targets' alarms."""
    above = alarms["confidence"].to_numpy() >= threshold
    low, high = clopper_pearson(above[:n].sum(), n)
    far_low, far_high = poisson_interval(above[n:].sum(), area)
    true_pd = stats.norm.sf(threshold - GAIN)
    true_far = RATE * stats.norm.sf(threshold)
    return bool(low <= true_pd <= high), bool(far_low <= true_far <= far_high)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lanes", type=int, default=400)
    parser.add_argument("--draws", type=int, default=200)
    arguments = parser.parse_args()
    coverage(arguments.lanes, arguments.draws)
