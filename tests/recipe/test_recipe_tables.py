"""The tables of a recipe: their derived values and their rules."""

import numpy as np
import pytest
from pydantic import ValidationError

from flgpr.model import Lane
from flgpr.recipe.tables import (
    BackgroundTable,
    DetectorTable,
    ImageTable,
    LaneTable,
    RunViewTable,
)

IMAGE = {"x": (-6.0, 6.0), "y": (7.0, 26.0), "spacing": 0.05, "subbands": {"F1": (1e9, 2e9)}}


@pytest.mark.parametrize(
    ("spacing", "shape"), [(0.05, (381, 241)), ((0.05, 0.1), (191, 241)), ((0.1, 0.05), (381, 121))]
)
def test_images_reach_from_border_to_border_in_steps_of_their_own(spacing, shape):
    grid = ImageTable.model_validate(IMAGE | {"spacing": spacing}).grid()
    assert grid.shape == shape
    assert (grid.x[0], grid.x[-1]) == pytest.approx((-6, 6))
    assert (grid.y[0], grid.y[-1]) == pytest.approx((7, 26))


def test_an_aperture_counts_as_one_scan():
    assert ImageTable.model_validate(IMAGE | {"frames": "all"}).summed == 1
    assert ImageTable.model_validate(IMAGE | {"frames": 5}).summed == 5


def test_the_window_of_filtered_backprojection_follows_from_the_tones():
    frequency = np.linspace(1e9, 2e9, 5)
    assert ImageTable.model_validate(IMAGE).weights(frequency) == "boxcar"
    weights = ImageTable.model_validate(IMAGE | {"window": "ramp"}).weights(frequency)
    assert np.shape(weights) == (5,)
    assert (np.diff(weights) > 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": (6.0, -6.0)}, "must increase, got 6, -6"),
        ({"window": "square"}, "must be one of .*, ramp, got 'square'"),
        ({"polarizations": ("HX",)}, "must be one of .*, got 'HX'"),
        ({"subbands": {}}, "at least 1 item"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_entries_that_break_a_rule_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        ImageTable.model_validate(IMAGE | change)


def test_windows_of_the_background_are_odd_numbers_of_pixels():
    table = BackgroundTable(self_signature="mean", median=1.0, mean=2.55)
    assert table.windows(0.05) == ((21, 21), (51, 51))
    assert table.windows(0.05, 0.1) == ((9, 21), (25, 51))
    narrow = BackgroundTable(self_signature="mean", median=0.001, mean=0.001)
    assert narrow.windows(0.05) == ((1, 1), (1, 1))


def test_channels_of_a_run_view_are_sub_bands_or_ranges_of_each():
    view = {"x": (-3.0, 3.0), "spacing": 0.1, "y_max": 16.0}
    assert RunViewTable.model_validate(view).channels(["F1", "F2"]) == ["F1", "F2"]
    ranges = RunViewTable.model_validate(view | {"look": "ranges", "ranges": (8.0, 12.5)})
    assert ranges.channels(["F1"]) == ["8 m", "12.5 m"]
    assert ranges.channels(["F1", "F2"]) == ["F1 8 m", "F1 12.5 m", "F2 8 m", "F2 12.5 m"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"look": "ranges"}, r'ranges must be given with the look "ranges" and only then'),
        ({"ranges": (8.0,)}, r'ranges must be given with the look "ranges" and only then'),
        ({"falloff": 2.0}, r'falloff must be left out unless the look is "mean", got 2'),
    ],
)
def test_a_run_view_has_the_entries_of_its_look(change, message):
    view = {"x": (-3.0, 3.0), "spacing": 0.1, "y_max": 16.0}
    with pytest.raises(ValidationError, match=message):
        RunViewTable.model_validate(view | change)


def test_a_run_view_without_borders_is_as_long_as_the_lane():
    table = RunViewTable(x=(-3.0, 3.0), spacing=0.1, y_max=16.0)
    grid = table.grid(Lane(-1.5, 1.5, 10.0, 20.0))
    assert (grid.y[0], grid.y[-1]) == pytest.approx((10, 20))
    assert (grid.x[0], grid.x[-1]) == pytest.approx((-3, 3))


def test_an_unknown_estimator_and_an_empty_lane_are_refused():
    with pytest.raises(ValidationError, match=r"estimator must be one of fisher, .*, got 'magic'"):
        DetectorTable(estimator="magic")
    with pytest.raises(ValidationError, match="lane"):
        LaneTable(x_min=1.0, x_max=-1.0, y_min=0.0, y_max=1.0)
