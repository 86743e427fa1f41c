"""Numbers that the statements of flsar2004 are judged by, with their intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from flgpr.features import max_correlation, mean_template, principal_templates
from flgpr.scoring import example_roc
from flgpr.types import AnyArray, BoolArray, Entries, FloatArray, floats
from flgpr_papers.flsar2004.examples import Site, make_templates, open_examples
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.machines import Examples, HeldOut
from flgpr_papers.kit.findings import Finding, Statements, finding_of
from flgpr_papers.kit.intervals import Interval, percentiles

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
    notes: Entries = field(default_factory=dict)  #: further numbers that the page shows
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

    def add_areas(self, name: str, scores: HeldOut, measure: Measure) -> None:
        """Add both areas under a ROC, and the partial one that chance gives.

        Parameters
        ----------
        name : str
            Name of the curve.
        scores : HeldOut
            Scores of held-out examples.
        measure : Measure
            The partial area.
        """
        self.areas[name] = auc_interval(scores, measure.draws)
        self.partial[name] = measure.interval(scores)
        self.chance[name] = measure.chance(scores)

    def add(self, record: Entries) -> None:
        """Add the results of another part, as read from JSON."""
        self.findings += [finding_of(row) for row in record["findings"]]
        for name in ("areas", "partial", "chance", "notes", "curves"):
            getattr(self, name).update(record[name])


@dataclass(frozen=True)
class Material:
    """What all parts work on."""

    settings: Settings
    sites: list[Site]  #: both sites
    templates: list[AnyArray]  #: templates of each
    examples: list[Examples]  #: examples without prescreener of each

    @property
    def draws(self) -> int:
        """Number of bootstrap draws."""
        return self.settings.classify.bootstrap

    def measure(self, examples: Examples) -> Measure:
        """Return the partial area under the ROC of examples without prescreener."""
        return Measure(open_area(examples, self.settings), draws=self.draws)


def prepare(settings: Settings, sites: list[Site]) -> Material:
    """Make the templates and the examples without prescreener of both sites."""
    templates = [make_templates(settings, site) for site in sites]
    examples = [
        open_examples(settings, site, site_templates)
        for site, site_templates in zip(sites, templates, strict=True)
    ]
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
    table = examples.table
    is_chosen = table["kind"].isin(kinds) & table["depth"].between(*depth)
    chosen = examples.rows(np.flatnonzero(is_chosen | ~examples.is_mine))
    half = chosen.X.shape[1] // 2
    halves = {"both": slice(None), "HH": slice(0, half), "VV": slice(half, None)}
    return Examples(chosen.table, chosen.X[:, halves[columns]])


def open_area(examples: Examples, settings: Settings) -> float:
    """Return the area of the clutter tiles, m²: what was searched beside the mines."""
    return (
        int((~examples.is_mine).sum()) * settings.features.region[0] * settings.features.region[1]
    )


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
    rng = np.random.default_rng(seed)
    drawn = []
    for is_kind, count in zip((examples.is_mine, ~examples.is_mine), most, strict=True):
        rows = np.flatnonzero(is_kind)
        drawn.append(rng.choice(rows, min(count, len(rows)), False))
    return examples.rows(np.sort(np.concatenate(drawn)))


FAR_LIMIT = 0.07
"""False alarms per m² up to which areas are taken.

The paper compares its ROCs at 0.04 to 0.07 (par. 50).
"""
_CHUNK = 50  # bootstrap draws at a time


def roc(scores: HeldOut, area: float, n_targets: int | None = None) -> pd.DataFrame:
    """Compute the ROC of held-out scores.

    The false alarms of a novelty detector are divided by the number of its folds.

    Parameters
    ----------
    scores : HeldOut
        Scores of mines and clutter.
    area : float
        Area that was searched, m².
    n_targets : int, optional
        Number of targets; that of the scored mines by default.
    """
    values = np.concatenate([scores.mine, scores.clutter.ravel()])
    is_mine = np.repeat([True, False], [scores.mine.size, scores.clutter.size])
    return example_roc(values, is_mine, area, n_targets=n_targets, repeats=scores.clutter.shape[1])


def _wins(scores: HeldOut) -> FloatArray:
    """Return how often each mine scores higher than each clutter example (mine, clutter).

    Ties are worth one half.
    """
    above = scores.mine[:, None, None] > scores.clutter[None]
    equal = scores.mine[:, None, None] == scores.clutter[None]
    return (above + 0.5 * equal).mean(axis=2)


def auc(scores: HeldOut) -> float:
    """Return the area under the ROC: how often a mine scores higher than clutter."""
    return float(_wins(scores).mean())


def _draws(scores: HeldOut, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return bootstrap weights of mines (count, n) and of clutter (count, m).

    Both drives over a mine are drawn together.
    """
    rng = np.random.default_rng(seed)
    names, code = np.unique(scores.target, return_inverse=True)
    n = len(names)
    m = len(scores.tile)
    mines = rng.multinomial(n, np.full(n, 1 / n), count)[:, code]
    clutter = rng.multinomial(m, np.full(m, 1 / m), count)
    return floats(mines), floats(clutter)


