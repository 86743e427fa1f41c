"""The forward search of Wang et al. 2007 against refitting every candidate."""

import math

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from flgpr.detect import (
    FisherDiscriminant,
    HistogramNormalizer,
    forward_search,
    make_fold,
    single_features,
)


@pytest.fixture
def data():
    rng = np.random.default_rng(2)
    label = (rng.random(240) < 0.2).astype(int)
    X = rng.normal(size=(240, 6)) @ rng.normal(size=(6, 6)) + 0.7 * label[:, None] * rng.normal(
        size=6
    )
    return (
        np.exp(0.5 * X),
        label,
        np.where(label, rng.integers(1, 9, 240), 1),
        np.repeat(np.arange(3), 80),
    )


def scorer_of(label):
    """Area under the ROC, ties counted half: cheap and obvious."""

    def score(confidence):
        gap = np.sign(confidence[label == 1][:, None] - confidence[label == 0])
        return float((gap + 1).mean() / 2)

    return score


@pytest.mark.parametrize("cross", [False, True])
def test_the_search_equals_refitting_every_candidate(data, cross):
    X, label, weight, lane = data
    parts = [(lane != k, lane == k) for k in range(3)] if cross else [(lane >= 0, lane >= 0)]
    folds = [make_fold(X, label, weight, train, test) for train, test in parts]
    found = forward_search(folds, len(X), scorer_of(label))
    chosen = []
    for step in found:
        trial = {}
        for j in set(range(6)) - set(chosen):
            confidence = np.zeros(len(X))
            for train, test in parts:
                columns = [*chosen, j]
                model = make_pipeline(HistogramNormalizer(), FisherDiscriminant())
                model.fit(
                    X[train][:, columns], label[train],
                    histogramnormalizer__sample_weight=weight[train],
                    fisherdiscriminant__sample_weight=weight[train],
                )  # fmt: skip
                normal = clone(model[0]).fit(X[train][:, columns], sample_weight=weight[train])
                confidence[test] = normal.transform(X[test][:, columns]) @ model[1].direction_
            trial[j] = scorer_of(label)(confidence)
            if j == step.feature:
                np.testing.assert_allclose(step.confidence, confidence, rtol=1e-6, atol=1e-9)
        assert step.score == pytest.approx(max(trial.values()), abs=1e-12)
        chosen.append(step.feature)
    assert sorted(chosen) == list(range(6))


def test_a_single_feature_ranks_alike_with_and_without_duplication(data):
    X, label, weight, _ = data
    everything = np.ones(len(X), bool)
    with_, without = (
        single_features([make_fold(X, label, w, everything)], len(X), scorer_of(label))
        for w in (weight, 0 * weight + 1)
    )
    higher = np.maximum(with_, 1 - with_)
    np.testing.assert_allclose(higher, np.maximum(without, 1 - without), atol=1e-12)


def test_a_repeated_feature_adds_nothing_to_the_search(data):
    X, label, weight, _ = data
    X = np.column_stack([X[:, :2], X[:, 0]])
    found = forward_search(
        [make_fold(X, label, weight, np.ones(len(X), bool))], len(X), scorer_of(label)
    )
    assert all(np.isfinite(step.confidence).all() for step in found)
    last_two = {found[1].feature, found[2].feature} & {0, 2}
    assert last_two
    assert math.isclose(found[2].score, found[1].score) or found[2].feature == 1


def test_what_cannot_be_searched_is_refused():
    with pytest.raises(ValueError, match="at least one fold"):
        forward_search([], 3, len)
    with pytest.raises(ValueError, match="both classes"):
        make_fold([[1.0], [2.0]], [1, 1], [1, 1], [True, True])
