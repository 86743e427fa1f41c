"""Fisher's discriminant, the histogram normaliser and duplication of Wang et al. 2007."""

import numpy as np
import pytest
import sklearn
from scipy.stats import norm
from sklearn.utils.estimator_checks import parametrize_with_checks

from flgpr.detect import (
    FisherDiscriminant,
    HistogramNormalizer,
    hit_weights,
)
from reference import wang2007

SCIKIT_LEARN = tuple(int(part) for part in sklearn.__version__.split(".")[:2])


def wrong_checks(estimator):
    """scikit-learn's checks that are wrong.

    To compare weights with repetitions, those before 1.7 make two classes of three: the label that
    stands first, and all others. Samples with weights are shuffled, and so the two fits that are
    compared get different classes. `test_weights_equal_repetitions_where_samples_are_few` gives them
    the same ones.
    """
    if isinstance(estimator, FisherDiscriminant) and SCIKIT_LEARN < (1, 7):
        return {"check_sample_weight_equivalence_on_dense_data": "it compares different classes"}
    return {}


@parametrize_with_checks(
    [FisherDiscriminant(), HistogramNormalizer()], expected_failed_checks=wrong_checks
)
def test_estimators_pass_the_checks_of_scikit_learn(estimator, check):
    check(estimator)


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


def test_two_alarms_share_a_target_as_equation_19_says():
    assert hit_weights([0, 0, -1], [0.2, 0.9, np.nan], 100).tolist() == [68, 32, 1]
    np.testing.assert_allclose(wang2007.equation_19_w([0.2, 0.9], 1.0), (0.68, 0.32), atol=0.005)


def test_weights_are_equations_18_and_19():
    rng = np.random.default_rng(1)
    target = rng.integers(-1, 5, 60)
    distance = rng.random(60)
    beta = np.where(target % 2, 0.5, 1.0)
    want = wang2007.equation_18_weights(target, distance, 30.0, beta, 0.8)
    assert hit_weights(target, distance, 30.0, beta, 0.8).tolist() == want
    assert hit_weights(target, distance, 0.01).tolist() == [1] * 60
    assert hit_weights([], [], 30).size == 0


def test_normalised_training_values_follow_the_cut_off_normal_distribution():
    values = np.exp(np.random.default_rng(0).normal(size=(501, 1)))
    b = np.sort(HistogramNormalizer().fit_transform(values)[:, 0])
    assert (b[0], b[-1]) == (pytest.approx(-1), pytest.approx(1))
    np.testing.assert_allclose(
        b, [wang2007.normalised_b(k, 501) for k in range(1, 502)], atol=1e-12
    )
    # Kolmogorov-Smirnov against the target distribution: exact but for the step of the empirical
    # one.
    cdf = (norm.cdf(b) - norm.cdf(-1)) / (norm.cdf(1) - norm.cdf(-1))
    assert np.abs(cdf - np.arange(501) / 500).max() < 1e-9


def test_ties_share_the_mean_and_the_ends_go_on_straight():
    model = HistogramNormalizer().fit([[0.0], [1.0], [3.0]], sample_weight=[1, 3, 1])
    b = [wang2007.normalised_b(k, 5) for k in range(1, 6)]
    np.testing.assert_allclose(
        model.transform([[0], [1], [3]])[:, 0], [b[0], np.mean(b[1:4]), b[4]], atol=1e-12
    )
    assert model.transform([[5.0]]).item() == pytest.approx(b[4] + (b[4] - np.mean(b[1:4])) / 2 * 2)
    assert model.transform([[-1.0]]).item() == pytest.approx(b[0] - (np.mean(b[1:4]) - b[0]))
    assert HistogramNormalizer().fit([[2.0], [2.0]]).transform([[7.0]]).item() == pytest.approx(0)


def test_the_direction_is_equation_20(data):
    X, label, weight, _ = data
    got = FisherDiscriminant().fit(X, label, sample_weight=weight).direction_
    np.testing.assert_allclose(
        got, wang2007.equation_20_direction(np.repeat(X, weight, 0), np.repeat(label, weight))
    )


def test_weights_equal_literal_duplication(data):
    X, label, weight, _ = data
    fits = []
    for rows, w in ((np.arange(240), weight), (np.repeat(np.arange(240), weight), None)):
        normalizer = HistogramNormalizer().fit(X[rows], sample_weight=w)
        model = FisherDiscriminant().fit(
            normalizer.transform(X[rows]), label[rows], sample_weight=w
        )
        fits.append(model.decision_function(normalizer.transform(X)))
    np.testing.assert_allclose(fits[0], fits[1], rtol=1e-9, atol=1e-12)


def test_weights_equal_repetitions_where_samples_are_few():
    """With fewer samples than features, weights of zero, and the samples in another order."""
    rng = np.random.default_rng(42)
    X = rng.random((15, 30))
    label = np.arange(15) % 2
    weight = rng.integers(0, 5, 15)
    order = rng.permutation(15)
    weighted = FisherDiscriminant().fit(X[order], label[order], sample_weight=weight[order])
    repeated = FisherDiscriminant().fit(np.repeat(X, weight, axis=0), np.repeat(label, weight))
    np.testing.assert_allclose(
        weighted.decision_function(X), repeated.decision_function(X), rtol=1e-9, atol=1e-12
    )


def test_scores_do_not_depend_on_the_units_of_features(data):
    X, label, _, _ = data
    a, b = (
        FisherDiscriminant().fit(X * s, label).decision_function(X * s)
        for s in (1.0, 10.0 ** np.arange(-9, 9, 3))
    )
    np.testing.assert_allclose(a, b, rtol=1e-8)


def test_constant_and_repeated_features_take_no_part(data):
    X, label, _, _ = data
    plain = FisherDiscriminant().fit(X, label).decision_function(X)
    more = np.column_stack([X, X[:, 0], np.full(len(X), 3.0)])
    np.testing.assert_allclose(
        FisherDiscriminant().fit(more, label).decision_function(more), plain, rtol=1e-6
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: hit_weights([0], [0.1, 0.2], 30), "one entry per alarm"),
        (lambda: hit_weights([0], [np.nan], 30), "distance"),
        (lambda: hit_weights([0], [0.1], -1), "w0"),
        (
            lambda: HistogramNormalizer().fit([[0.0], [1.0]], sample_weight=[0.5, 1]),
            "whole numbers",
        ),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(ValueError, match=words):
        call()
