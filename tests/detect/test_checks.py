"""Arrays and settings of a file are taken once, by name, type, shape and range; nothing may be left."""

import numpy as np
import pytest

from flgpr.detect.scorers.checks import Checked


def checked(**settings):
    return Checked(settings, {"weight": np.ones((2, 3)), "first": np.arange(4)})


def test_what_fits_is_taken():
    values = checked(gamma=0.5, count=3, flag=True, kernel="rbf")
    assert values.array("weight", (None, 3)).shape == (2, 3)
    assert values.array("first", (4,), np.int64).tolist() == [0, 1, 2, 3]
    assert values.number("gamma", 0.0, 1.0) == 0.5
    assert values.whole("count", 1, 5) == 3
    assert values.flag("flag") is True
    assert values.choice("kernel", ("rbf", "linear")) == "rbf"
    values.done()


@pytest.mark.parametrize(
    ("take", "rule"),
    [
        (lambda v: v.array("bias", (1,)), "array 'bias' is missing"),
        (lambda v: v.array("weight", (3, 2)), r"must have the shape \(3, 2\), got \(2, 3\)"),
        (lambda v: v.array("weight", (6,)), r"must have the shape \(6\)"),
        (lambda v: v.array("first", (4,)), "must hold float64, got int64"),
        (lambda v: v.number("gamma", 0.0, 1.0), "must lie between 0 and 1, got 2"),
        (lambda v: v.number("flag"), "must be a finite number, got True"),
        (lambda v: v.whole("gamma", 0, 5), "must be a whole number from 0 to 5, got 2.0"),
        (lambda v: v.flag("gamma"), "must be true or false, got 2.0"),
        (lambda v: v.choice("gamma", ("rbf",)), "must be one of rbf, got 2.0"),
        (lambda v: v.done(), "array 'first' does not belong to it"),
    ],
)
def test_what_does_not_fit_is_refused(take, rule):
    with pytest.raises(ValueError, match=rule):
        take(checked(gamma=2.0, flag=True))


def test_numbers_must_be_finite():
    values = Checked({}, {"weight": np.array([1.0, np.nan])})
    with pytest.raises(ValueError, match="must be finite, got 1 that are not"):
        values.array("weight", (2,))
