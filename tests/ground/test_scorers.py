"""What is taken out of a trained estimator scores as the estimator does, whatever its options."""

import numpy as np
import pytest
from pyod.models.copod import COPOD
from pyod.models.ecod import ECOD
from pyod.models.knn import KNN
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import HistGradientBoostingClassifier, IsolationForest, RandomForestClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.svm import SVC, OneClassSVM

from flgpr.detect import (
    GaussianMixtureNovelty,
    MultipleKernelClassifier,
    OneClassRelevanceVectorMachine,
    RelevanceVectorClassifier,
)
from flgpr.detect.estimator_table import scorer_class

FEATURES = 3


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(12)
    X = np.concatenate([rng.normal(0, 1, (90, FEATURES)), rng.normal(1.5, 1.2, (40, FEATURES))])
    X[:, 2] = np.round(X[:, 2])  # equal values
    y = np.repeat([0, 1], [90, 40])
    return X, y, np.concatenate([rng.normal(0.5, 2, (200, FEATURES)), X[:20], [[50.0, -50.0, 0.0]]])


def log_odds(estimator, X):
    p = estimator.predict_proba(X)[:, 1]
    return np.log(np.maximum(p, 1e-12)) - np.log(np.maximum(1 - p, 1e-12))


def decision(estimator, X):
    return estimator.decision_function(X)


TWO_CLASSES = {
    "svm": [
        SVC(),
        *(
            SVC(kernel=k, gamma=g, C=3.0, coef0=0.5)
            for k in ("linear", "poly", "sigmoid", "rbf")
            for g in ("auto", 0.2)
        ),
        SVC(class_weight="balanced", degree=2, kernel="poly"),
    ],
    "mkl": [
        MultipleKernelClassifier(),
        MultipleKernelClassifier(groups=(2, 1), C=3.0, class_weight="balanced", gamma=0.3),
    ],
    "rvm": [
        RelevanceVectorClassifier(),
        RelevanceVectorClassifier(moderated=False, bias=False),
        *(
            RelevanceVectorClassifier(kernel=k, gamma=0.3, n_starts=1)
            for k in ("laplacian", "linear", "poly", "sigmoid")
        ),
    ],
    "logistic": [LogisticRegression(), LogisticRegression(class_weight="balanced", C=0.1)],
    "lda": [
        LinearDiscriminantAnalysis(),
        LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
    ],
    "random-forest": [
        RandomForestClassifier(20, random_state=0),
        RandomForestClassifier(
            20, class_weight="balanced", max_leaf_nodes=9, min_samples_leaf=3, random_state=1
        ),
    ],
    "gradient-boosting": [
        HistGradientBoostingClassifier(max_iter=30),
        HistGradientBoostingClassifier(max_iter=9, max_leaf_nodes=4, class_weight="balanced"),
    ],
}
ONE_CLASS = {
    "one-class-svm": [OneClassSVM(), OneClassSVM(kernel="poly", nu=0.2, coef0=1.0)],
    "one-class-rvm": [
        OneClassRelevanceVectorMachine(),
        OneClassRelevanceVectorMachine(standardize=False, kernel="laplacian"),
        OneClassRelevanceVectorMachine(formulation="reference", random_state=0),
    ],
    "mixture": [
        GaussianMixtureNovelty(covariance_type=c, random_state=0)
        for c in ("full", "tied", "diag", "spherical")
    ],
    "isolation-forest": [
        IsolationForest(n_estimators=20, random_state=0),
        IsolationForest(
            n_estimators=20, max_samples=17, max_features=2, contamination=0.1, random_state=1
        ),
    ],
    "ecod": [ECOD(), ECOD(contamination=0.3)],
    "copod": [COPOD()],
    "knn": [
        KNN(),
        KNN(n_neighbors=3, method="mean"),
        KNN(method="median", p=1),
        KNN(metric="chebyshev"),
        KNN(metric="euclidean"),
        KNN(metric="manhattan", n_neighbors=7),
        KNN(p=3),
    ],
}
CASES = [
    (name, one)
    for table in (TWO_CLASSES, ONE_CLASS)
    for name, several in table.items()
    for one in several
]


@pytest.mark.parametrize(
    ("name", "estimator"), CASES, ids=[f"{name}-{k}" for k, (name, _) in enumerate(CASES)]
)
def test_scores_are_the_estimators_own(samples, name, estimator):
    X, y, asked = samples
    fitted = estimator.fit(X, y) if name in TWO_CLASSES else estimator.fit(X[y == 0])
    scorer = scorer_class(name).of(fitted)
    want = (log_odds if name == "random-forest" else decision)(fitted, asked)
    np.testing.assert_allclose(scorer(asked), want, rtol=1e-9, atol=1e-9)
    again = scorer_class(name).restored(scorer.settings(), scorer.arrays(), FEATURES)
    np.testing.assert_array_equal(again(asked), scorer(asked))
    assert scorer(asked[:0]).shape == (0,)
    assert scorer.threshold == pytest.approx(getattr(fitted, "threshold_", 0.0))


@pytest.mark.parametrize(
    ("name", "estimator", "told"),
    [
        ("svm", SVC(kernel=lambda a, b: a @ b.T), "kernel must be one of linear"),
        ("one-class-svm", OneClassSVM(kernel="precomputed"), "kernel must be one of linear"),
        (
            "rvm",
            RelevanceVectorClassifier(kernel=lambda a, b: a @ b.T),
            "kernel must be one of linear",
        ),
        ("knn", KNN(metric="canberra", algorithm="auto"), "metric must be one of minkowski"),
        ("random-forest", RandomForestClassifier(3), "must part two classes"),
        ("gradient-boosting", HistGradientBoostingClassifier(max_iter=3), "must part two classes"),
        ("logistic", LogisticRegression(), "must part two classes"),
    ],
)
def test_what_cannot_be_kept_is_refused(samples, name, estimator, told):
    X, y, _ = samples
    three = np.arange(len(y)) % 3
    if "classes" in told:
        fitted = estimator.fit(X, three)
    elif name == "knn":
        fitted = estimator.fit(X)
    elif name == "one-class-svm":
        fitted = estimator.fit(X @ X.T)
    else:
        fitted = estimator.fit(X, y)
    with pytest.raises(ValueError, match=told):
        scorer_class(name).of(fitted)
