"""What the array's height and the ground that is used give.

Every height over the same lanes, several standoffs each. The world is the prepared site as it is
packaged. A lane is simulated once per height and searched once per stretch of ground ahead of the
array.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from scipy.special import stdtrit

from flgpr.jobs.workers import Executor
from flgpr.progress import Track, silent
from flgpr.scoring import clopper_pearson
from flgpr.simulate.scene.scene import site_tables
from flgpr_papers.kit.worlds import DECLARED
from flgpr_papers.worlds.ablation import responses
from flgpr_papers.worlds.lanes import LaneJob, lane_table, read_targets, run_jobs
from flgpr_papers.worlds.tables import write_rounded_table

WHERE = ["height", "nearest", "farthest"]
"""Columns that tell geometries apart, m."""


def jobs(quick: bool = False) -> list[LaneJob]:
    """List the lanes: every height over the same mines in every replicate."""
    declared = DECLARED["geometry"]
    if quick:
        declared = declared | DECLARED["quick"]
    tables = site_tables(DECLARED["sites"]["prepared"])
    ground = tuple((float(nearest), float(farthest)) for nearest, farthest in declared["ground"])
    lane_jobs = []
    for replicate in range(declared["replicates"]):
        for height in declared["height"]:
            about = {"height": height, "replicate": replicate}
            name = f"{height:g}m-{replicate}"
            seed = declared["seed"] + replicate
            length = float(declared["length"])
            count = declared["count"]
            lane_jobs.append(
                LaneJob(
                    "geometry",
                    name,
                    about,
                    tables,
                    declared["mines"],
                    length,
                    count,
                    seed,
                    height,
                    ground,
                    ratios=True,
                )
            )
    return lane_jobs


def run(folder: Path, executor: Executor, quick: bool = False, track: Track = silent) -> None:
    """Run the lanes that are not on disk and write the tables of all that are there.

    ``geometry-mines.csv`` has every target and stretch of ground, ``geometry.csv`` every lane and
    stretch, ``geometry-means.csv`` the means over lanes.
    """
    lanes = jobs(quick)
    run_jobs(folder, lanes, executor, track)
    targets = read_targets(folder, lanes)
    if targets.empty:
        return
    table = lane_table(targets, [*WHERE, "replicate", "lane"])
    write_rounded_table(folder / "geometry-mines.csv", targets)
    write_rounded_table(folder / "geometry.csv", table)
    write_rounded_table(folder / "geometry-means.csv", means(table))


def means(table: pd.DataFrame) -> pd.DataFrame:
    """Average every response over the lanes of a geometry.

    Parameters
    ----------
    table : DataFrame
        ``geometry.csv``: a row per lane and stretch of ground.

    Returns
    -------
    DataFrame
        ``height``, ``nearest``, ``farthest`` (m), ``response`` (as of ``detection-effects.csv``),
        ``lanes``, ``value`` and its 95 % interval, ``low`` and ``high`` (empty for one lane). It is
        Student's over lanes. That of a Pd is no narrower than the exact one of all its targets, as
        few lanes that happen to agree would make it, and ends at 0 and 1.
    """
    rows = []
    for where, lanes in table.groupby(WHERE, sort=False):
        for response, values in responses(lanes).items():
            count = len(values)
            value = float(values.mean())
            half = float("nan")
            if count > 1:
                half = float(stdtrit(count - 1, 0.975) * values.std(ddof=1) / count**0.5)
            low = value - half
            high = value + half
            if count > 1 and not response.endswith("ratio_db"):
                kind = response.split()[0]
                totals = lanes[response.replace(" ", "_")].sum()
                exact_low, exact_high = clopper_pearson(totals, lanes[f"{kind}_targets"].sum())
                low = max(min(low, float(exact_low)), 0.0)
                high = min(max(high, float(exact_high)), 1.0)
            row = dict(zip(WHERE, where, strict=True))
            row |= {"response": response, "lanes": count, "value": value, "low": low, "high": high}
            rows.append(row)
    return pd.DataFrame(rows)
