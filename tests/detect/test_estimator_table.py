"""The estimators that a recipe may name."""

import pytest

from flgpr.detect.estimator_table import known_estimators, scorer_class, trained_class


@pytest.mark.parametrize("name", known_estimators())
def test_every_name_is_a_class_that_is_trained(name):
    if known_estimators()[name].needs:
        pytest.importorskip("pyod")
    assert callable(trained_class(name).fit)


@pytest.mark.parametrize("name", known_estimators())
def test_every_trained_estimator_has_a_scorer(name):
    assert callable(scorer_class(name).of)


def test_another_name_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"estimator must be one of rvm, .*, got 'oracle'"):
        scorer_class("oracle")
