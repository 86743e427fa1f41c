"""The deflection-optimal detector against Cosgrove et al. 2004."""

import numpy as np
import pytest

from flgpr.clutter import ClutterWhitener, whitening_matrix
from flgpr.detect import DeflectionDetector, NeymanPearsonDetector, deflection_form
from flgpr.kernels.moments import _ogk_distance
from reference.cosgrove2004 import (
    circular,
    deflection,
    equation_4,
    equations_7_to_12,
    ogk_distances,
)


@pytest.fixture
def rng():
    return np.random.default_rng(2004)


def moments(rng, n=6, rank=2, level=1.5):
    mu = level * (rng.normal(size=n) + 1j * rng.normal(size=n)) / np.sqrt(2)
    factor = (rng.normal(size=(n, rank)) + 1j * rng.normal(size=(n, rank))) / np.sqrt(2)
    return mu, factor @ factor.conj().T


def matrix_of(form):
    return (form.vectors.T * form.strength) @ form.vectors.conj()


def test_form_for_known_moments_is_equation_5(rng):
    mu, C = moments(rng)
    form = deflection_form(mu, C)
    X = circular(rng, mu, C + np.eye(6), 20)
    expected = [equation_4(x, C + np.outer(mu, mu.conj()), mu) for x in X]
    assert np.allclose(form(X), expected)


def test_deflection_is_norm_of_a_squared_plus_twice_that_of_b(rng):
    mu, C = moments(rng)
    A = C + np.outer(mu, mu.conj())
    theory = np.linalg.norm(A) ** 2 + 2 * np.linalg.norm(mu) ** 2
    form = deflection_form(mu, C)
    count = 200_000
    under = circular(rng, np.zeros(6), np.eye(6), count), circular(rng, mu, C + np.eye(6), count)
    t0 = form(under[0])
    t1 = form(under[1])
    gain = t1.mean() - t0.mean()
    variance = t0.var()
    # Error of gain²/variance from those of the two means and of the variance.
    error_gain = np.sqrt((t0.var() + t1.var()) / count)
    error_variance = np.std((t0 - t0.mean()) ** 2) / np.sqrt(count)
    measured = gain**2 / variance
    error = measured * np.hypot(2 * error_gain / gain, error_variance / variance)
    assert abs(measured - theory) < 4 * error
    assert error < 0.05 * theory
    assert deflection(A, mu, mu, C) == pytest.approx(theory)


@pytest.mark.parametrize("gamma", [1.0, 0.7, 0.3, 0.0])
def test_no_form_near_by_has_a_higher_generalised_deflection(rng, gamma):
    mu, C = moments(rng)
    form = deflection_form(mu, C, gamma)
    A = matrix_of(form)
    b = form.linear
    best = deflection(A, b, mu, C, gamma)
    for _ in range(50):
        dA = rng.normal(size=A.shape) + 1j * rng.normal(size=A.shape)
        db = rng.normal(size=b.size) + 1j * rng.normal(size=b.size)
        step = 1e-2 * np.linalg.norm(A)
        assert (
            deflection(A + step * (dA + dA.conj().T) / 20, b + step * db / 5, mu, C, gamma) < best
        )
    other = deflection(C + np.outer(mu, mu.conj()), mu, mu, C, gamma)
    assert best == pytest.approx(other) if gamma == 1 else best > 1.01 * other


def test_generalised_deflection_is_that_of_gaussian_data(rng):
    mu, C = moments(rng, level=0.8)
    form = deflection_form(mu, C, 0.4)
    count = 100_000
    t0 = form(circular(rng, 0 * mu, np.eye(6), count))
    t1 = form(circular(rng, mu, C + np.eye(6), count))
    measured = (t1.mean() - t0.mean()) ** 2 / (0.4 * t0.var() + 0.6 * t1.var())
    assert measured == pytest.approx(deflection(matrix_of(form), form.linear, mu, C, 0.4), rel=0.05)


