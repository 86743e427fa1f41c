"""Splits into training and test sets that keep all looks at one mine together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from flgpr.scoring.matching import one_of
from flgpr.types import AnyArray, IntArray


@dataclass(frozen=True)
class Split:
    """One division of examples."""

    scheme: str  #: how it was made
    held_out: str  #: what is tested
    #: train, test: row numbers
    train: IntArray
    test: IntArray
    straddles: bool  #: whether some mine is seen on both sides; such a score is no headline


def splits(
    examples: pd.DataFrame,
    by: Literal["example", "target", "lane", "site"] = "target",
    *,
    folds: int | None = None,
) -> list[Split]:
    """Divide examples so that each is tested once.

    Parameters
    ----------
    examples : DataFrame
        One row per example. ``target`` names its mine, missing or empty for clutter; two passes
        over one mine share the name. ``lane`` and ``site`` are needed to split by them.
    by : {"example", "target", "lane", "site"}
        What is left out at a time. "target", the headline, leaves out a mine with all its looks;
        clutter is dealt to the folds in turn, stretches that carry the same ``clutter`` name
        together where that column exists. With "lane" and "site" the looks at a tested mine from
        other lanes are left out of training. "example" leaves out single rows as flsar2004 did, and
        straddles.
    folds : int, optional
        Number of groups that mines are dealt to instead of one mine at a time ("target" only).

    Returns
    -------
    list of Split
        The divisions.

    Raises
    ------
    ValueError
        If a column is missing, an option is unknown, or there is only one group.
    """
    one_of("by", by, ("example", "target", "lane", "site"))
    target = _target_names(examples)
    rows = np.arange(len(examples))
    if by == "example":
        group = rows
    elif by == "target":
        group = _target_groups(examples, target, folds)
    else:
        group, _ = pd.factorize(_complete_column(examples, by), sort=True)
    if folds is not None and by != "target":
        raise ValueError(f'folds must be left out unless by="target", got {folds} with {by!r}')
    values = np.unique(group)
    if len(values) < 2:
        raise ValueError(f"examples must fall into at least two groups by {by}, got {len(values)}")
    result = []
    for value in values:
        test = rows[group == value]
        train = rows[group != value]
        tested = set(target[test]) - {""}
        held_out = ", ".join(sorted(tested)) or str(value)
        if by in ("lane", "site"):
            train = train[~np.isin(target[train], list(tested))] if tested else train
            held_out = str(examples[by].iloc[test[0]])
        straddles = bool(tested & set(target[train]))
        result.append(Split(f"leave-one-{by}-out", held_out, train, test, straddles))
    return result


def _complete_column(examples: pd.DataFrame, column: str) -> AnyArray:
    """Return a column as text, which must have a name in every row."""
    if column not in examples.columns:
        raise ValueError(f"examples must have the column {column} to split by it")
    gaps = int(examples[column].isna().sum())
    if gaps:
        raise ValueError(f"examples.{column} must be named in every row, got {gaps} gaps")
    return examples[column].astype(str).to_numpy(dtype=object)


def _target_names(examples: pd.DataFrame) -> AnyArray:
    """Return the mine that each example shows, empty for clutter."""
    if "target" not in examples.columns:
        raise ValueError(
            f"examples must have the column target; got {', '.join(map(str, examples.columns))}"
        )
    return examples["target"].fillna("").astype(str).to_numpy(dtype=object)


def _target_groups(examples: pd.DataFrame, target: AnyArray, folds: int | None) -> IntArray:
    """Return the group of every example: mines in turn, clutter dealt to the groups in turn."""
    is_mine = target != ""
    names = list(dict.fromkeys(target[is_mine]))
    count = len(names) if folds is None else folds
    if folds is not None and not 2 <= folds <= max(len(names), 2):
        raise ValueError(
            f"folds must lie between 2 and the number of mines ({len(names)}), got {folds}"
        )
    group = np.zeros(len(target), dtype=np.int64)
    group_of_mine = {name: number % count for number, name in enumerate(names)}
    group[is_mine] = [group_of_mine[name] for name in target[is_mine]]
    each_alone = pd.Series(np.arange(len(target)).astype(str))
    clutter = examples["clutter"] if "clutter" in examples.columns else each_alone
    stretches, _ = pd.factorize(clutter.astype(str).to_numpy()[~is_mine])
    group[~is_mine] = stretches % max(count, 1)
    return group
