"""The pictures that a report begins with: what is drawn where, and two pictures that lie on one another."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.report.overview import alarm_overview, before_and_after, is_short, score_overview
from flgpr.results.result import read_result
from flgpr.results.view_files import read_layer
from flgpr.scoring import Rules, score
from small_results import small_result

LANE = Lane(-2.0, 2.0, 0.0, 60.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b"],
        "x": [-1.0, 1.0],
        "y": [10.0, 50.0],
        "kind": ["metal", "metal"],
        "depth": [0.05, 0.1],
    }
)
ALARMS = pd.DataFrame(
    {"x": [-1.0, 0.0, 1.5], "y": [10.2, 30.0, 20.0], "confidence": [3.0, 2.0, 1.0]}
)


def drawn(axes):
    """Places by label."""
    places = {}
    for line in axes.lines:
        places[line.get_label()] = np.column_stack(line.get_data()).tolist()
    return places


def test_found_and_missed_targets_and_false_alarms_are_drawn_along_the_road():
    scored = score(ALARMS, TRUTH, LANE, Rules(far=0.005, draws=20))
    objects = pd.DataFrame({"x": [-3.0], "y": [15.0], "kind": ["post"]})
    figure = score_overview(scored, objects)
    places = drawn(figure.axes[0])
    assert places["mine found"] == [[10.0, -1.0]]
    assert places["mine missed"] == [[50.0, 1.0]]
    assert places["false alarm"] == [[30.0, 0.0]]
    assert places["alarm too weak to count"] == [[20.0, 1.5]]
    assert places["post, no target"] == [[15.0, -3.0]]
    low, high = figure.axes[0].get_ylim()
    assert low > high  # right of the vehicle, which drives to the right, is below


def test_every_lane_is_a_strip_and_a_score_of_frames_has_no_road():
    lanes = {str(number): LANE for number in range(8)}
    truth = TRUTH.assign(lane=["0", "7"])
    alarms = ALARMS.assign(lane=["0", "0", "7"])
    scored = score(alarms, truth, lanes, Rules(far=0.005, draws=20))
    figure = score_overview(scored)
    assert len(figure.axes) == 6
    assert figure.get_suptitle() == "the first 6 of 8 lanes"
    assert score_overview(replace(scored, rules=Rules(area="frames"))) is None


def test_alarms_without_truth_are_larger_where_they_are_surer():
    figure = alarm_overview(LANE, ALARMS)
    [points] = figure.axes[0].collections
    assert points.get_offsets().tolist() == ALARMS[["y", "x"]].to_numpy().tolist()
    assert list(points.get_sizes()) == sorted(points.get_sizes(), reverse=True)
    assert len(alarm_overview(LANE, ALARMS[:0]).axes[0].collections) == 0
    assert not is_short(LANE)


def test_what_stands_out_beside_the_lane_is_not_drawn_as_weak():
    figure = alarm_overview(LANE, ALARMS.assign(x=[-1.0, 3.0, 1.5]), border=1.5)
    drawn = {line.get_label(): line.get_ydata().tolist() for line in figure.axes[0].lines}
    assert drawn == {"weak": [1.5], "stands out beside the lane": [3.0]}


def test_the_road_at_an_earlier_drive_and_today_has_one_colour_in_the_median(tmp_path):
    result = read_result(small_result(tmp_path / "result", days=True))
    then, now, caption = before_and_after(result)
    drawn = [figure.axes[0].collections[0].get_array() for figure in (then, now)]
    np.testing.assert_allclose(drawn[0], drawn[1][:, ::-1], atol=0.02)
    assert "left of the line at the earlier drive, right of it today" in caption
    view = result.detections[0].view[0, 0]
    np.testing.assert_allclose(read_layer(result.files(), "before", view), 2 * view, rtol=2e-3)
    assert read_layer(result.files(), "other", view) is None
    with pytest.raises(ValueError, match="layer before must have 40 bytes for 20 pixels, got 50"):
        read_layer(result.files(), "before", view[1:])


def test_pictures_before_and_after_have_one_frame_and_one_scale(tmp_path):
    result = read_result(small_result(tmp_path / "result"))
    assert before_and_after(result) is None
    main = result.detections[0]
    cleaned = replace(main, name="cleaned", view=0.5 * main.view, notes={"mask_pixels": 3})
    before, after, _ = before_and_after(replace(result, detections=[main, cleaned]))
    assert before.get_size_inches().tolist() == after.get_size_inches().tolist()
    assert before.axes[0].get_position().bounds == after.axes[0].get_position().bounds
    assert before.axes[0].get_xlim() == after.axes[0].get_xlim()
    difference = (
        before.axes[0].collections[0].get_array() - after.axes[0].collections[0].get_array()
    )
    np.testing.assert_allclose(difference, 20 * np.log10(2), atol=1e-4)
