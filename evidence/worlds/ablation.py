"""What each part of a road costs, one at a time on the same mines: stones, holes, waves and more.

The smooth road is the prepared site with nothing in its
soil, no growth and nothing beside it. Each part of the natural site is added to it, and taken from
the natural road. All roads have the soil of the prepared site.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from flgpr.simulate.scene.scene import Soil, site_tables
from worlds.effects import block_differences
from worlds.lanes import FAR, KINDS, LaneJob, declared_lane, lane_table
from worlds.space import DECLARED, in_soil_of, on_soil_of

PARTS: dict[str, list[str]] = DECLARED["ablation"]["parts"]
"""Entries of a scene that belong to each part."""
NOTHING = "nothing"
"""The change of a road to which nothing was added and from which nothing was taken."""
ROADS = {"smooth": "added", "natural": "taken away"}
"""The two roads, and what is done with a part on each."""
Tables = dict[str, dict[str, Any]]


def smooth_road() -> Tables:
    """Return the tables of the smooth prepared road."""
    tables = site_tables(DECLARED["sites"]["prepared"])
    tables |= in_soil_of("nothing", 1.0)
    tables["clutter"] |= on_soil_of("nothing") | {"bushes": 0.0, "posts": 0.0}
    tables["grass"] = {"on": False}
    return tables


def natural_road() -> Tables:
    """Return the tables of the natural road, which has the soil of the prepared site."""
    tables = site_tables(DECLARED["sites"]["natural"])
    tables["soil"] = dict(site_tables(DECLARED["sites"]["prepared"])["soil"])
    permittivity = float(Soil(**tables["soil"]).media([1e9])[-1][0].real)
    return tables | in_soil_of("natural", permittivity)


def replaced(road: Tables, other: Tables, parts: Iterable[str]) -> Tables:
    """Return a road on which some parts are as on another road."""
    tables = {name: dict(table) for name, table in road.items()}
    for table_name in parts:
        for entry in PARTS[table_name]:
            table, _, name = entry.partition(".")
            if not name:
                tables[table] = dict(other.get(table, {}))
                continue
            tables.setdefault(table, {}).pop(name, None)
            if name in other.get(table, {}):
                tables[table][name] = other[table][name]
    return tables


def jobs() -> list[LaneJob]:
    """List the lanes: both roads as they are and with every part changed, in every replicate.

    All lanes of a replicate have the same mines.
    """
    smooth = smooth_road()
    natural = natural_road()
    lane_jobs = []
    for replicate in range(DECLARED["ablation"]["replicates"]):
        for road in ROADS:
            tables_of_road, other = (smooth, natural) if road == "smooth" else (natural, smooth)
            for change in (NOTHING, *PARTS):
                site = tables_of_road
                if change != NOTHING:
                    site = replaced(tables_of_road, other, [change])
                name = f"{road}-{change.replace(' ', '-')}-{replicate}"
                about = {"road": road, "change": change, "replicate": replicate}
                lane_jobs.append(declared_lane("ablation", name, about, site, replicate))
    return lane_jobs


def tables(targets: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return every target, every lane, and what every part costs, as tables by file name."""
    lanes = lane_table(targets, ["road", "change", "replicate", "lane"])
    mines = targets.drop(columns=["nearest", "farthest"])
    return {"ablation-mines": mines, "ablation": lanes, "ablation-costs": costs(lanes)}


def responses(table: pd.DataFrame) -> dict[str, pd.Series]:
    """Return what is compared between lanes, by name: Pd of each kind at each FAR, and its echo.

    The echo is the mean signal to clutter, dB.

    Parameters
    ----------
    table : DataFrame
        ``ablation.csv``: a row per lane.
    """
    columns: dict[str, pd.Series] = {}
    for kind in KINDS:
        for far in FAR:
            columns[f"{kind} {far:g}"] = table[f"{kind}_{far:g}"] / table[f"{kind}_targets"]
        columns[f"{kind} ratio_db"] = table[f"{kind}_ratio_db"]
    return columns


def costs(table: pd.DataFrame) -> pd.DataFrame:
    """Compare every changed road with the road as it is, replicate by replicate.

    Parameters
    ----------
    table : DataFrame
        ``ablation.csv``: a row per lane.

    Returns
    -------
    DataFrame
        ``road``, ``response`` (as of ``detection-effects.csv``), ``unchanged``, its mean on the
        road as it is, and the columns of :func:`~worlds.effects.block_differences`;
        ``replicates``, how many lanes of every road there are. Replicates of which a lane is not
        there yet are left out.
    """
    rows = []
    for road in ROADS:
        lanes = table[table["road"] == road]
        for response, values in responses(lanes).items():
            wide = pd.DataFrame(
                {"change": lanes["change"], "replicate": lanes["replicate"], "value": values}
            ).pivot_table(
                index="replicate", columns="change", values="value", sort=False, dropna=False
            )
            wide = wide.dropna() if NOTHING in wide else wide.iloc[:0]
            if wide.empty or wide.shape[1] < 2:
                continue
            differences = block_differences(wide, NOTHING)
            differences.insert(0, "unchanged", float(np.mean(wide[NOTHING])))
            differences.insert(0, "response", response)
            differences.insert(0, "road", road)
            rows.append(differences.assign(replicates=len(wide)))
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()
