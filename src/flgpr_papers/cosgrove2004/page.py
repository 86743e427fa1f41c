"""What the page of the study says beside findings and figures: facts, numbers and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from flgpr_papers.cosgrove2004.findings import (
    PAPER_PD,
    Case,
    contrast_table,
    eigenvalue_ratios_of,
)
from flgpr_papers.cosgrove2004.images import PointResponse, study_sensor
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import Finding, by_chance
from flgpr_papers.kit.intervals import SHARE, Interval, students
from flgpr_papers.kit.page import Rows

Cases = Mapping[str, Mapping[str, Sequence[Case]]]
"""Cases of every seed by surroundings and site."""
BESIDE = {"open": "open lanes", "roadside": "beside bushes and posts"}
"""What stands beside a lane, in words."""
_PAPER_PD = {
    "sand": f"best, {PAPER_PD:g} by deflection in the best soil; PWF and HH below",
    "gravel": "PWF and HH below deflection",
    "clay": "worst; PWF and HH below deflection",
}
_PAPER_RESOLUTION = {"down-range": "about 10 cm", "cross-range": "about 40 cm"}


def page_facts(recipe: StudyRecipe) -> dict[str, Any]:
    """Return what the captions and their numbers take."""
    sensor = study_sensor(recipe)
    tx, _ = sensor.pairs()
    tones = sensor.tones.axis()
    length = recipe.cut.length
    polarizations = recipe.cut.polarizations
    return {
        "recipe": recipe,
        "sensor": sensor,
        "antennas": len(tx),
        "across": np.ptp(tx[:, 0]),
        "tones": (tones[0] / 1e9, tones[-1] / 1e9),
        "samples": ", then ".join(f"{length} of {name}" for name in polarizations),
        "features": length * len(polarizations),
    }


def page_tables(
    recipe: StudyRecipe,
    cases: Cases,
    tables: Mapping[str, pd.DataFrame],
    found: Sequence[Finding],
) -> dict[str, Any]:
    """Return what the template of the page takes.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping
        Cases of every seed by surroundings and site.
    tables : mapping of str to DataFrame
        Pd of every detector by surroundings.
    found : sequence of Finding
        The findings, with the surroundings for a group.
    """
    return {
        "recipe": recipe,
        "by_chance": {name: by_chance([f for f in found if f.group == name]) for name in BESIDE},
        "sizes": next(iter(cases.values())),
        "detectors": {name: _detector_table(table) for name, table in tables.items()},
        "contrast": {name: contrast_table(lanes) for name, lanes in cases.items()},
        "beside": BESIDE,
    }


def _detector_table(table: pd.DataFrame) -> dict[str, dict[str, list[Interval]]]:
    """Return the detectors' Pd by site and detector, in the order of the columns."""
    # Those of the sweeps over examples stand in their figure.
    shown = table[~table["detector"].str.endswith("examples")]
    detectors: dict[str, dict[str, list[Interval]]] = {}
    for (site, name), chosen in shown.groupby(["site", "detector"], sort=False):
        columns = chosen[["pd", "pd_quantile", "pd_rockless", "pd_mean"]].to_numpy().T
        intervals = [students(column, bounds=SHARE) for column in columns]
        detectors.setdefault(site, {})[name] = intervals
    return detectors


def figure_rows(
    recipe: StudyRecipe,
    cases: Cases,
    tables: Mapping[str, pd.DataFrame],
    responses: Mapping[str, PointResponse],
) -> dict[str, Rows]:
    """Return numbers of the paper beside ours by the name of the figure.

    The parameters are those of :func:`page_tables`, and the image of a point with and without the
    ramp filter.
    """
    rows: dict[str, Rows] = {}
    for surroundings in BESIDE:
        rows[f"figure-6-{surroundings}"] = ratio_rows(cases[surroundings]["sand"])
        rows[f"figure-7-{surroundings}"] = _pd_rows(recipe, tables[surroundings])
    resolution = []
    for axis, (name, paper) in enumerate(_PAPER_RESOLUTION.items()):
        for filtered, response in responses.items():
            width = f"{100 * response.resolution[axis]:.1f} cm"
            resolution.append((f"{name}, {filtered}", paper, width))
    return rows | {"resolution": resolution}


def ratio_rows(lanes: Sequence[Case]) -> Rows:
    """Tabulate the ratios of eigenvalues, mean over the seeds with the interval."""
    rows = []
    for number, paper, (ratio, low, high) in eigenvalue_ratios_of(lanes):
        ours = f"{ratio:.3f} ({low:.3f} to {high:.3f})"
        if np.isnan(ratio):
            ours = "no example reaches it"
        rows.append((f"σ{number}/σ1", f"{paper:g}", ours))
    return rows


def _pd_rows(recipe: StudyRecipe, table: pd.DataFrame) -> Rows:
    """Tabulate Pd at the study's P_FA, mean over the seeds, by soil."""
    names = {"deflection": recipe.main, "PWF": "PWF", "HH": "HH"}
    rows = []
    for soil, title in recipe.soils.items():
        means = table[table["site"] == soil].groupby("detector")["pd"].mean()
        ours = ", ".join(f"{name} {means[detector]:.2f}" for name, detector in names.items())
        rows.append((f"{title}, Pd at {recipe.score.pfa:g} per m²", _PAPER_PD[soil], ours))
    return rows
