"""The page of the study.

The paper's figures and statements beside what the simulated lanes give.
"""

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
    """Write the page, which needs nothing beside it."""
    detectors: dict[str, dict[str, Any]] = {}
    for world, lanes in cases.items():
        detectors[world] = {}
        for site in lanes:
            detectors[world][recipe.sites[site].title] = _detector_rows(tables[world], site)
    return study_html(
        "cosgrove2004.html",
        quick=quick,
        study_world=study_world,
        other=other,
        recipe=recipe,
        found=found,
        by_chance={world: by_chance(all_) for world, all_ in found.items()},
        sizes=next(iter(cases.values())),
        detectors=detectors,
        contrast={world: _contrast_rows(recipe, lanes) for world, lanes in cases.items()},
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
    return [
        (
            recipe.sites[row["site"]].title,
            f"{100 * row['depth']:.0f} cm",
            row["looks"],
            f"{row['contrast']:.1f} dB",
        )
        for row in contrast_table(lanes).to_dict("records")
    ]
