"""The steps that detection on stored runs and live detection take alike."""

import numpy as np
import pandas as pd
import pytest

from flgpr.clutter import Background
from flgpr.method.steps import Steps, check_confidence
from flgpr.recipe.schema import parse_recipe
from flgpr.screen import MeanViewSums, RangeViewSums, RunViewSums
from small_lane import LANE, cut_down, small_recipe

POLARIZATIONS = ["HH", "VV", "HV"]


def steps_of(text, **more):
    recipe = parse_recipe(text)
    subbands = list(recipe.image.subbands)
    return Steps(recipe, POLARIZATIONS, subbands, recipe.near_grid(), {}, **more)


@pytest.fixture(scope="module")
def steps():
    return steps_of(small_recipe())


def background_and_image(steps):
    shape = (3, len(steps.subbands), *steps.grid.shape)
    rng = np.random.default_rng(2)
    image = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    nothing = np.zeros(shape, np.complex64)
    gain = np.full(shape, 2.0, np.float32)
    background = Background(nothing, gain, nothing, gain[0])
    return background, image, np.ones(shape[:2])


def test_a_cleaned_image_is_in_units_of_its_background(steps):
    background, image, gain = background_and_image(steps)
    scan = steps.clean(7, np.zeros(6), image, gain, background)
    np.testing.assert_allclose(scan.magnitude, np.abs(image) / 2, rtol=1e-5)
    assert scan.number == 7


@pytest.mark.parametrize(
    ("change", "own", "shared_phase", "own_phase"),
    [
        ("variants = true", False, True, True),
        ("variants = false", False, True, False),
        ("variants = false", True, True, True),
        ('variants = false\ngain = "own"', False, False, True),
    ],
)
def test_phases_are_kept_only_where_features_read_them(change, own, shared_phase, own_phase):
    text = cut_down(small_recipe(), [("variants = true", change)])
    if "gain" in change:
        text = text.replace('gain = "shared"\n', "")
    steps = steps_of(text)
    background, image, gain = background_and_image(steps)
    scan = steps.clean(0, np.zeros(6), image, gain, background, needs_own_phase=own)
    assert (scan.coherent is not None, scan.own is not None) == (shared_phase, own_phase)


def test_a_labelled_image_has_axes_number_and_pose(steps):
    background, image, gain = background_and_image(steps)
    pose = np.arange(6.0)
    scan = steps.clean(3, pose, image, gain, background, needs_own_phase=True)
    labelled = steps.labelled(scan)
    assert labelled["polarization"].values.tolist() == POLARIZATIONS
    np.testing.assert_array_equal(labelled["y"].values, steps.grid.y)
    assert (labelled.attrs["scan"], labelled.attrs["pose"]) == (3, pose.tolist())
    assert labelled.attrs["units"] == "1"


@pytest.mark.parametrize(
    ("entries", "kind"),
    [
        ("", RunViewSums),
        ('look = "mean"\n', MeanViewSums),
    ],
)
def test_the_sums_are_those_of_the_recipes_look(entries, kind):
    text = small_recipe().replace("[run_view]\n", f"[run_view]\n{entries}")
    steps = steps_of(text)
    grid = steps.recipe.run_view.grid(LANE)
    assert type(steps.view_sums(grid)) is kind
    assert kind is not RangeViewSums


def test_without_a_detector_the_column_of_the_recipe_is_the_confidence(steps):
    assert steps.single == "C_HH_F1"
    features = pd.DataFrame({"C_HH_F1": [1.0, 2.0], "other": [3.0, 4.0]})
    magnitude = pd.Series([5.0, 6.0])
    assert steps.confidence(features, magnitude).tolist() == [1, 2]
    by_magnitude = steps_of(f'confidence = "magnitude"\n{small_recipe()}')
    assert by_magnitude.confidence(features, magnitude).tolist() == [5, 6]


def test_a_confidence_that_no_stage_adds_is_refused():
    recipe = parse_recipe(small_recipe())
    check_confidence(recipe, [])
    other = recipe.model_copy(update={"confidence": "cnn"})
    check_confidence(other, ["cnn"])
    with pytest.raises(ValueError, match="must be one of contrast, magnitude, rx, got 'cnn'"):
        check_confidence(other, ["rx"])
