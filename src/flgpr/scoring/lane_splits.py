"""Splits into training and testing, grouped so that the looks at one mine never stand on both sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.scoring.matching import one_of

HEADLINE = "target"


@dataclass(frozen=True)
class Split:
    """One division of examples."""

    scheme: str  #: how it was made; the papers' own schemes carry the paper's name
    held_out: str  #: what is tested
    #: train, test: row numbers
    train: NDArray[np.int64]
    test: NDArray[np.int64]
    straddles: bool  #: whether some mine is seen on both sides; such a score is no headline


def splits(
    examples: pd.DataFrame, by: Literal["example", "target", "lane", "site"] = "target", *, folds: int | None = None
) -> list[Split]:
    """Divide examples so that each is tested once.

    Parameters
    ----------
    examples : DataFrame
        One row per example. ``target`` names its mine, missing or empty for clutter; two passes over one mine share
        the name. ``lane`` and ``site`` are needed to split by them.
    by : {"example", "target", "lane", "site"}
        What is left out at a time. "target", the headline, leaves out a mine with all its looks; clutter is dealt
        to the folds in turn, stretches that carry the same ``clutter`` name together where that column exists. With
        "lane" and "site" the looks at a tested mine from other lanes are left out of training. "example" leaves out
        single rows as flsar2004 did, and straddles.
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
    mine = _mines(examples)
    rows = np.arange(len(examples))
    if by == "example":
        group = rows
    elif by == "target":
        group = _target_groups(examples, mine, folds)
    else:
        group = pd.factorize(_named(examples, by), sort=True)[0]
    if folds is not None and by != "target":
        raise ValueError(f'folds must be left out unless by="target", got {folds} with {by!r}')
    if len(np.unique(group)) < 2:
        raise ValueError(f"examples must fall into at least two groups by {by}, got {len(np.unique(group))}")
    result = []
    for value in np.unique(group):
        test, train = rows[group == value], rows[group != value]
        tested = set(mine[test]) - {""}
        if by in ("lane", "site"):
            train = train[~np.isin(mine[train], list(tested))] if tested else train
        name = str(examples[by].iloc[test[0]]) if by in ("lane", "site") else ", ".join(sorted(tested)) or str(value)
        result.append(Split(f"leave-one-{by}-out", name, train, test, bool(tested & set(mine[train]))))
    return result


def cross_site(examples: pd.DataFrame, train_site: str, test_site: str) -> Split:
    """Train on one site, test on another.

    Parameters
    ----------
    examples : DataFrame
        As for :func:`splits`, with the column ``site``.
    train_site, test_site : str
        Their names.

    Returns
    -------
    Split
        The division.

    Raises
    ------
    ValueError
        If a site is not in the table.
    """
    site = _named(examples, "site")
    for name in (train_site, test_site):
        if name not in set(site):
            raise ValueError(f"site must be one of {', '.join(sorted(set(site)))}, got {name!r}")
    if train_site == test_site:
        raise ValueError(f"train_site and test_site must differ, got {train_site!r} twice")
    train, test = np.flatnonzero(site == train_site), np.flatnonzero(site == test_site)
    mine = _mines(examples)
    return Split("cross-site", test_site, train, test, bool((set(mine[train]) & set(mine[test])) - {""}))


def paper_splits(
    examples: pd.DataFrame, paper: Literal["cosgrove2004", "flsar2004", "wang2007"], **choices: Any
) -> list[Split]:
    """Divide examples as a paper did, straddling or not; ``scheme`` carries the paper's name.

    Parameters
    ----------
    examples : DataFrame
        As for :func:`splits`.
    paper : {"cosgrove2004", "flsar2004", "wang2007"}
        cosgrove2004: train on the mines of one depth, test on those of all others; clutter is dealt evenly. flsar2004:
        leave one example out. wang2007: leave one lane out, whatever else shows the same mine. fuse2018 trains nothing.
    **choices
        ``depth``: the training depth for cosgrove2004, m (column ``depth``).

    Returns
    -------
    list of Split
        The divisions.

    Raises
    ------
    ValueError
        If the paper is unknown or a column or choice is missing.
    """
    one_of("paper", paper, ("cosgrove2004", "flsar2004", "wang2007"))
    mine, rows = _mines(examples), np.arange(len(examples))
    if paper == "cosgrove2004":
        if "depth" not in examples.columns or "depth" not in choices:
            raise ValueError("examples must have the column depth, and depth must be given, for cosgrove2004")
        clutter = mine == ""
        learned = ~clutter & np.isclose(examples["depth"].to_numpy(dtype=float), float(choices["depth"]))
        learned |= clutter & (np.cumsum(clutter) % 2 == 0)
        sides = [(f"all but {choices['depth']:g} m", learned)]
    elif paper == "flsar2004":
        sides = [(str(row), rows != row) for row in rows]
    else:
        lane = _named(examples, "lane")
        sides = [(str(name), lane != name) for name in np.unique(lane)]
    return [
        Split(paper, name, rows[learn], rows[~learn], bool((set(mine[learn]) & set(mine[~learn])) - {""}))
        for name, learn in sides
    ]


def _named(examples: pd.DataFrame, column: str) -> NDArray[Any]:
    if column not in examples.columns:
        raise ValueError(f"examples must have the column {column} to split by it")
    if examples[column].isna().any():
        raise ValueError(f"examples.{column} must be named in every row, got {int(examples[column].isna().sum())} gaps")
    return examples[column].astype(str).to_numpy(dtype=object)


def _mines(examples: pd.DataFrame) -> NDArray[Any]:
    if "target" not in examples.columns:
        raise ValueError(f"examples must have the column target; got {', '.join(map(str, examples.columns))}")
    return examples["target"].fillna("").astype(str).to_numpy(dtype=object)


def _target_groups(examples: pd.DataFrame, mine: NDArray[Any], folds: int | None) -> NDArray[np.int64]:
    """Give every example the number of its group: mines one by one or dealt to folds, clutter dealt in turn."""
    is_mine = mine != ""
    names = list(dict.fromkeys(mine[is_mine]))
    count = len(names) if folds is None else folds
    if folds is not None and not 2 <= folds <= max(len(names), 2):
        raise ValueError(f"folds must lie between 2 and the number of mines ({len(names)}), got {folds}")
    group = np.zeros(len(mine), dtype=np.int64)
    place = {name: number % count for number, name in enumerate(names)}
    group[is_mine] = [place[name] for name in mine[is_mine]]
    clutter = examples["clutter"] if "clutter" in examples.columns else pd.Series(np.arange(len(mine)).astype(str))
    stretches = pd.factorize(clutter.astype(str).to_numpy()[~is_mine])[0]
    group[~is_mine] = stretches % max(count, 1)
    return group
