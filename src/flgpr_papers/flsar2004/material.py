"""What the experiments of flsar2004 work on, and the results that each of them adds to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr_papers.flsar2004.examples import Site, make_templates, open_examples
from flgpr_papers.flsar2004.findings import Measure, auc_interval, roc
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.machines import Examples, HeldOut
from flgpr_papers.kit.findings import Finding, finding_of
from flgpr_papers.kit.intervals import Interval
from flgpr_papers.kit.statements import Statements

SHALLOW = 0.06
"""Depth down to which the paper's first three depths lie, m, with their scatter."""
SURFACE = -0.05
"""Depth above which a mine lies on the surface, m."""
_STATEMENTS = Statements("flsar2004")


@dataclass
class Results:
    """Results of a part of the experiment, or of all of them, as JSON can hold them."""

    findings: list[Finding] = field(default_factory=list)
    #: areas under whole ROCs with their intervals
    areas: dict[str, Interval] = field(default_factory=dict)
    #: areas up to 0.07 false alarms per m² over that, with their intervals
    partial: dict[str, Interval] = field(default_factory=dict)
    #: partial areas of scores that know nothing
    chance: dict[str, float] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)  #: further numbers that the page shows
    #: columns of each ROC by figure and label
    curves: dict[str, dict[str, dict[Any, Any]]] = field(default_factory=dict)

    def judge(self, statement: str, interval: Interval, **fields: Any) -> None:
        """Judge a statement of ``statements.toml`` by the interval of its number."""
        self.findings.append(_STATEMENTS.number(statement, interval, **fields))

    def judge_all(self, statement: str, intervals: dict[str, Interval], **fields: Any) -> None:
        """Judge a statement that must not depend on a choice of ours, by every choice."""
        self.findings.append(_STATEMENTS.by_every(statement, intervals, **fields))

    def add_curve(
        self, figure: str, label: str, scores: HeldOut, area: float, targets: int | None = None
    ) -> None:
        """Add a ROC to a figure; the parameters are those of :func:`.findings.roc`."""
        curve = roc(scores, area, targets)
        self.curves.setdefault(figure, {})[label] = curve.to_dict("list")

    def add_areas(self, name: str, scores: HeldOut, measure: Measure, count: int) -> None:
        """Add both areas under a ROC, and the partial one that chance gives.

        Parameters
        ----------
        name : str
            Name of the curve.
        scores : HeldOut
            Scores of held-out examples.
        measure : Measure
            The partial area.
        count : int
            Number of bootstrap draws.
        """
        self.areas[name] = auc_interval(scores, count)
        self.partial[name] = measure.interval(scores, count)
        self.chance[name] = measure.chance(scores)

    def add(self, record: dict[str, Any]) -> None:
        """Add the results of another part, as read from JSON."""
        self.findings += [finding_of(row) for row in record["findings"]]
        for name in ("areas", "partial", "chance", "notes", "curves"):
            getattr(self, name).update(record[name])


@dataclass(frozen=True)
class Material:
    """What all parts work on."""

    settings: Settings
    sites: list[Site]  #: both sites
    templates: list[NDArray[Any]]  #: templates of each
    examples: list[Examples]  #: examples without prescreener of each

    @property
    def draws(self) -> int:
        """Number of bootstrap draws."""
        return self.settings.classify.bootstrap

    def measure(self, examples: Examples) -> Measure:
        """Return the partial area under the ROC of examples without prescreener."""
        return Measure(open_area(examples, self.settings))


def prepare(settings: Settings, sites: list[Site]) -> Material:
    """Make the templates and the examples without prescreener of both sites."""
    templates = [make_templates(settings, site) for site in sites]
    examples = []
    for site, site_templates in zip(sites, templates, strict=True):
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
    return _rows_of(examples, rows)[0], X[rows][:, halves[columns]]


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
    is_clutter = (examples[0]["kind"] == "clutter").to_numpy()
    rng = np.random.default_rng(seed)
    drawn = []
    for is_kind, count in zip((~is_clutter, is_clutter), most, strict=True):
        rows = np.flatnonzero(is_kind)
        drawn.append(rng.choice(rows, min(count, len(rows)), False))
    return _rows_of(examples, np.sort(np.concatenate(drawn)))


def _rows_of(examples: Examples, rows: NDArray[Any]) -> Examples:
    """Return some of the examples."""
    table, X = examples
    return pd.DataFrame(table.iloc[rows]).reset_index(drop=True), X[rows]
