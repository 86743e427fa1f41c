import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flgpr.model import Lane
from flgpr.scoring import (
    box_peaks,
    box_roc,
    clopper_pearson,
    example_roc,
    offset_boxes,
    pd_mean,
    peak_roc,
    with_area,
)
from reference.slow_scoring import box_curve, example_curve

LANE = Lane(0.0, 3.0, 0.0, 5.0)
X = np.arange(0.125, 3, 0.25)
Y = np.arange(0.125, 5, 0.25)


def truth_table(places):
    return pd.DataFrame(places, columns=["x", "y"], dtype=float).assign(
        target_id=[f"m{k}" for k in range(len(places))], kind="metal", depth=0.05
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0.5, 1.0]), st.integers(1, 2))
def test_box_roc_is_the_paper_counted_pixel_by_pixel(seed, box, looks):
    rng = np.random.default_rng(seed)
    image = rng.choice(
        [rng.normal(size=(looks, 20, 12)), rng.integers(0, 6, (looks, 20, 12)).astype(float)]
    )
    image[rng.random(image.shape) < 0.1] = np.nan
    targets = np.round(rng.uniform([0.5, 0.5], [2.5, 4.5], size=(rng.integers(1, 4), 2)) * 8) / 8
    curve = box_roc(image, X, Y, truth_table(targets), LANE, box)
    want = box_curve(image.tolist(), X.tolist(), Y.tolist(), targets.tolist(), LANE, box)
    assert curve[["threshold", "pd", "far"]].to_numpy() == pytest.approx(np.array(want), rel=1e-12)


def test_a_box_roc_saturates_at_one_per_box_and_does_not_convert():
    image = np.random.default_rng(0).normal(size=(20, 12))
    curve = box_roc(image, X, Y, truth_table([(1.5, 2.5)]), LANE)
    assert (curve["pd"].iloc[-1], curve["far"].iloc[-1]) == (1.0, 1.0)
    assert curve.attrs["convention"] == "box"
    low, high = clopper_pearson(curve["n_false"], curve.attrs["n_boxes"])
    assert curve["far_low"].tolist() == low.tolist()
    assert curve["far_high"].tolist() == high.tolist()
    with pytest.raises(ValueError, match="a fraction of boxes is no number of alarms"):
        with_area(curve, 10.0, "lane")


def test_offset_boxes_keep_off_targets_by_a_clearance():
    centres = offset_boxes([(1.5, 2.5)], LANE, 1.0)
    assert len(centres) == 14
    assert len(offset_boxes([(1.5, 2.5)], LANE, 1.0, 0.5)) == 15 - 9
    assert len(offset_boxes(np.zeros((0, 2)), LANE, 1.0)) == 15


def test_boxes_without_an_imaged_pixel_are_counted_apart():
    assert np.isnan(box_peaks(np.ones((20, 12)), X, Y, [(30.0, 2.0)])).all()
    curve = peak_roc([1.0, math.nan], [0.5, math.nan, 0.2], 1.0)
    assert (curve.attrs["n_targets"], curve.attrs["n_boxes"], curve.attrs["n_not_imaged"]) == (
        1,
        2,
        1,
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image": np.ones((3, 3))}, "image must have the shape"),
        ({"x": X[::-1]}, "x and y must rise"),
        ({"box": 0.0}, "box must be positive"),
        ({"box": 4.0}, "at least one imaged box"),
        ({"clearance": -1.0}, "clearance not negative"),
        ({"truth": truth_table([(math.nan, 1)])}, "truth.x must be finite"),
        ({"truth": truth_table([(1, 400)])}, "truth must lie in or near the lane"),
    ],
)
def test_images_and_boxes_that_do_not_fit_are_named(change, message):
    arguments = {
        "image": np.ones((20, 12)),
        "x": X,
        "y": Y,
        "truth": truth_table([(1, 1)]),
        "lane": LANE,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        box_roc(**arguments)


@pytest.mark.slow("counts every threshold by hand")
@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(st.one_of(st.integers(-2, 2).map(float), st.floats(-9, 9)), st.booleans()),
        max_size=25,
    ),
    st.sampled_from([1.0, 37.5]),
)
def test_example_roc_is_the_paper_counted_example_by_example(examples, area):
    examples = [*examples, (0.5, True)]
    scores, labels = zip(*examples, strict=True)
    curve = example_roc(scores, labels, area)
    want = np.array(example_curve(scores, labels, area))
    assert curve[["threshold", "pd", "far"]].to_numpy().tolist() == want.tolist()


def test_examples_lost_before_the_classifier_lower_pd_and_pooled_clutter_is_shared_out():
    curve = example_roc([3, 2, 1, 1, 0, 0], [1, 1, 0, 0, 0, 0], 50.0, n_targets=4, repeats=2)
    assert curve["pd"].tolist() == [0, 0.25, 0.5, 0.5, 0.5]
    assert curve["far"].tolist() == [0, 0, 0, 1 / 50, 2 / 50]
    assert pd_mean(curve, 0.01) == 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"is_target": [1, 0]}, "one length"),
        ({"is_target": [1, 0, 2]}, "truth values"),
        ({"score": [1.0, math.nan, 0.0]}, "score must be finite"),
        ({"n_targets": 0}, "n_targets must be at least"),
        ({"repeats": 3}, "repeats must divide"),
        ({"area": 0.0}, "area must be positive"),
    ],
)
def test_examples_that_do_not_fit_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        example_roc(**{"score": [3.0, 2.0, 1.0], "is_target": [1, 0, 0], "area": 5.0, **change})
