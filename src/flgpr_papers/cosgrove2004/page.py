"""The page of the study: the paper's figures and statements, and what the simulated lanes give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from flgpr_papers.cosgrove2004.findings import Case, contrast_table, interval
from flgpr_papers.cosgrove2004.images import PointResponse
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.cosgrove2004.twins import BESIDE, own_twins, paper_twins
from flgpr_papers.kit.findings import Finding, by_chance
from flgpr_papers.kit.page import study_html
from flgpr_papers.kit.study_worlds import OtherWorld, StudyWorld

Row = tuple[Any, ...]


def page_html(
    recipe: StudyRecipe,
    cases: Mapping[str, Mapping[str, Sequence[Case]]],
    tables: Mapping[str, pd.DataFrame],
    found: Mapping[str, Sequence[Finding]],
    responses: Mapping[str, PointResponse],
    pictures: Mapping[str, bytes],
    quick: bool,
    study_world: StudyWorld,
    other: OtherWorld,
) -> str:
    """Return the page, which needs no other file.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping
        Cases of every seed by surroundings and site.
    tables : mapping of str to DataFrame
        Pd of every detector by surroundings.
    found : mapping of str to sequence of Finding
        Findings by surroundings.
    responses : mapping of str to PointResponse
        Image of a point with and without the ramp filter.
    pictures : mapping of str to bytes
        Figures by name, PNG.
    quick : bool
        Whether the study is a quick run.
    study_world : StudyWorld
        World of the lanes.
    other : OtherWorld
        Findings of the same study on roads as found.
    """
    detectors: dict[str, dict[str, Any]] = {}
    chance_counts = {}
    contrast = {}
    for surroundings, lanes in cases.items():
        detectors[surroundings] = {}
        for site in lanes:
            title = recipe.sites[site].title
            detectors[surroundings][title] = _detector_rows(tables[surroundings], site)
        chance_counts[surroundings] = by_chance(found[surroundings])
        contrast[surroundings] = _contrast_rows(recipe, lanes)
    return study_html(
        "cosgrove2004.html",
        quick=quick,
        study_world=study_world,
        other=other,
        recipe=recipe,
        found=found,
        by_chance=chance_counts,
        sizes=next(iter(cases.values())),
        detectors=detectors,
        contrast=contrast,
        beside=BESIDE,
        twins=list(paper_twins(recipe, cases, tables, found, pictures)),
        others=list(own_twins(responses, pictures)),
    )


def _detector_rows(table: pd.DataFrame, site: str) -> list[list[str]]:
    """Tabulate the detectors' Pd at a site."""
    rows_of_site = table[table["site"] == site]
    rows = []
    for name in dict.fromkeys(rows_of_site["detector"]):
        chosen = rows_of_site[rows_of_site["detector"] == name]
        row = [str(name)]
        for column in ("pd", "pd_quantile", "pd_rockless", "pd_mean"):
            mean, low, high = interval(chosen[column].to_numpy(), bounds=(0.0, 1.0))
            row.append(f"{mean:.2f} ({low:.2f} to {high:.2f})")
        rows.append(row)
    return rows


def _contrast_rows(recipe: StudyRecipe, lanes: Mapping[str, Sequence[Case]]) -> list[Row]:
    """Tabulate the contrast of mines and clutter by site and depth."""
    rows: list[Row] = []
    for row in contrast_table(lanes).to_dict("records"):
        title = recipe.sites[row["site"]].title
        depth = f"{100 * row['depth']:.0f} cm"
        rows.append((title, depth, row["looks"], f"{row['contrast']:.1f} dB"))
    return rows
