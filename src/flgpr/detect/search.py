"""Sequential forward search for features of Fisher's discriminant (Wang et al. 2007, Sec. II-F).

The scatter matrix and the class means of all features are computed once per fold. Adding feature j
to a set S then needs no new fit: with ``q = S_SS⁻¹ s_Sj`` and the Schur complement ``c = s_jj -
q·s_Sj`` the direction becomes ``(w_S - q·β, β)``, ``β = (Δ_j - q·Δ_S)/c``, and the confidences
change by ``β·(x_j - X_S q)``. All candidates are tried at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flgpr.detect.fisher import HistogramNormalizer, class_moments
from flgpr.types import ArrayLike, FloatArray, IndexArray, floats

Scorer = Callable[[FloatArray], float]
# A candidate with less than this share of its scatter outside the span of the chosen ones adds
# nothing.
_LEAST_NEW_SCATTER = 1e-9


@dataclass(frozen=True)
class Fold:
    """Moments of one training set, and the samples that the discriminant is tried on."""

    samples: IndexArray  #: rows that are tried
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
    features: FloatArray = floats(X)
    use = np.asarray(train, bool)
    labels = np.asarray(label)[use]
    counts = floats(weight)[use]
    tried = np.arange(len(features))
    if test is not None:
        tried = np.flatnonzero(np.asarray(test, bool))
    hits = int((labels == 1).sum())
    false_alarms = int((labels == 0).sum())
    if not hits or not false_alarms:
        raise ValueError(
            f"train must hold samples of both classes, got {hits} hits and {false_alarms} "
            "false alarms in the fold; take fewer folds, or lanes with more mines"
        )
    normalizer = HistogramNormalizer().fit(features[use], sample_weight=counts)
    means, scatter = class_moments(normalizer.transform(features[use]), labels, counts)
    values = np.zeros((0, features.shape[1]))
    if tried.size:
        values = normalizer.transform(features[tried])
    return Fold(tried, values, scatter, means[1] - means[0])


class _State:
    """The discriminant of the chosen features in one fold."""

    def __init__(self, fold: Fold) -> None:
        self.fold = fold
        self.chosen = np.zeros(0, np.intp)
        self.inverse = np.zeros((0, 0))
        self.weight = np.zeros(0)
        self.confidence = np.zeros(len(fold.samples))

    def _update(self, candidates: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, the Schur complement c and β of every candidate."""
        fold = self.fold
        chosen = self.chosen
        cross = fold.scatter[np.ix_(chosen, candidates)]
        q = self.inverse @ cross
        variance = np.diag(fold.scatter)[candidates]
        c = variance - np.einsum("sc,sc->c", q, cross)
        adds_scatter = c > _LEAST_NEW_SCATTER * np.maximum(variance, np.finfo(float).tiny)
        gain = fold.difference[candidates] - fold.difference[chosen] @ q
        beta = np.divide(gain, c, out=np.zeros_like(gain), where=adds_scatter)
        return q, c, beta

    def try_all(self, candidates: IndexArray) -> FloatArray:
        """Return confidences (sample, candidate) with each candidate added."""
        q, _, beta = self._update(candidates)
        values = self.fold.values
        new_direction = values[:, candidates] - values[:, self.chosen] @ q
        return self.confidence[:, None] + beta * new_direction

    def add(self, feature: int) -> None:
        """Add a feature to the chosen ones, unless it brings no scatter of its own."""
        candidate = np.array([feature])
        confidence = self.try_all(candidate)[:, 0]
        q, c, beta = self._update(candidate)
        self.confidence = confidence
        if beta[0] == 0:
            return
        column = np.append(-q[:, 0], 1.0)
        bordered = np.zeros((len(column), len(column)))
        bordered[:-1, :-1] = self.inverse
        self.inverse = bordered + np.outer(column, column) / c[0]
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
    by_fold = [_State(fold).try_all(features) for fold in folds]
    confidences = _of_all_folds(by_fold, folds, samples)
    return np.array([scorer(column) for column in confidences.T])


def forward_search(
    folds: Sequence[Fold], samples: int, scorer: Scorer, steps: int | None = None
) -> list[SearchStep]:
    """Choose features one after the other, each time the one that makes the score largest.

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
    candidates = np.arange(count)
    chosen = []
    for _ in range(steps):
        by_fold = [state.try_all(candidates) for state in states]
        confidences = _of_all_folds(by_fold, folds, samples)
        scores = [scorer(column) for column in confidences.T]
        best = int(np.argmax(scores))
        feature = int(candidates[best])
        for state in states:
            state.add(feature)
        chosen.append(SearchStep(feature, float(scores[best]), confidences[:, best].copy()))
        candidates = np.delete(candidates, best)
    return chosen


def _of_all_folds(by_fold: Sequence[FloatArray], folds: Sequence[Fold], samples: int) -> FloatArray:
    """Return the confidences (sample, candidate) of all folds; -inf for samples in no fold."""
    confidences = np.full((samples, by_fold[0].shape[1]), -np.inf)
    for fold, of_fold in zip(folds, by_fold, strict=True):
        confidences[fold.samples] = of_fold
    return confidences
