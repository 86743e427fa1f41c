"""Novelty detectors: no collapse, near-optimal on a known density ratio."""

import numpy as np
import pytest
from scipy.special import expit
from sklearn.metrics import roc_auc_score

from flgpr.detect import GaussianMixtureNovelty, OneClassRelevanceVectorMachine
from flgpr.detect.rvm_fit import fit_sparse
from reference import tipping2001
from reference.ripley1996 import design_of, ripley


def mines(count, seed):
    return np.random.default_rng(seed).normal([0.7, 0.6, 0.5], [0.1, 0.05, 0.2], (count, 3))


@pytest.mark.parametrize("p0", [0.01, 0.2])
@pytest.mark.parametrize("prior", ["ard", "laplacian", "laplacian-map"])
def test_far_from_all_mines_the_probability_is_p0(p0, prior):
    X = mines(60, 0)
    machine = OneClassRelevanceVectorMachine(p0=p0, prior=prior).fit(X, np.ones(60))
    far = machine.predict_proba(X + 100)[:, -1]
    assert (far <= p0 + 1e-3).all()
    assert machine.predict_proba(X)[:, -1].mean() > 0.8
    assert 0 < len(machine.relevance_) < 30


def test_a_free_bias_collapses_which_is_why_there_is_none():
    X = (mines(60, 0) - [0.7, 0.6, 0.5]) / [0.1, 0.05, 0.2]
    design = np.hstack([design_of(X, 1 / 3, bias=False), np.ones((60, 1))])
    active, alpha = tipping2001.equation_16_updates(design, np.ones(60), 30, threshold=1e6)
    w, *_ = tipping2001.mode_and_covariance(design[:, active], np.ones(60), alpha)
    far = np.append(np.zeros(60), 1.0)[active]
    assert expit(far @ w) > 0.9


def test_without_bias_the_probability_falls_to_one_half():
    X = mines(60, 1)
    machine = OneClassRelevanceVectorMachine(formulation="no-bias").fit(X)
    np.testing.assert_allclose(machine.predict_proba(X + 100)[:, -1], 0.5, atol=1e-9)
    assert (machine.predict_proba(X)[:, -1] > 0.5).all()


def test_features_are_standardised_on_the_mines_alone():
    X = mines(50, 2)
    stretched = X * [1.0, 1000.0, 1e-3] + [5.0, 0.0, 3.0]
    a = OneClassRelevanceVectorMachine().fit(X)
    b = OneClassRelevanceVectorMachine().fit(stretched)
    np.testing.assert_allclose(a.predict_proba(X), b.predict_proba(stretched), atol=1e-6)
    np.testing.assert_allclose(a.center_, X.mean(axis=0))


@pytest.mark.parametrize(
    "machine",
    [
        OneClassRelevanceVectorMachine(),
        OneClassRelevanceVectorMachine(formulation="reference", n_reference=300, random_state=0),
        GaussianMixtureNovelty(random_state=0),
    ],
)
def test_area_under_the_curve_is_near_that_of_the_known_density_ratio(machine):
    """Clutter is uniform over a box, so that the mines' density is the optimal score."""
    rng = np.random.default_rng(5)
    X = rng.normal(0, 1, (150, 2))
    test = np.vstack([rng.normal(0, 1, (1000, 2)), rng.uniform(-4, 4, (1000, 2))])
    label = np.repeat([1, 0], 1000)
    optimum = roc_auc_score(label, -(test**2).sum(axis=1))
    reached = roc_auc_score(label, machine.fit(X).score_samples(test))
    # Bamber's bound on the standard error of an area from 1000 and 1000 examples, three times
    assert reached > optimum - 0.03 - 3 * np.sqrt(optimum * (1 - optimum) / 1000)
    assert reached < optimum + 3 * np.sqrt(optimum * (1 - optimum) / 1000)


def test_sparse_model_fulfils_the_fixed_point_with_the_offset():
    X, _ = ripley(70, 0)
    design = design_of(X, 2.0, bias=False)
    t = np.ones(70)
    fit = fit_sparse(design, t, offset=-4.6, tol=1e-8)
    s, q = tipping2001.sparsity_and_quality(design, t, fit.active, fit.alpha, -4.6)
    np.testing.assert_allclose(
        fit.alpha, s[fit.active] ** 2 / (q[fit.active] ** 2 - s[fit.active]), rtol=1e-4
    )


def test_threshold_gives_up_the_stated_share():
    X = mines(200, 3)
    for machine in (
        OneClassRelevanceVectorMachine(reject=0.1),
        GaussianMixtureNovelty(reject=0.1, random_state=0),
    ):
        assert np.mean(machine.fit_predict(X) == -1) == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"p0": 0.0}, "p0 must lie between 0 and 1"),
        ({"formulation": "bias"}, "formulation must be one of offset, no-bias, reference"),
        ({"reject": 1.0}, "reject must be at least 0 and below 1"),
        ({"formulation": "reference", "box": [[0, 1]]}, "box must hold"),
        ({"formulation": "reference", "n_reference": 0}, "n_reference must be at least 1"),
        (
            {"formulation": "reference", "kernel": "precomputed"},
            "kernel must be a function of examples",
        ),
    ],
)
def test_errors_name_the_parameter(parameters, message):
    with pytest.raises(ValueError, match=message):
        OneClassRelevanceVectorMachine(**parameters).fit(mines(10, 0))


@pytest.mark.parametrize("gamma", [0.05, 0.5, 3.0, 30.0])
def test_no_width_empties_the_model(gamma):
    """As all mines become certain the curvature vanishes; the vector that makes them so must stay."""
    rng = np.random.default_rng(0)
    X = np.concatenate([rng.normal((-1, 0), 0.35, (40, 2)), rng.normal((1, 0.5), 0.35, (40, 2))])
    machine = OneClassRelevanceVectorMachine(gamma=gamma).fit(X)
    assert len(machine.relevance_) >= 1
    assert machine.predict_proba(X)[:, -1].min() > 0.5
    assert machine.predict_proba(X + 100)[0, -1] == pytest.approx(0.01, abs=1e-3)
    assert machine.log_evidence_ > 80 * np.log(0.5)
