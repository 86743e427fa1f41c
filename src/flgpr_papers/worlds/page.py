"""The page of the map of worlds: a section for every part whose tables are in the folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr_papers.kit.page import study_html
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.worlds import AXES, DECLARED, design_worlds
from flgpr_papers.worlds.design import decidable
from flgpr_papers.worlds.detection import CROSSED
from flgpr_papers.worlds.lanes import FAR
from flgpr_papers.worlds.statements import FEWEST, MARKS, STUDY_AXES, TWO_SITES, name_of
from flgpr_papers.worlds.tables import read_table

HOLDS = ("everywhere", "somewhere", "in a corner", "nowhere", "undecided")
"""Where a statement may hold."""


def page_html(folder: Path, pictures: Mapping[str, bytes], quick: bool) -> str:
    """Fill in the page from the tables of a folder and its figures."""
    statements = read_table(folder, "statements")
    counts = read_table(folder, "statements-counts")
    return study_html(
        "worlds.html",
        axes=AXES,
        declared=DECLARED,
        pictures=pictures,
        quick=quick,
        papers=PAPERS,
        far=FAR,
        fewest=FEWEST,
        two_sites=TWO_SITES,
        holds=HOLDS,
        design=design_rows(),
        detection=detection_rows(read_table(folder, "detection-effects")),
        worlds=len(read_table(folder, "detection")),
        ablation=ablation_rows(read_table(folder, "ablation-costs")),
        geometry=geometry_rows(read_table(folder, "geometry-means")),
        counts=counts.to_numpy().tolist(),
        statements={paper: statement_rows(statements, paper) for paper in PAPERS},
        study_axes=STUDY_AXES,
    )


def design_rows() -> list[tuple[str, ...]]:
    """Tabulate what the declared fraction can decide."""
    table = pd.DataFrame([{axis: getattr(world, axis) for axis in AXES} for world in design_worlds()])
    rows = []
    for _, row in decidable(table, AXES, CROSSED).iterrows():
        rows.append((row["term"], str(row["effects"]), f"{row['error']:.2f}", f"{row['inflation']:.2f}"))
    return rows


def detection_rows(effects: pd.DataFrame) -> list[tuple[str, ...]]:
    """Tabulate the levels of every axis: Pd of metal and plastic at both false alarm rates, and plastic in dB."""
    if effects.empty:
        return []
    responses = [f"{kind} {far:g}" for kind in ("metal", "plastic") for far in FAR] + ["plastic ratio_db"]
    rows = []
    for axis, levels in AXES.items():
        for level in levels:
            cells = []
            for response in responses:
                chosen = effects[(effects["response"] == response) & (effects["axis"] == axis)]
                own = chosen[chosen["level"].astype(str) == str(level)]
                cells.append(in_brackets(own.iloc[0]) if len(own) else "")
            rows.append((axis, str(level), *cells))
    return rows


def ablation_rows(costs: pd.DataFrame) -> list[tuple[str, ...]]:
    """Tabulate what every part costs on both roads; an asterisk marks what is clear for all parts together."""
    rows = []
    responses = [f"plastic {far:g}" for far in FAR] + [f"metal {FAR[-1]:g}", "plastic ratio_db"]
    for (road, change), several in costs.groupby(["road", "change"], sort=False) if not costs.empty else []:
        by_response = several.set_index("response")
        cells = []
        for response in responses:
            cost = by_response.loc[response]
            cells.append(in_brackets(cost, "difference") + (" *" if cost["clear"] else ""))
        rows.append((road, change, *cells))
    return rows


def geometry_rows(means: pd.DataFrame) -> list[tuple[str, ...]]:
    """Tabulate Pd of metal and plastic by height and ground used."""
    rows = []
    responses = [f"{kind} {far:g}" for kind in ("metal", "plastic") for far in FAR]
    groups = means.groupby(["height", "nearest", "farthest"], sort=False) if not means.empty else []
    for (height, nearest, farthest), several in groups:
        by_response = several.set_index("response")
        cells = [in_brackets(by_response.loc[response]) for response in responses]
        rows.append((f"{height:g}", f"{nearest:g} to {farthest:g}", *cells))
    return rows


def statement_rows(table: pd.DataFrame, paper: str) -> list[dict[str, Any]]:
    """List the statements of a paper with the verdict of every region."""
    if table.empty:
        return []
    rows = []
    for claim, regions in table[table["paper"] == paper].groupby("statement", sort=False):
        by_region = regions.set_index("region")
        marks = {}
        for axis, levels in STUDY_AXES.items():
            cells = []
            for level in levels:
                name = name_of({axis: level})
                if name in by_region.index:
                    region = by_region.loc[name]
                    enough = region["worlds"] >= FEWEST
                    cells.append(MARKS[region["verdict"]] if enough else "–")
            marks[axis] = " ".join(cells)
        everywhere = by_region.iloc[0]
        rows.append(
            {
                "claim": claim,
                "holds": everywhere["holds"],
                "corners": "" if pd.isna(everywhere["corners"]) else everywhere["corners"],
                "mean": f"{in_brackets(everywhere, 'mean')}, {everywhere['worlds']}",
                "marks": marks,
            }
        )
    return rows


def in_brackets(row: pd.Series, value: str = "value") -> str:
    """Write a value with its interval; without one where it has none."""
    if pd.isna(row[value]):
        return "not measured"
    if not np.isfinite([row["low"], row["high"]]).all():
        return f"{row[value]:z.2f}"
    return f"{row[value]:z.2f} ({row['low']:z.2f} to {row['high']:z.2f})"
