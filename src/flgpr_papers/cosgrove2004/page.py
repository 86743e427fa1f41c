"""The page of the study: the paper's figures and statements beside what the simulated lanes give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from flgpr_papers.cosgrove2004.findings import PAPER_RATIOS, Case, contrast_table, interval
from flgpr_papers.cosgrove2004.images import WORLDS, PointResponse
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import Finding, by_chance
from flgpr_papers.kit.page import study_html

Row = tuple[Any, ...]


def page_html(
    recipe: StudyRecipe,
    cases: Mapping[str, Mapping[str, Sequence[Case]]],
    tables: Mapping[str, pd.DataFrame],
    found: Mapping[str, Sequence[Finding]],
    responses: Mapping[str, PointResponse],
    pictures: Mapping[str, bytes],
    quick: bool,
) -> str:
    """Write the page, which needs nothing beside it."""
    return study_html(
        "cosgrove2004.html",
        quick=quick,
        recipe=recipe,
        found=found,
        by_chance={world: by_chance(all_) for world, all_ in found.items()},
        sizes=next(iter(cases.values())),
        detectors={
            world: {recipe.sites[site].title: _detector_rows(tables[world], site) for site in lanes}
            for world, lanes in cases.items()
        },
        contrast={world: _contrast_rows(recipe, lanes) for world, lanes in cases.items()},
        ratios={world: _ratio_rows(lanes["sand"]) for world, lanes in cases.items()},
        resolution=_resolution_rows(responses),
        pictures=[(*_named(name), picture) for name, picture in pictures.items()],
    )


def _named(name: str) -> tuple[str, str]:
    """Take the name of a picture apart: the figure, and the world if it shows one of them."""
    world = next((one for one in WORLDS if name.endswith(one)), "")
    return name.removesuffix(f"-{world}"), world


def _detector_rows(table: pd.DataFrame, site: str) -> list[list[str]]:
    part = table[table["site"] == site]
    rows = []
    for name in dict.fromkeys(part["detector"]):
        chosen = part[part["detector"] == name]
        row = [str(name)]
        for column in ("pd", "pd_quantile", "pd_rockless", "pd_mean"):
            mean, low, high = interval(chosen[column].to_numpy(), bounds=(0.0, 1.0))
            row.append(f"{mean:.2f} ({low:.2f} to {high:.2f})")
        rows.append(row)
    return rows


def _contrast_rows(recipe: StudyRecipe, lanes: Mapping[str, Sequence[Case]]) -> list[Row]:
    return [
        (recipe.sites[row["site"]].title, f"{100 * row['depth']:.0f} cm", row["looks"], f"{row['contrast']:.1f} dB")
        for row in contrast_table(lanes).to_dict("records")
    ]


def _ratio_rows(lanes: Sequence[Case]) -> list[Row]:
    ratios = np.array([case["ratios"] for case in lanes])
    rows = []
    for j, paper in enumerate(PAPER_RATIOS[: ratios.shape[1]]):
        ours = interval(ratios[:, j], bounds=(0.0, 1.0))
        rows.append((j + 1, f"{paper:g}", *_ratio_in_words(*ours)))
    return rows


def _ratio_in_words(mean: float, low: float, high: float) -> tuple[str, str]:
    if np.isnan(mean):
        return "no example reaches it", ""
    return f"{mean:.3f}", f"{low:.3f} to {high:.3f}"


def _resolution_rows(responses: Mapping[str, PointResponse]) -> list[Row]:
    rows: list[Row] = [(name, *(f"{100 * w:.1f} cm" for w in one.resolution)) for name, one in responses.items()]
    return [*rows, ("paper", "about 10 cm", "about 40 cm")]
