"""What the array's height and the ground that is used give.

Every height over the same lanes, several standoffs each. The world is the prepared site as it is
packaged. A lane is simulated once per height and searched once per stretch of ground ahead of the
array.
"""

from __future__ import annotations

import pandas as pd
from scipy.special import stdtrit

from flgpr.scoring import clopper_pearson
from flgpr.simulate.scene.scene import site_tables
from worlds.ablation import responses
from worlds.lanes import LaneJob, declared_lane, lane_table
from worlds.space import DECLARED

WHERE = ["height", "nearest", "farthest"]
"""Columns that tell geometries apart, m."""


def jobs() -> list[LaneJob]:
    """List the lanes: every height over the same mines in every replicate."""
    declared = DECLARED["geometry"]
    site = site_tables(DECLARED["sites"]["prepared"])
    ground = tuple((float(nearest), float(farthest)) for nearest, farthest in declared["ground"])
    lane_jobs = []
    for replicate in range(declared["replicates"]):
        for height in declared["height"]:
            about = {"height": height, "replicate": replicate}
            name = f"{height:g}m-{replicate}"
            job = declared_lane(
                "geometry", name, about, site, replicate, height=height, ground=ground
            )
            lane_jobs.append(job)
    return lane_jobs


def tables(targets: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return every target, every lane and the means over lanes, as tables by file name.

    Targets and lanes have a row for each stretch of ground.
    """
    lanes = lane_table(targets, [*WHERE, "replicate", "lane"])
    return {"geometry-mines": targets, "geometry": lanes, "geometry-means": means(lanes)}


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
