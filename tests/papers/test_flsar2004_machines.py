"""Classifiers and the scores of examples that they have not seen."""

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LogisticRegression

from flgpr.detect import RelevanceVectorClassifier
from flgpr_papers.flsar2004 import findings as fi
from flgpr_papers.flsar2004 import machines as ma
from flgpr_papers.flsar2004.lanes import load_settings

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture(scope="module")
def settings():
    return load_settings()


def scores_of(mine, clutter, target=None):
    mine = np.asarray(mine, float)
    clutter = np.asarray(clutter, float)
    clutter = clutter[:, None] if clutter.ndim == 1 else clutter
    target = np.arange(len(mine)).astype(str) if target is None else np.asarray(target)
    return ma.HeldOut(mine, clutter, target, np.arange(len(clutter)).astype(str), np.ones(1))


def some_examples(seed=0, mines=20, clutter=60):
    rng = np.random.default_rng(seed)
    y = np.arange(mines + clutter) < mines
    target = np.where(y, (np.arange(y.size) // 2).astype(str), "")
    table = pd.DataFrame({"kind": np.where(y, "metal", "clutter"), "target": target})
    return table, rng.normal(size=(y.size, 3)) + 1.5 * y[:, None]


def test_both_machines_have_one_kernel_and_the_papers_prior(settings, monkeypatch):
    (table, X), machines = some_examples(), []

    class Kept(RelevanceVectorClassifier):
        def fit(self, X, y):
            machines.append(self)
            return super().fit(X, y)

    monkeypatch.setattr(ma, "RelevanceVectorClassifier", Kept)
    y = (table["kind"] != "clutter").to_numpy()
    ma.rvm(settings.classify)(X, y)
    chosen = ma.search_svm(settings.classify, "rbf", X, y)[-1]
    assert [one.prior for one in machines] == ["laplacian-map"]
    assert machines[0].gamma == chosen.gamma
    machines.clear()
    ma.evidence_rvm(settings.classify)(X, y)
    assert {one.prior for one in machines} == {"ard"}
    assert len(machines) == len(settings.classify.widths) + 1


def test_the_width_of_a_novelty_detector_is_that_of_the_median_pair():
    X = np.random.default_rng(3).normal(size=(40, 6)) * [1, 2, 3, 4, 5, 6]
    Z = (X - X.mean(axis=0)) / X.std(axis=0)
    distance = ((Z[:, None] - Z) ** 2).sum(axis=2)[np.triu_indices(40, 1)]
    assert ma.median_width(X) == pytest.approx(1 / np.median(distance))


def test_training_anew_in_every_draw_holds_copies_out_together():
    table, X = some_examples()

    def memory(
        train, y
    ):  # remembers every example: it would give itself away if a copy were tested
        known = {tuple(row): float(label) for row, label in zip(train, y, strict=True)}
        return (lambda new: np.array([known.get(tuple(row), 0.5) for row in new])), 1.0

    np.testing.assert_allclose(ma.retrained(ma.Examples(table, X), memory, 5, 4), 0.5)

    def fisher(train, y):
        return LogisticRegression().fit(train, y).decision_function, 1.0

    drawn = ma.retrained(ma.Examples(table, X), fisher, 5, 30)
    assert 0.7 < drawn.mean() < 1.0
    assert drawn.std() > 0.005


def test_mines_that_the_prescreener_lost_are_found_at_no_threshold():
    one = scores_of([3.0, 2.0], [1.0, 0.5, 0.1], ["a", "b"])
    seen = pd.DataFrame({"target": ["a", "b"], "direction": ["out", "back"]})
    offered = pd.DataFrame({"target": ["a", "a", "b", "b"], "direction": ["out", "back"] * 2})
    every = ma.with_lost(one, seen, offered)
    assert every.mine.tolist() == [3.0, -np.inf, -np.inf, 2.0]
    assert fi.Measure(1.0, 0.0 + 1e-9, at=True).value(every) == 0.5
    assert (
        fi.Measure(1.0, 100.0, at=True).value(every) == 0.5
    )  # however many false alarms are allowed
    assert fi.Measure(1.0, 100.0).value(every) == pytest.approx(0.5)


def test_one_class_machines_are_told_apart(settings):
    table, X = some_examples()
    y = (table["kind"] != "clutter").to_numpy()
    scores = {name: ma.one_class(settings.classify, name)(X, y)[0](X) for name in ma.NOVELTY_RIVALS}
    assert len({tuple(np.round(one, 9)) for one in scores.values()}) == len(ma.NOVELTY_RIVALS)
    with pytest.raises(ValueError, match="kind must be one of"):
        ma.one_class(settings.classify, "rvm")
    np.testing.assert_allclose(ma.sum_of_correlations(X, y)[0](X), X.sum(axis=1))
