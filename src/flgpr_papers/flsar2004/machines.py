"""The classifiers of flsar2004 and their scores of unseen examples (par. 38, 45 and 52)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd
from scipy.spatial.distance import pdist
from sklearn import config_context
from sklearn.metrics import roc_auc_score
from sklearn.metrics.pairwise import pairwise_kernels
from sklearn.model_selection import StratifiedKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC, OneClassSVM

from flgpr.detect import (
    GaussianMixtureNovelty,
    OneClassRelevanceVectorMachine,
    RelevanceVectorClassifier,
)
from flgpr.detect.one_class import FORMULATIONS
from flgpr.scoring import Split, splits
from flgpr.types import AnyArray, BoolArray, FloatArray
from flgpr_papers.flsar2004.lanes import Classify

Scorer = Callable[[FloatArray], FloatArray]
"""A trained classifier: returns the scores (n,) of features (n, feature)."""
Classifier = Callable[[FloatArray, BoolArray], tuple[Scorer, float]]
"""Trains on features (n, feature) and labels (n,), True for a mine.

Returns the scorer and the share of the training examples that are vectors.
"""
Fold = tuple[Classifier, AnyArray, AnyArray]
"""A classifier, and the rows of the examples that train it and that it scores."""
NOVELTY_RIVALS = (*(f"rvm, {name}" for name in FORMULATIONS), "svm", "gmm")
"""One-class machines: relevance vectors by formulation, support vectors, a Gaussian mixture."""
_KERNEL = ("kernel", "gamma", "degree", "coef0")
"""Parameters of a kernel."""


class Examples(NamedTuple):
    """Examples and their features."""

    table: pd.DataFrame  #: a row per example, with ``kind`` and ``target``
    X: FloatArray  #: (n, feature) their features

    @property
    def is_mine(self) -> BoolArray:
        """Which examples are mines."""
        return np.asarray(self.table["kind"] != "clutter", dtype=np.bool_)

    def names(self, rows: BoolArray) -> AnyArray:
        """Return the names of the mines that some examples show."""
        return self.table["target"].to_numpy(dtype=str)[rows]

    def rows(self, rows: AnyArray) -> Examples:
        """Return some of the examples."""
        return Examples(pd.DataFrame(self.table.iloc[rows]).reset_index(drop=True), self.X[rows])


@dataclass(frozen=True)
class TunedClassifier:
    """A classifier whose kernel is chosen inside the training examples.

    The choice costs many times what the training costs, so :func:`held_out` lets it be made once
    for many folds.
    """

    choose: Callable[[FloatArray, BoolArray], Classifier]

    def __call__(self, X: FloatArray, y: BoolArray) -> tuple[Scorer, float]:
        """Choose and train on the same examples."""
        return self.choose(X, y)(X, y)


def rvm(settings: Classify, kernel: str = "rbf", rate: float = 1.0) -> TunedClassifier:
    """Return a relevance vector machine with the paper's Laplacian prior (par. 30).

    Its kernel is that of the SVM (par. 48). ``rate`` is λ² of the prior ``exp(-λ |w|)``, of which
    the paper says nothing.
    """
    machine = partial(RelevanceVectorClassifier, prior="laplacian-map", rate=rate)
    return _as_the_svm(settings, kernel, machine, _KERNEL)


def rvm_by_evidence(settings: Classify) -> TunedClassifier:
    """Return a relevance vector machine by another reading of the prior.

    It is exponential on the variances of the weights, which the evidence gives.
    """
    machine = partial(RelevanceVectorClassifier, prior="laplacian", n_starts=3, tol=1e-4)
    return _as_the_svm(settings, "rbf", machine, _KERNEL)


def svm(settings: Classify, kernel: str = "rbf") -> TunedClassifier:
    """Return a support vector machine.

    C and width or degree are chosen by cross-validation inside the training examples.
    """
    return _as_the_svm(settings, kernel, SVC, (*_KERNEL, "C"))


def _as_the_svm(
    settings: Classify, kernel: str, machine: Callable[..., Any], names: Sequence[str]
) -> TunedClassifier:
    """Return a machine with some of the parameters of the chosen SVM."""

    def choose(X: FloatArray, y: BoolArray) -> Classifier:
        chosen = search_svm(settings, kernel, X, y)[-1].get_params()
        return partial(_train, partial(machine, **{name: chosen[name] for name in names}))

    return TunedClassifier(choose)


def evidence_rvm(settings: Classify) -> TunedClassifier:
    """Return a relevance vector machine of our own choice.

    It has the ARD prior, and its width is chosen by the evidence of the training examples.
    """

    def choose(X: FloatArray, y: BoolArray) -> Classifier:
        Z = StandardScaler().fit_transform(X)
        machine = partial(RelevanceVectorClassifier, kernel="rbf")
        widths = [width / X.shape[1] for width in settings.widths]
        evidence = []
        for gamma in widths:
            trained = machine(gamma=gamma, n_starts=1, tol=1e-3).fit(Z, y)
            evidence.append(trained.log_evidence_)
        best = widths[int(np.argmax(evidence))]
        return partial(_train, partial(machine, gamma=best, n_starts=3, tol=1e-4))

    return TunedClassifier(choose)


def _train(
    machine: Callable[[], Any], X: FloatArray, y: BoolArray | None = None
) -> tuple[Scorer, float]:
    """Train a machine on standardised features; return its scorer and its share of vectors."""
    pipeline = make_pipeline(StandardScaler(), machine()).fit(X, y)
    last = pipeline[-1]
    vectors = last.support_ if hasattr(last, "support_") else last.relevance_
    return pipeline.decision_function, len(vectors) / len(X)


def search_svm(settings: Classify, kernel: str, X: FloatArray, y: BoolArray) -> Any:
    """Choose a support vector machine inside the training examples.

    Its kernel is that of the relevance vector machine, too. The criterion is the mean area under
    the ROC of three folds, whose kernels are computed once for all costs: a grid search of complete
    pipelines takes twice as long. With fewer than three mines there are as many folds as mines.

    Parameters
    ----------
    settings : Classify
        The widths or degrees, and the costs, to choose from.
    kernel : str
        "rbf" or "poly".
    X : (n, feature) ndarray
        Features of the training examples.
    y : (n,) ndarray of bool
        Which of them are mines.

    Returns
    -------
    Pipeline
        The chosen machine, not trained.

    Raises
    ------
    ValueError
        If there is only one mine or one clutter example.
    """
    folds = int(min(3, y.sum(), (~y).sum()))
    if folds < 2:
        raise ValueError(
            f"y must hold at least two mines and two clutter examples, got {y.sum()} and "
            f"{(~y).sum()}"
        )
    features = X.shape[1]
    options = [{"gamma": width / features} for width in settings.widths]
    if kernel == "poly":
        options = [{"degree": d, "coef0": 1.0, "gamma": 1 / features} for d in settings.degrees]
    area = np.zeros((len(settings.costs), len(options)))
    with config_context(assume_finite=True, skip_parameter_validation=True):
        for train, test in StratifiedKFold(folds, shuffle=True, random_state=0).split(X, y):
            scaler = StandardScaler().fit(X[train])
            train_scaled = scaler.transform(X[train])
            test_scaled = scaler.transform(X[test])
            for k, option in enumerate(options):
                train_kernel = pairwise_kernels(train_scaled, train_scaled, kernel, **option)
                test_kernel = pairwise_kernels(test_scaled, train_scaled, kernel, **option)
                for j, cost in enumerate(settings.costs):
                    machine = SVC(C=cost, kernel="precomputed").fit(train_kernel, y[train])
                    score = machine.decision_function(test_kernel)
                    above = score[y[test]][:, None] - score[~y[test]]
                    area[j, k] += (above > 0).mean() + 0.5 * (above == 0).mean()
    best_cost, best_option = np.unravel_index(int(area.argmax()), area.shape)
    chosen = SVC(C=settings.costs[best_cost], kernel=kernel, **options[best_option])
    return make_pipeline(StandardScaler(), chosen)


def sum_of_correlations(X: FloatArray, y: BoolArray) -> tuple[Scorer, float]:
    """Return the sum of the correlations with the templates as a scorer.

    It shows what the features give without a machine: nothing is trained.
    """
    del X, y
    return lambda new: new.sum(axis=1), 0.0


def median_width(mines: FloatArray) -> float:
    """Return the γ of a kernel that is 1/e for two mines at their median distance.

    The distances are those of all pairs of standardised mines.
    """
    return float(1 / np.median(pdist(StandardScaler().fit_transform(mines), "sqeuclidean")))


def one_class(
    settings: Classify, kind: str = NOVELTY_RIVALS[0], gamma: float | None = None
) -> Classifier:
    """Return a novelty detector for the training mines alone.

    Parameters
    ----------
    settings : Classify
        Its ``p0``.
    kind : str
        One of ``NOVELTY_RIVALS``.
    gamma : float, optional
        γ of its kernel, if it has one; by default that of :func:`median_width`.

    Raises
    ------
    ValueError
        If there is no such detector.
    """
    if kind not in NOVELTY_RIVALS:
        raise ValueError(f"kind must be one of {', '.join(NOVELTY_RIVALS)}, got {kind!r}")

    def fit(X: FloatArray, y: BoolArray) -> tuple[Scorer, float]:
        mines = X[y]
        if kind == "gmm":
            return GaussianMixtureNovelty(random_state=0).fit(mines).score_samples, 1.0
        width = median_width(mines) if gamma is None else gamma
        if kind == "svm":
            return _train(partial(OneClassSVM, nu=0.1, gamma=width), mines)
        machine = OneClassRelevanceVectorMachine(
            gamma=width,
            prior="laplacian-map",
            p0=settings.p0,
            formulation=cast("Any", kind.removeprefix("rvm, ")),
            random_state=0,
        ).fit(mines)
        return machine.score_samples, len(machine.relevance_) / len(mines)

    return fit


@dataclass(frozen=True)
class HeldOut:
    """Scores of examples by classifiers that have not seen them."""

    mine: FloatArray  #: (n,) scores of the mines; -inf for one that a prescreener lost
    #: (m, repeats) scores of the clutter; a novelty detector scores it in every fold (par. 52)
    clutter: FloatArray
    target: AnyArray  #: (n,) name of the mine of each score
    tile: AnyArray  #: (m,) name of each clutter example
    vector_share: FloatArray  #: (fold,) share of the training examples that are vectors

    def of_mines(self, rows: BoolArray) -> HeldOut:
        """Return the scores of some of the mines, and of all clutter."""
        return replace(self, mine=self.mine[rows], target=self.target[rows])


def held_out(
    examples: Examples, classifier: Classifier, folds: int, novelty: bool = False
) -> HeldOut:
    """Score every example by a classifier trained without its mine.

    All looks at the mine are left out together.

    Parameters
    ----------
    examples : Examples
        The examples.
    classifier : Classifier
        What is trained.
    folds : int
        Number of groups that the mines are dealt to.
    novelty : bool
        Whether it is a novelty detector, which scores all clutter in every fold.
    """
    groups = _mine_groups(examples, folds)
    return _scores(examples, [(classifier, one.train, one.test) for one in groups], novelty)


def leave_one_out(
    examples: Examples, classifier: Classifier, folds: int, novelty: bool = False
) -> HeldOut:
    """Score every example by a classifier trained on all the others (par. 38 and 45).

    A novelty detector leaves one mine out at a time and scores all clutter each time: N_o · N_c
    outputs (par. 52). The second look at a mine stays among the training examples, as in the paper;
    :func:`held_out` takes it out as well. The kernel of a fold is chosen without the group of mines
    and clutter that its example is in: the paper does not say how its kernels were chosen, and
    choosing anew for every example costs sixty times the training.

    Parameters
    ----------
    examples, classifier, novelty
        As of :func:`held_out`.
    folds : int
        Number of groups that the mines are dealt to, for the choice of the kernels.
    """
    every = np.arange(len(examples.table))
    singles: list[Fold] = []
    for group in _mine_groups(examples, folds):
        chosen = classifier
        if isinstance(classifier, TunedClassifier):
            chosen = classifier.choose(examples.X[group.train], examples.is_mine[group.train])
        singles += [(chosen, every[every != n], every[n : n + 1]) for n in group.test]
    return _scores(examples, singles, novelty)


def across(train: Examples, test: Examples, classifier: Classifier) -> HeldOut:
    """Train on the examples of one site and test on those of the other (par. 39)."""
    table = pd.concat([train.table, test.table], ignore_index=True)
    both = Examples(table, np.concatenate([train.X, test.X]))
    training, tested = np.split(np.arange(len(table)), [len(train.table)])
    return _scores(both, [(classifier, training, tested)])


def _scores(examples: Examples, folds: Sequence[Fold], novelty: bool = False) -> HeldOut:
    """Score the test examples of every fold by what its classifier learns from the others."""
    X, y = examples.X, examples.is_mine
    score = np.full(len(y), np.nan)
    shares = {}
    clutter_scores = []
    for classifier, train, test in folds:
        if novelty and not y[test].any():
            continue
        scorer, shares[int(test[0])] = classifier(X[train], y[train])
        score[test] = scorer(X[test])
        if novelty:
            clutter_scores.append(scorer(X[~y]))
    is_scored = ~np.isnan(score)
    clutter = np.stack(clutter_scores, axis=1) if novelty else score[~y & is_scored][:, None]
    return HeldOut(
        mine=score[y & is_scored],
        clutter=clutter,
        target=examples.names(y & is_scored),
        tile=np.arange(len(clutter)).astype(str),
        vector_share=np.array([shares[first] for first in sorted(shares)]),
    )


def retrained(examples: Examples, classifier: Classifier, folds: int, draws: int) -> FloatArray:
    """Return the area under the ROC (draw,) with mines and clutter drawn anew.

    The classifier is trained on what was drawn. Looks at one mine are drawn together, and all
    copies of an example are held out together.

    Parameters
    ----------
    examples, classifier, folds
        As of :func:`held_out`.
    draws : int
        Number of bootstrap draws.
    """
    rng = np.random.default_rng(0)
    X, y = examples.X, examples.is_mine
    targets = examples.names(np.ones(len(y), np.bool_))
    looks_of_mine = [np.flatnonzero(targets == name) for name in np.unique(targets[y])]
    clutter = np.flatnonzero(~y)
    areas = []
    for _ in range(draws):
        drawn_mines = rng.integers(len(looks_of_mine), size=len(looks_of_mine))
        drawn_looks = [looks_of_mine[number] for number in drawn_mines]
        rows = np.concatenate([*drawn_looks, rng.choice(clutter, len(clutter))])
        names = np.where(y[rows], targets[rows], np.char.add("clutter ", rows.astype(str)))
        group = np.unique(names, return_inverse=True)[1]
        fold = rng.permutation(group.max() + 1) % folds
        score = np.full(len(rows), np.nan)
        for k in range(folds):
            is_test = fold[group] == k
            scorer, _ = classifier(X[rows][~is_test], y[rows][~is_test])
            score[is_test] = scorer(X[rows][is_test])
        areas.append(roc_auc_score(y[rows], score))
    return np.array(areas)


def with_lost(scores: HeldOut, passed: pd.DataFrame, offered: pd.DataFrame) -> HeldOut:
    """Return scores with the mines that the prescreeners lost, which no threshold finds.

    Parameters
    ----------
    scores : HeldOut
        Scores of the looks that passed the prescreeners.
    passed : DataFrame
        A row per scored look, with ``target`` and ``direction``.
    offered : DataFrame
        A row per mine and drive, with the same columns.
    """
    passed_looks = zip(passed["target"], passed["direction"], strict=True)
    score_of_look = dict(zip(passed_looks, scores.mine, strict=True))
    offered_looks = zip(offered["target"], offered["direction"], strict=True)
    mine_scores = [score_of_look.get(look, -np.inf) for look in offered_looks]
    target = offered["target"].to_numpy(dtype=str)
    return replace(scores, mine=np.array(mine_scores), target=target)


def _mine_groups(examples: Examples, folds: int) -> list[Split]:
    """Return the folds, in which all looks at a mine are together."""
    mines = np.unique(examples.names(examples.is_mine))
    return splits(examples.table, "target", folds=min(folds, len(mines)))
