"""The verdict of a trial: signed lists against the truth at the registered false alarm rate, in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flgpr.scoring import (
    Match,
    Rules,
    chance,
    clopper_pearson,
    operating_row,
    pd_table,
    side_by_side,
)
from flgpr.scoring.lane_score import curve_by
from flgpr.types import floats
from flgpr_trials.folder import Requirement

GROUPS = ("kind", "depth", "lane")
"""Columns of the truth by which Pd is broken down."""


@dataclass(frozen=True)
class Verdict:
    """Signed lists against the truth of a trial."""

    requirement: Requirement
    #: one row per ``detector``, the vendor: the operating point with exact intervals and ``chance``, ``at_least``,
    #: the one-sided bound of Pd at the confidence of the requirement, and whether that ``shows`` it
    points: pd.DataFrame
    #: one row per pair, see :class:`flgpr.scoring.SideBySide`, and ``p_held``, Holm's p of all pairs
    pairs: pd.DataFrame
    groups: dict[
        str, pd.DataFrame
    ]  #: rows of :func:`flgpr.scoring.pd_table` with ``detector``, by column
    curves: dict[str, pd.DataFrame]  #: ROC with chance by vendor
    rules: Rules

    def in_words(self) -> str:
        """Return the verdict in one sentence."""
        wanted = self.requirement
        count = int(self.points["n_targets"].iloc[0])
        found = []
        for row in self.points.to_dict("records"):
            found.append(f"{row['detector']} {row['n_detected']:.0f} of {count}")
        parts = [", ".join([*found, *self._differences()]), self._shown()]
        least = wanted.least_mines()
        if count < least:
            parts.append(f"none could, for that takes {least} mines without a miss")
        return f"At the registered {wanted.far:g} per m²: {'; '.join(parts)}."

    def _differences(self) -> list[str]:
        """Return in words which vendors are told apart; nothing of a single one."""
        if not len(self.pairs):
            return []
        limit = 1 - self.rules.level
        held = self.pairs["p_held"]
        if len(self.pairs) == 1:
            told = "told apart" if held[0] < limit else "not told apart"
            return [f"{told} (p = {held[0]:.2g})"]
        apart = self.pairs[held < limit]
        if not len(apart):
            return [f"no two told apart (least p = {held.min():.2g}, Holm, {len(held)} pairs)"]
        names = [
            f"{row.first} from {row.second} (p = {row.p_held:.2g})" for row in apart.itertuples()
        ]
        return [f"told apart (Holm, {len(held)} pairs): {', '.join(names)}"]

    def _shown(self) -> str:
        """Return in words who shows what is required."""
        wanted = self.requirement.in_words()
        names = list(self.points["detector"])
        showing = list(self.points.loc[self.points["shows"], "detector"])
        if not showing:
            nobody = {1: "it does not show", 2: "neither shows"}.get(len(names), "none shows")
            return f"{nobody} {wanted}"
        if len(showing) == len(names):
            everybody = {1: "it shows", 2: "both show"}.get(len(names), "all show")
            return f"{everybody} {wanted}"
        verb = "alone shows" if len(showing) == 1 else "show"
        return f"{' and '.join(showing)} {verb} {wanted}"


def judge(matches: Mapping[str, Match], requirement: Requirement, rules: Rules) -> Verdict:
    """Score vendors' lists at a required false alarm rate.

    Parameters
    ----------
    matches : mapping of str to Match
        Lists by vendor, matched to the same truth.
    requirement : Requirement
        What a detector has to show.
    rules : Rules
        Area and level of the intervals.

    Returns
    -------
    Verdict
        The verdict.

    Raises
    ------
    ValueError
        If there are no targets.
    """
    points = []
    curves = {}
    tables: dict[str, list[pd.DataFrame]] = {}
    for vendor, matched in matches.items():
        level = chance(matched, rules.shifts, rules.seed)
        curves[vendor] = curve = curve_by(rules, matched, level)
        row = curve.iloc[[int(operating_row(curve, requirement.far))]]
        points.append(row.assign(detector=vendor, far_allowed=requirement.far))
        for column in GROUPS:
            if column in matched.truth:
                table = pd_table(
                    matched,
                    requirement.far,
                    [column],
                    area=rules.area,
                    level=rules.level,
                    chance=level,
                )
                tables.setdefault(column, []).append(table.assign(detector=vendor))
    table = pd.concat(points, ignore_index=True)
    if not table["n_targets"].iloc[0]:
        raise ValueError("truth must have at least one target for a verdict, got none")
    one_sided = 2 * requirement.confidence - 1  # level of the interval with such tails
    at_least, _ = clopper_pearson(table["n_detected"], table["n_targets"], one_sided)
    table = table.assign(at_least=at_least, shows=at_least >= requirement.pd)
    table.attrs = {}
    groups = {}
    for column, parts in tables.items():
        groups[column] = pd.concat(parts, ignore_index=True).sort_values(
            [column, "detector"], kind="stable", ignore_index=True
        )
        groups[column].attrs = {}
    pairs = pd.DataFrame()
    if len(matches) > 1:
        pairs = side_by_side(matches, [requirement.far], rules, means=False).pairs
        pairs = pairs.assign(p_held=holm(pairs["p"].tolist()))
    return Verdict(requirement, table, pairs, groups, curves, rules)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust the p of several tests by the rule of Holm (1979), Scand. J. Stat. 6.

    Examples
    --------
    >>> from flgpr_trials.verdict import holm
    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    p = floats(p_values)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    return np.minimum(1.0, adjusted).tolist()
