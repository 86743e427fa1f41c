import numpy as np
import pandas as pd
import pytest

from flgpr.model import ALARM_COLUMNS, Lane, as_lane, check_alarms, check_truth, empty_table

TRUTH = pd.DataFrame(
    {"target_id": ["a", "b"], "x": [0.0, 1], "y": [2.0, 3], "kind": "metal", "depth": 0.1}
)


def test_an_empty_alarm_table_is_valid():
    assert check_alarms(empty_table(ALARM_COLUMNS)).empty


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop(columns="depth"), ["truth", "depth"]),
        (lambda t: t.assign(x=[np.nan, 1]), ["truth.x", "row 1 below"]),
        (lambda t: t.assign(target_id="a"), ["target_id", "'a'"]),
        (lambda t: t.assign(y=["3", "two"]), ["truth.y", "numbers (m), got 'two' in row 2 below"]),
        (lambda t: t.assign(y=[1, int("7" * 4000)]), ["truth.y", "of 4000 digits' in row 2"]),
        (lambda t: t.assign(y=[1, "7" * 4000 + "x"]), ["truth.y", "of 4001 in row 2"]),
    ],
)
def test_bad_truth_is_refused(change, words):
    with pytest.raises(ValueError) as error:
        check_truth(change(TRUTH))
    for word in words:
        assert word in str(error.value)


def test_depth_may_be_unknown():
    assert check_truth(TRUTH.assign(depth=np.nan))["depth"].isna().all()


def test_lane_takes_every_form_and_refuses_an_empty_one():
    borders = {"x_min": -1.0, "x_max": 1.0, "y_min": 2.0, "y_max": 6.2}
    want = Lane(**borders)
    assert want.area == pytest.approx(8.4)
    assert (
        as_lane(borders)
        == as_lane(pd.DataFrame([borders]))
        == as_lane(pd.Series(borders))
        == as_lane(want)
        == want
    )
    assert want.contains([0, 1.0, 1.1], [3, 2.0, 3]).tolist() == [True, True, False]
    with pytest.raises(ValueError, match="empty lane"):
        as_lane(borders | {"y_max": 2.0})
    with pytest.raises(ValueError, match="missing: y_max"):
        as_lane({k: v for k, v in borders.items() if k != "y_max"})