def test_training_follows_equations_7_to_12(rng):
    mu, C = moments(rng, n=8)
    examples = circular(rng, mu, C + np.eye(8), 5)
    X = circular(rng, 0 * mu, np.eye(8), 7)
    for rank, ddof in [(1, 0), (3, 0), (2, 1)]:
        detector = DeflectionDetector(rank, ddof).fit(examples)
        expected = [equations_7_to_12(x, examples, rank, ddof) for x in X]
        assert np.allclose(detector.decision_function(X), expected)


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_estimate_with_ddof_0_is_unbiased_and_the_papers_is_not(rng):
    mu, C = moments(rng, n=3)
    truth = np.trace(C).real + np.linalg.norm(mu) ** 2
    total = {0: [], 1: []}
    for _ in range(4000):
        examples = circular(rng, mu, C + np.eye(3), 6)
        for ddof, traces in total.items():
            traces.append(DeflectionDetector(ddof=ddof).fit(examples).eigenvalues_.sum())
    error = np.std(total[0]) / np.sqrt(4000)
    assert abs(np.mean(total[0]) - truth) < 4 * error
    assert np.mean(total[1]) - truth == pytest.approx((truth + 3) / 5, abs=5 * error)


def test_linear_part_alone_is_the_matched_filter(rng):
    mu, C = moments(rng)
    examples = circular(rng, mu, C + np.eye(6), 40)
    X = circular(rng, 0 * mu, np.eye(6), 10)
    scores = DeflectionDetector(rank=0).fit(examples).decision_function(X)
    assert np.allclose(scores, 2 * (X @ examples.mean(axis=0).conj()).real)


def test_without_covariance_the_form_is_not_the_matched_filter(rng):
    mu, _ = moments(rng)
    form = deflection_form(mu, np.zeros((6, 6)))
    X = circular(rng, 0 * mu, np.eye(6), 10)
    assert np.allclose(form(X), np.abs(X @ mu.conj() + 1) ** 2 - 1)


def test_scores_do_not_depend_on_the_whitening_basis(rng):
    n = 6
    _, clutter = moments(rng, n, rank=n)
    mean = rng.normal(size=n) + 1j * rng.normal(size=n)
    mu, C = moments(rng, n)
    raw = circular(rng, mean, clutter, 400)
    examples, X = (circular(rng, mean + mu, clutter + C, count) for count in (9, 20))
    scores = {}
    for basis in ("eigen", "cholesky", "symmetric"):
        whitener = ClutterWhitener(basis=basis).fit(raw)
        detector = DeflectionDetector().fit(whitener.transform(examples))
        scores[basis] = detector.decision_function(whitener.transform(X))
        folded = detector.forms_[0].after(whitener.mean_, whitener.matrix_)
        assert np.allclose(folded(X), scores[basis])
    assert np.allclose(scores["eigen"], scores["cholesky"])
    assert np.allclose(scores["eigen"], scores["symmetric"])
    assert not np.allclose(
        whitening_matrix(clutter, "eigen"), whitening_matrix(clutter, "cholesky")
    )


def test_directions_without_examples_are_counted_and_not_used(rng):
    examples = circular(rng, np.ones(10), 2 * np.eye(10), 4)
    detector = DeflectionDetector(rank=None).fit(examples)
    assert detector.n_unseen_ == 6
    assert np.array_equal(detector.eigenvalues_[4:], np.full(6, -1.0))
    assert (detector.eigenvalues_[:4] > -1).all()
    assert detector.forms_[0].rank == 4
    away = np.linalg.svd(examples)[2][4:]  # rows orthogonal to every example
    assert np.allclose(detector.decision_function(away), 0)
    assert (
        DeflectionDetector(rank=None).fit(circular(rng, np.ones(10), np.eye(10), 30)).n_unseen_ == 0
    )


def test_positive_projection_drops_negative_eigenvalues(rng):
    examples = circular(rng, np.zeros(6), np.eye(6), 12)
    plain, positive = (DeflectionDetector(None, positive=p).fit(examples) for p in (False, True))
    values = plain.eigenvalues_
    assert (values < 0).any()
    assert np.array_equal(positive.forms_[0].strength, values[values > 0])


