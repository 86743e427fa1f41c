"""scikit-learn's own checks; complex data are the one thing that our estimators take and theirs refuse."""

import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from flgpr.clutter import ClutterWhitener
from flgpr.detect import DeflectionDetector, NeymanPearsonDetector, PolarimetricWhiteningFilter


def declared(estimator):
    return {"check_complex_data": "takes complex samples"}


@pytest.mark.slow("all checks of scikit-learn for every form")
@parametrize_with_checks(
    [
        DeflectionDetector(),
        DeflectionDetector(gamma=0.5, moments="ledoit-wolf"),
        NeymanPearsonDetector(),
        PolarimetricWhiteningFilter(),
        ClutterWhitener(),
    ],
    expected_failed_checks=declared,
)
def test_scikit_learn_check(estimator, check):
    check(estimator)
