"""Sequential forward search with closed-form updates of Fisher's discriminant (Wang et al. 2007, Sec. II-F).

The scatter matrix and the class means of all features are computed once per fold. Adding feature j to a set S then
needs no new fit: with ``q = S_SS⁻¹ s_Sj`` and the Schur complement ``c = s_jj - q·s_Sj`` the direction becomes
``(w_S - q·β, β)``, ``β = (Δ_j - q·Δ_S)/c``, and the confidences change by ``β·(x_j - X_S q)``. All candidates are
tried at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.detect.fisher import HistogramNormalizer, class_moments

FloatArray = NDArray[np.float64]
Scorer = Callable[[FloatArray], float]
# a candidate with less than this share of its scatter outside the span of the chosen ones adds
# nothing
_ALONE = 1e-9


@dataclass(frozen=True)
class Fold:
    """What a discriminant learns from one training set, and the samples it is tried on."""

    samples: NDArray[np.intp]  #: rows that are tried
    values: FloatArray  #: (sample, feature): their normalised features
    scatter: FloatArray  #: (feature, feature): within-class scatter of the training set
    difference: FloatArray  #: difference of the class means of the training set


@dataclass(frozen=True)
class SearchStep:
    """One step of a search."""

    feature: int  #: feature that was added
    score: float  #: what the scorer gave the set with it
    confidence: FloatArray  #: confidences with that set


def make_fold(
    X: ArrayLike,
    label: ArrayLike,
    weight: ArrayLike,
    train: ArrayLike,
    test: ArrayLike | None = None,
) -> Fold:
    """Normalise by the training samples and gather their moments.

    Parameters
    ----------
    X : (sample, feature) array_like
        Features, not normalised.
    label : (sample,) array_like
        1 for hits, 0 for false alarms.
    weight : (sample,) array_like of int
        How often each sample counts in training.
    train : (sample,) array_like of bool
        Training samples.
    test : (sample,) array_like of bool, optional
        Samples to try; default all.

    Raises
    ------
    ValueError
        If a class has no training sample.
    """
    features: FloatArray = np.asarray(X, np.float64)
    use = np.asarray(train, bool)
    labels = np.asarray(label)[use]
    counts = np.asarray(weight, np.float64)[use]
    tried = np.flatnonzero(np.ones(len(features), bool) if test is None else np.asarray(test, bool))
    hits, false_alarms = (int((labels == k).sum()) for k in (1, 0))
    if not hits or not false_alarms:
        raise ValueError(
            f"train must hold samples of both classes, got {hits} hits and {false_alarms} false alarms in the fold; "
            "take fewer folds, or lanes with more mines"
        )
    normalizer = HistogramNormalizer().fit(features[use], sample_weight=counts)
    means, scatter = class_moments(normalizer.transform(features[use]), labels, counts)
    values = (
        normalizer.transform(features[tried]) if tried.size else np.zeros((0, features.shape[1]))
    )
    return Fold(tried, values, scatter, means[1] - means[0])


class _State:
    """The discriminant of the chosen features in one fold."""

    def __init__(self, fold: Fold) -> None:
        self.fold = fold
        self.chosen = np.zeros(0, np.intp)
        self.inverse = np.zeros((0, 0))
        self.weight = np.zeros(0)
        self.confidence = np.zeros(len(fold.samples))

    def _update(self, candidates: NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray]:
        fold = self.fold
        chosen = self.chosen
        cross = fold.scatter[np.ix_(chosen, candidates)]
        q = self.inverse @ cross
        own = np.diag(fold.scatter)[candidates]
        rest = own - np.einsum("sc,sc->c", q, cross)
        alone = rest > _ALONE * np.maximum(own, np.finfo(float).tiny)
        gain = fold.difference[candidates] - fold.difference[chosen] @ q
        return q, rest, np.divide(gain, rest, out=np.zeros_like(gain), where=alone)

    def try_all(self, candidates: NDArray[np.intp]) -> FloatArray:
        """Confidences (sample, candidate) with each candidate added."""
        q, _, beta = self._update(candidates)
        values = self.fold.values
        return self.confidence[:, None] + beta * (
            values[:, candidates] - values[:, self.chosen] @ q
        )

    def add(self, feature: int) -> None:
        one = np.array([feature])
        confidence = self.try_all(one)[:, 0]
        q, rest, beta = self._update(one)
        self.confidence = confidence
        if beta[0] == 0:
            return
        column = np.append(-q[:, 0], 1.0)
        grown = np.zeros((len(column), len(column)))
        grown[:-1, :-1] = self.inverse
        self.inverse = grown + np.outer(column, column) / rest[0]
        self.chosen = np.append(self.chosen, feature)


def single_features(folds: Sequence[Fold], samples: int, scorer: Scorer) -> FloatArray:
    """Score every feature on its own.

    Parameters
    ----------
    folds : sequence of Fold
        One for resubstitution, one per lane for cross-validation.
    samples : int
        Number of samples of the table.
    scorer : callable
        Takes the confidences of all samples, higher for mines, and returns what is to be large.

    Returns
    -------
    (feature,) ndarray
        Scores.
    """
    features = np.arange(folds[0].scatter.shape[0])
    together = _together([_State(fold).try_all(features) for fold in folds], folds, samples)
    return np.array([scorer(column) for column in together.T])


def forward_search(
    folds: Sequence[Fold], samples: int, scorer: Scorer, steps: int | None = None
) -> list[SearchStep]:
    """Add, one after the other, the feature that makes the score largest.

    Parameters
    ----------
    folds : sequence of Fold
        One for resubstitution, one per lane for cross-validation; samples in no fold have the
        confidence -inf.
    samples : int
        Number of samples of the table.
    scorer : callable
        Takes the confidences of all samples, higher for mines, and returns what is to be large.
    steps : int, optional
        Number of features to choose; default all.

    Returns
    -------
    list of SearchStep
        In the order of the search; of equal scores the first feature is taken.

    Raises
    ------
    ValueError
        If there is no fold or fewer features than steps.
    """
    if not folds:
        raise ValueError("folds must hold at least one fold, got none")
    count = folds[0].scatter.shape[0]
    steps = count if steps is None else steps
    if not 1 <= steps <= count:
        raise ValueError(
            f"steps must lie between 1 and the number of features ({count}), got {steps}"
        )
    states = [_State(fold) for fold in folds]
    left = np.arange(count)
    found = []
    for _ in range(steps):
        together = _together([state.try_all(left) for state in states], folds, samples)
        scores = [scorer(column) for column in together.T]
        best = int(np.argmax(scores))
        for state in states:
            state.add(int(left[best]))
        found.append(SearchStep(int(left[best]), float(scores[best]), together[:, best].copy()))
        left = np.delete(left, best)
    return found


def _together(parts: Sequence[FloatArray], folds: Sequence[Fold], samples: int) -> FloatArray:
    table = np.full((samples, parts[0].shape[1]), -np.inf)
    for part, fold in zip(parts, folds, strict=True):
        table[fold.samples] = part
    return table
