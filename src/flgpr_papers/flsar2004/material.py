"""What the experiments of flsar2004 work on, and the results that each of them adds to."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr_papers.flsar2004.examples import Site, make_templates, open_examples
from flgpr_papers.flsar2004.findings import Measure, auc_interval
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.machines import HeldOut
from flgpr_papers.kit.findings import (
    SHARE,
    SHARE_DIFFERENCE,
    UNDECIDED,
    Finding,
    Interval,
    clip,
    in_words,
    judge,
    measured,
)
from flgpr_papers.kit.settings import packaged_text

FloatArray = NDArray[np.float64]
Examples = tuple[pd.DataFrame, FloatArray]
"""Table of the examples, and their features (example, feature)."""
SHALLOW = 0.06
"""Depth down to which the paper's first three depths lie, m, with their scatter."""
SURFACE = -0.05
"""Depth above which a mine lies on the surface, m."""
_STATEMENTS = tomllib.loads(packaged_text("flsar2004", "statements"))


@dataclass
class Results:
    """Results of a part of the experiment, or of all of them."""

    #: ROC by figure and label
    curves: dict[str, dict[str, pd.DataFrame]] = field(default_factory=dict)
    #: areas under whole ROCs with their intervals
    areas: dict[str, Interval] = field(default_factory=dict)
    #: areas up to 0.07 false alarms per m² over that, with their intervals
    partial: dict[str, Interval] = field(default_factory=dict)
    #: partial areas of scores that know nothing
    chance: dict[str, float] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    #: further numbers that the page shows, as JSON can hold them
    details: dict[str, Any] = field(default_factory=dict)

    def judge(self, statement: str, interval: Interval, **fields: Any) -> None:
        """Judge a statement of ``statements.toml`` by the interval of its number.

        Parameters
        ----------
        statement : str
            Its name in the file.
        interval : Interval
            The number and its interval.
        **fields
            What stands for the fields of the claim.
        """
        declared = _STATEMENTS[statement]
        rule = tuple(declared["rule"]) if "rule" in declared else None
        bounds = {"share": SHARE, "difference": SHARE_DIFFERENCE}.get(declared.get("is", ""))
        finding = measured(
            declared["claim"].format(**fields),
            declared["paper"],
            declared["quantity"],
            interval,
            rule,
            bounds=bounds,
        )
        self.findings.append(finding)

    def judge_all(self, statement: str, intervals: dict[str, Interval], **fields: Any) -> None:
        """Judge a statement that must not depend on a choice of ours, by every choice.

        Where the choices are not of one verdict, it cannot be said.

        Parameters
        ----------
        statement : str
            Its name in the file.
        intervals : dict of Interval
            The number and its interval by choice.
        **fields
            What stands for the fields of the claim.
        """
        declared = _STATEMENTS[statement]
        rule: tuple[float, float] = (declared["rule"][0], declared["rule"][1])
        bounds = SHARE if declared["is"] == "share" else SHARE_DIFFERENCE
        cut = {name: clip(interval, bounds) for name, interval in intervals.items()}
        verdicts = {judge(low, high, rule) for _, low, high in cut.values()}
        texts = [f"{name}: {in_words(*interval)}" for name, interval in cut.items()]
        finding = Finding(
            claim=declared["claim"].format(**fields),
            paper=declared["paper"],
            ours="; ".join(texts),
            verdict=verdicts.pop() if len(verdicts) == 1 else UNDECIDED,
            note="every formulation must give the same verdict",
            quantity=declared["quantity"],
            interval=next(iter(cut.values())),
            rule=rule,
            parts=tuple(value for value, _, _ in cut.values()),
            bounds=bounds,
        )
        self.findings.append(finding)

    def add_areas(self, name: str, scores: HeldOut, searched: float, count: int) -> None:
        """Add both areas under a ROC, and the partial one that chance gives.

        Parameters
        ----------
        name : str
            Name of the curve.
        scores : HeldOut
            Scores of held-out examples.
        searched : float
            Area that was searched, m².
        count : int
            Number of bootstrap draws.
        """
        measure = Measure(searched)
        self.areas[name] = auc_interval(scores, count)
        self.partial[name] = measure.interval(scores, count)
        self.chance[name] = measure.chance(scores)

    def add(self, other: Results) -> None:
        """Add the results of another part."""
        self.curves |= other.curves
        self.areas |= other.areas
        self.partial |= other.partial
        self.chance |= other.chance
        self.findings += other.findings
        self.details |= other.details


@dataclass(frozen=True)
class Material:
    """What all parts work on."""

    settings: Settings
    sites: list[Site]  #: both sites
    templates: list[NDArray[Any]]  #: templates of each
    examples: list[Examples]  #: examples without prescreener of each


def prepare(settings: Settings, sites: list[Site]) -> Material:
    """Make the templates and the examples without prescreener of both sites."""
    templates = []
    examples = []
    for site in sites:
        site_templates = make_templates(settings, site)
        templates.append(site_templates)
        examples.append(open_examples(settings, site, site_templates))
    return Material(settings, sites, templates, examples)


def pick_examples(
    examples: Examples,
    kinds: tuple[str, ...],
    depth: tuple[float, float] = (-1.0, 1.0),
    columns: str = "both",
) -> Examples:
    """Return the examples of some kinds of mines between two depths, and all clutter.

    Parameters
    ----------
    examples : Examples
        Examples of a site.
    kinds : tuple of str
        Kinds of mines.
    depth : tuple of float
        Least and largest depth of the mines, m.
    columns : str
        Polarization of the features: "HH", "VV" or "both".
    """
    table, X = examples
    is_mine = table["kind"].isin(kinds) & table["depth"].between(*depth)
    rows = np.flatnonzero(is_mine | (table["kind"] == "clutter"))
    half = X.shape[1] // 2
    halves = {"both": slice(None), "HH": slice(0, half), "VV": slice(half, None)}
    return table.iloc[rows].reset_index(drop=True), X[rows][:, halves[columns]]


def open_area(examples: Examples, settings: Settings) -> float:
    """Return the area of the clutter tiles, m²: what was searched beside the mines."""
    count = int((examples[0]["kind"] == "clutter").sum())
    return count * settings.features.region[0] * settings.features.region[1]


def thin_examples(examples: Examples, most: tuple[int, int], seed: int) -> Examples:
    """Draw as many mines and clutter examples as the paper had, or as there are.

    Parameters
    ----------
    examples : Examples
        Examples of a site.
    most : tuple of int
        Number of mines and of clutter examples.
    seed : int
        Seed of the draw.
    """
    table, X = examples
    rng = np.random.default_rng(seed)
    mines = np.flatnonzero(table["kind"] != "clutter")
    clutter = np.flatnonzero(table["kind"] == "clutter")
    drawn_mines = rng.choice(mines, min(most[0], len(mines)), False)
    drawn_clutter = rng.choice(clutter, min(most[1], len(clutter)), False)
    rows = np.sort(np.concatenate([drawn_mines, drawn_clutter]))
    return table.iloc[rows].reset_index(drop=True), X[rows]