def test_separate_classes_score_by_the_better_form(rng):
    a = np.eye(8)[0] * 6
    b = np.eye(8)[5] * 1.5
    examples = np.concatenate([circular(rng, a, np.eye(8), 30), circular(rng, b, np.eye(8), 30)])
    labels = np.repeat(["metal", "plastic"], 30)
    detector = DeflectionDetector(classes="separate").fit(examples, labels)
    assert list(detector.labels_) == ["metal", "plastic"]
    clutter = circular(rng, 0 * a, np.eye(8), 50_000)
    for form in detector.forms_:
        value = form(clutter)
        # In the span of the examples a form's vectors are orthonormal, so it is standard on white
        # clutter.
        assert abs(value.mean()) < 4 / np.sqrt(50_000)
        assert value.var() == pytest.approx(1, abs=0.1)
    assert np.array_equal(
        detector.decision_function(examples),
        np.maximum(*(form(examples) for form in detector.forms_)),
    )
    with pytest.raises(ValueError, match="y must hold a class"):
        DeflectionDetector(classes="separate").fit(examples)


@pytest.mark.parametrize("moments_name", ["ledoit-wolf", "oas", "clipped", "ogk"])
def test_other_estimators_come_near_the_truth_with_many_examples(rng, moments_name):
    mu, C = moments(rng, n=4, level=3)
    detector = DeflectionDetector(moments=moments_name).fit(circular(rng, mu, C + np.eye(4), 4000))
    found = detector.forms_[0].vectors[0]
    wanted = np.linalg.eigh(C + np.outer(mu, mu.conj()))[1][:, -1]
    assert abs(found.conj() @ wanted) > 0.99


def test_clipped_training_resists_one_giant(rng):
    mu = np.eye(6)[0] * 4
    examples = circular(rng, mu, np.eye(6), 20)
    examples[3] = 500 * np.eye(6)[4]
    plain, clipped = (DeflectionDetector(1, moments=m).fit(examples) for m in ("sample", "clipped"))
    assert abs(plain.forms_[0].vectors[0, 4]) > 0.99
    assert abs(clipped.forms_[0].vectors[0, 0]) > 0.9


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"rank": -1}, "rank"),
        ({"ddof": -1}, "ddof"),
        ({"ddof": 9}, "ddof"),
        ({"gamma": 1.5}, "gamma"),
        ({"moments": "guess"}, "moments"),
        ({"classes": "many"}, "classes"),
    ],
)
def test_bad_parameters_are_named(rng, parameters, message):
    with pytest.raises(ValueError, match=message):
        DeflectionDetector(**parameters).fit(rng.normal(size=(9, 4)))


def test_orthogonal_pairs_resist_outliers_with_fewer_examples_than_features(rng):
    mu = np.eye(24)[0] * 6
    examples = circular(rng, mu, np.eye(24), 16)
    examples[[3, 9]] += 300 * np.eye(24)[4]
    plain, robust = (DeflectionDetector(1, moments=m).fit(examples) for m in ("sample", "ogk"))
    assert abs(plain.forms_[0].vectors[0, 4]) > 0.99
    assert abs(robust.forms_[0].vectors[0, 0]) > 0.9
    assert robust.n_unseen_ >= 24 - 14  # what was left out reaches nothing


def test_orthogonal_pairs_find_the_slow_twins_outliers(rng):
    rows = rng.normal(size=(30, 5)) @ rng.normal(size=(5, 5))
    rows[:4] += 40
    assert np.allclose(_ogk_distance(rows), ogk_distances(rows))


def test_a_column_without_spread_has_no_robust_scale(rng):
    examples = rng.normal(size=(9, 3))
    examples[:6, 1] = 2.0
    with pytest.raises(ValueError, match="fewer than half of the samples are equal, got 1"):
        DeflectionDetector(moments="ogk").fit(examples)


@pytest.mark.parametrize("detector", [DeflectionDetector, NeymanPearsonDetector])
def test_a_divisor_that_has_no_effect_is_told(rng, detector):
    examples = rng.normal(size=(30, 3))
    with pytest.warns(UserWarning, match="ddof = 1 has no effect with moments = 'ledoit-wolf'"):
        detector(moments="ledoit-wolf", ddof=1).fit(examples)