def auc_interval(scores: HeldOut, count: int) -> Interval:
    """Return the area under the whole ROC with its interval over mines and clutter examples.

    Parameters
    ----------
    scores : HeldOut
        Scores of mines and clutter.
    count : int
        Number of bootstrap draws.
    """
    mines, clutter = _draws(scores, count, 1)
    total = np.einsum("bi,ij,bj->b", mines, _wins(scores), clutter, optimize=True)
    return percentiles(auc(scores), total / (mines.sum(axis=1) * clutter.sum(axis=1)))


@dataclass(frozen=True)
class Measure:
    """A number of the ROC at few false alarms: mean Pd up to ``far`` per m², or Pd at it."""

    area: float  #: area that was searched, m²
    far: float = FAR_LIMIT
    #: whether the number is Pd at ``far``, or else the mean Pd over 0 to ``far``, the partial area
    #: over its width
    at: bool = False
    draws: int = 1000  #: bootstrap draws of its intervals

    def chance(self, scores: HeldOut) -> float:
        """Return the number of scores that know nothing of the mines."""
        most = len(scores.tile) / self.area
        if self.at:
            return min(self.far / most, 1.0)
        if self.far <= most:
            return self.far / most / 2
        return 1 - most / self.far / 2

    def of(self, scores: HeldOut, mines: FloatArray, tiles: FloatArray) -> FloatArray:
        """Return the number (draw,) for weights of mines and of clutter.

        The clutter's outputs are gone through from the strongest; each is a false alarm for its
        weight, and Pd is the weight of the mines above it. The outputs of a novelty detector's
        folds share the allowed false alarms.

        Parameters
        ----------
        scores : HeldOut
            Scores of mines and clutter.
        mines : (draw, n) ndarray
            Weight of every mine.
        tiles : (draw, m) ndarray
            Weight of every clutter example.
        """
        repeats = scores.clutter.shape[1]
        allowed = self.far * self.area * repeats
        order = np.argsort(-scores.clutter.ravel(), kind="stable")
        # A draw leaves out a third of the outputs: more of them are needed than are allowed.
        order = order[: int(4 * allowed) + 20 * repeats]
        output = scores.clutter.ravel()[order]
        tile = order // repeats
        above = floats(scores.mine[:, None] > output)
        above += 0.0 if self.at else 0.5 * (scores.mine[:, None] == output)
        share = mines / mines.sum(axis=1, keepdims=True)
        pd_without_limit = share @ np.isfinite(scores.mine)
        values = np.empty(len(mines))
        for begin in range(0, len(mines), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            reached = np.cumsum(tiles[rows][:, tile], axis=1)
            pd_above = share[rows] @ above
            if self.at:
                first = np.argmax(reached > allowed, axis=1)
                is_never_reached = reached[:, -1] <= allowed
                pd_at_first = pd_above[np.arange(len(first)), first]
                values[rows] = np.where(is_never_reached, pd_without_limit[rows], pd_at_first)
            else:
                taken = np.diff(np.minimum(reached, allowed), prepend=0.0, axis=1)
                rest = np.maximum(allowed - reached[:, -1], 0.0)
                area = (taken * pd_above).sum(axis=1) + rest * pd_without_limit[rows]
                values[rows] = area / allowed
        return values

    def value(self, scores: HeldOut) -> float:
        """Return the number of the scores as they are."""
        mines = np.ones((1, scores.mine.size))
        tiles = np.ones((1, len(scores.tile)))
        return float(self.of(scores, mines, tiles)[0])

    def interval(self, scores: HeldOut) -> Interval:
        """Return the number with its bootstrap interval over mines and clutter examples.

        Both looks at a mine are drawn together.

        Parameters
        ----------
        scores : HeldOut
            Scores of mines and clutter.
        """
        return percentiles(self.value(scores), self.of(scores, *_draws(scores, self.draws, 1)))

    def difference(self, a: HeldOut, b: HeldOut) -> Interval:
        """Return the number of a classifier less that of another, with its bootstrap interval.

        Mines and clutter that both scored are drawn together, others apart.

        Parameters
        ----------
        a, b : HeldOut
            Scores of the two classifiers.
        """
        has_same_mines = np.array_equal(a.target, b.target)
        has_same_clutter = a.tile.size == b.tile.size
        first_mines, first_tiles = _draws(a, self.draws, 1)
        second_mines, second_tiles = _draws(b, self.draws, 2)
        if has_same_mines:
            second_mines = first_mines
            if has_same_clutter:
                second_tiles = first_tiles
        drawn = self.of(a, first_mines, first_tiles) - self.of(b, second_mines, second_tiles)
        return percentiles(self.value(a) - self.value(b), drawn)


def pd_count(scores: HeldOut, area: float, far: float, chosen: BoolArray) -> tuple[int, int]:
    """Return how many of the chosen mines are found at an allowed FAR, and how many there are.

    Parameters
    ----------
    scores : HeldOut
        Scores of mines and clutter.
    area : float
        Area that was searched, m².
    far : float
        Allowed false alarms per m².
    chosen : (n,) ndarray of bool
        Which mines count.
    """
    curve = roc(scores, area)
    point = np.searchsorted(curve["far"].to_numpy(), far, side="right") - 1
    threshold = curve["threshold"].to_numpy()[point]
    return int((scores.mine[chosen] >= threshold).sum()), int(chosen.sum())


def ratio_interval(a: FloatArray, b: FloatArray) -> Interval:
    """Return the ratio of two mean shares of vectors, with its range.

    The range holds 95 % of the folds' own ratios.

    Parameters
    ----------
    a, b : (fold,) ndarray
        Share of the training examples that are vectors, of each machine.
    """
    return percentiles(a.mean() / b.mean(), a / b)


def spread_of_folds(shares: FloatArray) -> Interval:
    """Return the mean share of vectors, with the range that holds 95 % of the folds."""
    return percentiles(shares.mean(), shares)


def stronger_interval(a: pd.DataFrame, b: pd.DataFrame, count: int) -> Interval:
    """Return how often a mine of one table is stronger than one of another at the same depth.

    Parameters
    ----------
    a, b : DataFrame
        ``peak``, ``depth`` and ``target``, a row per look. Targets are drawn anew.
    count : int
        Number of bootstrap draws, of which 200 are made at the most.
    """
    return _resampled(_stronger_share, _drawn_targets, (a, b), min(count, 200), 5)[0]


def _resampled(
    statistic: Callable[..., Any],
    draw: Callable[..., Any],
    samples: tuple[Any, ...],
    count: int,
    seed: int,
) -> list[Interval]:
    """Return the numbers of a statistic with their intervals.

    ``draw`` makes a bootstrap sample of each sample.
    """
    rng = np.random.default_rng(seed)
    drawn = [statistic(*[draw(sample, rng) for sample in samples]) for _ in range(count)]
    numbers = np.atleast_1d(statistic(*samples))
    return list(map(percentiles, numbers, np.reshape(drawn, (count, -1)).T))


def _drawn_targets(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Draw as many targets of a table as it has, with all their looks."""
    names = table["target"].unique()
    drawn = rng.choice(names, len(names))
    return pd.concat([table[table["target"] == name] for name in drawn])


def _drawn_rows(chips: AnyArray, rng: np.random.Generator) -> AnyArray:
    """Draw as many signatures as there are."""
    return chips[rng.integers(0, len(chips), len(chips))]


def _stronger_share(table: pd.DataFrame, other: pd.DataFrame) -> float:
    """Return the share of pairs of looks at one depth in which that of the first is stronger."""
    wins = 0.0
    pairs = 0.0
    for depth in np.intersect1d(table["depth"], other["depth"]):
        u = table.loc[table["depth"] == depth, "peak"].to_numpy()
        v = other.loc[other["depth"] == depth, "peak"].to_numpy()
        wins += (u[:, None] > v).sum() + 0.5 * (u[:, None] == v).sum()
        pairs += u.size * v.size
    return wins / pairs if pairs else float("nan")


def component_interval(chips: AnyArray, count: int) -> tuple[Interval, Interval]:
    """Return the first principal component's energy, and its cosine with the mean template.

    Both are means over polarizations and ranges. Mines are drawn anew in every bootstrap draw.

    Parameters
    ----------
    chips : (n, polarization, range, y, x) ndarray
        Signatures of the mines.
    count : int
        Number of bootstrap draws, of which 100 are made at the most.
    """
    share, cosine = _resampled(_first_component, _drawn_rows, (chips,), min(count, 100), 3)
    return share, cosine


def _first_component(chips: AnyArray) -> tuple[float, float]:
    """Return the first component's share of energy and its cosine with the mean template."""
    shares = []
    cosines = []
    for polarization, distance in np.ndindex(*chips.shape[1:3]):
        images = chips[:, polarization, distance]
        component, share = principal_templates(images, 1)
        shares.append(share[0])
        cosines.append(abs(float((component[0] * mean_template(images)).sum())))
    return float(np.mean(shares)), float(np.mean(cosines))


def likeness_interval(a: AnyArray, b: AnyArray, count: int) -> Interval:
    """Return the largest correlation of two sites' mean templates, with its interval over mines.

    It is the mean over polarizations and ranges.

    Parameters
    ----------
    a, b : (n, polarization, range, y, x) ndarray
        Signatures of the mines of each site.
    count : int
        Number of bootstrap draws, of which 100 are made at the most.
    """
    return _resampled(_likeness, _drawn_rows, (a, b), min(count, 100), 4)[0]


def _likeness(a: AnyArray, b: AnyArray) -> float:
    """Return the largest correlation of mean templates, mean over polarizations and ranges."""
    s = mean_template(a)
    t = mean_template(b)
    return float(np.mean([max_correlation(s[k], t[k]) for k in np.ndindex(*s.shape[:2])]))
