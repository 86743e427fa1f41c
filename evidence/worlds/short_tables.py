"""The tables of the map that people read: a value with its interval in one cell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from worlds.design import decidable
from worlds.detection import CROSSED
from worlds.lanes import FAR
from worlds.space import AXES, design_worlds
from worlds.tables import read_table


def short_tables(folder: Path) -> dict[str, pd.DataFrame]:
    """Return the tables that people read, by name, a value with its interval in one cell."""
    tables = {"design": design_table()}
    for name, (source, make) in TABLES.items():
        table = read_table(folder, source)
        if not table.empty:
            tables[name] = make(table)
    return tables


def response_name(response: str) -> str:
    """Return a response in words: "plastic 0.07" is Pd of plastic at 0.07 false alarms per m²."""
    kind, measure = response.split(" ")
    if measure == "ratio_db":
        return f"{kind}, signal to clutter, dB"
    return f"Pd of {kind} at {measure} per m²"


def design_table() -> pd.DataFrame:
    """Tabulate what the declared fraction can decide."""
    worlds = design_worlds()
    levels = {}
    for axis in AXES:
        levels[axis] = [getattr(world, axis) for world in worlds]
    table = pd.DataFrame(levels)
    names = {"term": "effect", "effects": "degrees of freedom", "error": "error of a difference"}
    return decidable(table, AXES, CROSSED).round(2).rename(columns=names)


def detection_table(effects: pd.DataFrame) -> pd.DataFrame:
    """Tabulate Pd of metal and plastic, and plastic in dB, by the levels of every axis."""
    responses = [f"{kind} {far:g}" for kind in ("metal", "plastic") for far in FAR]
    responses.append("plastic ratio_db")
    rows = []
    for axis, levels in AXES.items():
        for level in levels:
            row = {"axis": axis, "level": str(level)}
            for response in responses:
                chosen = effects[(effects["response"] == response) & (effects["axis"] == axis)]
                rows_of_level = chosen[chosen["level"].astype(str) == str(level)]
                cell = in_brackets(rows_of_level.iloc[0]) if len(rows_of_level) else "–"
                row[response_name(response)] = cell
            rows.append(row)
    return pd.DataFrame(rows)


def missing_table(missing: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the decibels that plastic mines miss of the paper's Pd, by FAR and roughness."""
    rows = []
    for (far, paper, roughness), cells in missing.groupby(["far", "paper", "roughness"]):
        row = {
            "false alarms per m²": f"{far:g}",
            "paper's Pd": f"{paper:g}",
            "roughness, mm": f"{roughness:g}",
        }
        for _, cell in cells.iterrows():
            title = f"ε' = {cell['permittivity']:g}"
            row[title] = f"{cell['missing_db']:+.1f} (found {cell['found']:.2f})"
        rows.append(row)
    return pd.DataFrame(rows).fillna("–")


def ablation_table(costs: pd.DataFrame) -> pd.DataFrame:
    """Tabulate what every part costs on both roads.

    An asterisk marks what is clear for all parts together.
    """
    responses = [f"plastic {far:g}" for far in FAR] + [f"metal {FAR[-1]:g}", "plastic ratio_db"]
    rows = []
    for (road, change), several in costs.groupby(["road", "change"], sort=False):
        by_response = _by_response(several)
        row = {"road": road, "change": change}
        for response in responses:
            cost = by_response[response]
            mark = " *" if cost["clear"] else ""
            row[response_name(response)] = in_brackets(cost, "difference") + mark
        rows.append(row)
    return pd.DataFrame(rows)


def _by_response(table: pd.DataFrame) -> dict[str, pd.Series]:
    """Return the rows of a table by their response."""
    return {str(row["response"]): row for _, row in table.iterrows()}


def geometry_table(means: pd.DataFrame) -> pd.DataFrame:
    """Tabulate Pd of metal and plastic by height and ground used."""
    responses = [f"{kind} {far:g}" for kind in ("metal", "plastic") for far in FAR]
    rows = []
    for (height, nearest, farthest), several in means.groupby(
        ["height", "nearest", "farthest"], sort=False
    ):
        by_response = _by_response(several)
        row = {"height, m": f"{height:g}", "ground used, m": f"{nearest:g} to {farthest:g}"}
        for response in responses:
            row[response_name(response)] = in_brackets(by_response[response])
        rows.append(row)
    return pd.DataFrame(rows)


def in_brackets(row: pd.Series, value: str = "value") -> str:
    """Write a value with its interval; without one where it has none."""
    if pd.isna(row[value]):
        return "not measured"
    if not np.isfinite([row["low"], row["high"]]).all():
        return f"{row[value]:z.2f}"
    return f"{row[value]:z.2f} ({row['low']:z.2f} to {row['high']:z.2f})"


TABLES: dict[str, tuple[str, Callable[[pd.DataFrame], pd.DataFrame]]] = {
    "detection-short": ("detection-effects", detection_table),
    "detection-missing-short": ("detection-missing", missing_table),
    "ablation-short": ("ablation-costs", ablation_table),
    "geometry-short": ("geometry-means", geometry_table),
}
"""The table that a short one is of, and what makes it, by the short one's name."""
