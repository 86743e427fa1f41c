"""The estimators that a recipe may name."""

from importlib import import_module

import pytest

from flgpr.detect.scorers import scorer_class
from flgpr.recipe.estimator_classes import ALLOWED


@pytest.mark.parametrize("name", ALLOWED)
def test_every_name_is_a_class_that_is_trained(name):
    path, _, class_name = ALLOWED[name].rpartition(".")
    if path.startswith("pyod"):
        pytest.importorskip("pyod")
    assert callable(getattr(import_module(path), class_name).fit)


@pytest.mark.parametrize("name", ALLOWED)
def test_every_trained_estimator_has_a_scorer(name):
    assert callable(scorer_class(name).of)


def test_another_name_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"estimator must be one of rvm, .*, got 'oracle'"):
        scorer_class("oracle")
