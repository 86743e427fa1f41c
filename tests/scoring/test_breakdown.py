import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize
from slow_scoring import seen_in_time, wang_roc

from flgpr.model import Lane
from flgpr.scoring import (
    Refraction,
    clopper_pearson,
    decision_curves,
    decision_table,
    jitter,
    match,
    operating_row,
    pd_table,
    refraction_shift,
    roc,
    survey_share,
)

LANE = Lane(0.0, 4.0, 0.0, 30.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b", "c", "d"],
        "x": [1.0, 2.0, 3.0, 2.0],
        "y": [5.0, 10.0, 15.0, 20.0],
        "kind": ["metal", "metal", "plastic", "plastic"],
        "depth": [0.0, 0.05, 0.15, math.nan],
    }
)
ALARMS = pd.DataFrame(
    [(1.0, 5.0, 9.0), (2.5, 10.0, 8.0), (1.0, 25.0, 7.0), (3.0, 15.0, 6.0), (2.0, 20.0, 5.0)],
    columns=["x", "y", "confidence"],
)


def test_pd_is_tabulated_at_the_threshold_of_the_whole_list():
    table = pd_table(match(ALARMS, TRUTH, LANE), 0.0, ["kind"])
    assert table[["kind", "n_targets", "n_detected", "pd"]].to_numpy().tolist() == [
        ["metal", 2, 2, 1.0],
        ["plastic", 2, 0, 0.0],
    ]
    assert table.attrs["threshold"] == 8.0
    low, high = clopper_pearson([2, 0], 2)
    assert table["pd_low"].tolist() == low.tolist()
    assert table["pd_high"].tolist() == high.tolist()
    whole = pd_table(match(ALARMS, TRUTH, LANE), 0.02, ["kind"])
    curve = roc(ALARMS, TRUTH, LANE)
    assert whole["n_detected"].sum() == curve["n_detected"].iloc[operating_row(curve, 0.02)] == 4


def test_depths_fall_into_classes_in_order_and_an_unknown_depth_stays_apart():
    table = pd_table(match(ALARMS, TRUTH.assign(soil=["clay", "clay", "sand", "sand"]), LANE), 0.02)
    assert list(table.columns[:3]) == ["kind", "depth", "soil"]
    assert table["depth"].astype(object).where(table["depth"].notna(), None).tolist() == [
        "0 to 2.5 cm",
        "2.5 to 7.5 cm",
        "12.5 to 17.5 cm",
        None,
    ]
    assert (table["n_targets"] == 1).all()
    plain = pd_table(match(ALARMS, TRUTH, LANE), 0.02, ["depth"], depth_edges=None)
    assert plain["depth"].tolist()[:3] == [0.0, 0.05, 0.15]
    with pytest.raises(ValueError, match="by must name columns of truth, got colour"):
        pd_table(match(ALARMS, TRUTH, LANE), by=["colour"])
    with pytest.raises(ValueError, match="depth_edges must rise"):
        pd_table(match(ALARMS, TRUTH, LANE), depth_edges=[0.1, 0.05])


sightings = st.lists(
    st.tuples(
        st.integers(0, 6),
        st.integers(0, 8),
        st.integers(0, 60),
        st.floats(4, 18),
        st.integers(-3, 3),
    ),
    max_size=25,
)


@settings(max_examples=80, deadline=None)
@given(sightings, st.sampled_from([4.0, 8.0, 12.0, 17.9]))
def test_only_what_was_seen_in_time_counts(rows, distance):
    # Each alarm keeps one place, so that ties between its scans leave no choice.
    places = {name: (x / 2, y / 2) for name, x, y, _, _ in rows}
    listed = [
        {
            "alarm_id": str(n),
            "x": places[n][0],
            "y": places[n][1],
            "ahead": ahead,
            "confidence": float(c),
        }
        for n, _, _, ahead, c in rows
    ]
    columns = ["alarm_id", "x", "y", "ahead", "confidence"]
    table = pd.DataFrame(listed, columns=columns).astype(dict.fromkeys(columns[1:], float))
    curve = decision_curves(table, TRUTH, LANE, [distance], area="paper")[distance]
    known = seen_in_time(listed, distance)
    want = wang_roc(known, TRUTH.to_dict("records"), LANE, 1.0)
    assert list(zip(curve["threshold"], curve["n_detected"], curve["n_false"], strict=True)) == want
    assert curve.attrs["decision_distance"] == distance


def test_scans_can_be_averaged_and_rows_without_a_name_stand_alone():
    seen = pd.DataFrame(
        {
            "alarm_id": ["q", "q", None, None],
            "x": [1.0, 1.0, 3.0, 3.0],
            "y": [5.0, 5.1, 25.0, 26.0],
            "confidence": [1.0, 3.0, 2.0, 2.5],
            "ahead": [12.0, 9.0, 9.0, 9.0],
        }
    )
    mean = decision_curves(seen, TRUTH, LANE, [8.0], combine="mean")[8.0]
    assert mean["threshold"].tolist() == [math.inf, 2.5, 2.0]
    assert mean["n_false"].tolist() == [0, 1, 2]
    late = decision_curves(seen, TRUTH, LANE, [10.0])[10.0]
    assert late["threshold"].tolist() == [math.inf, 1.0]
    table = decision_table(decision_curves(seen, TRUTH, LANE, (8, 10, 13)))
    assert table["n_detected"].tolist() == [1, 1, 0]
    assert table["distance"].tolist() == [8, 10, 13]
    blank = decision_table(decision_curves(seen, TRUTH.iloc[:0], LANE, (8,)))
    assert math.isnan(blank["pd_mean"].iloc[0])
    with pytest.raises(ValueError, match="must have the column ahead"):
        decision_curves(seen.drop(columns="ahead"), TRUTH, LANE)
    with pytest.raises(ValueError, match="must have the column ahead, finite"):
        decision_curves(seen.assign(ahead=math.nan), TRUTH, LANE)
    with pytest.raises(ValueError, match="combine must be one of"):
        decision_curves(seen, TRUTH, LANE, combine="median")


@pytest.mark.parametrize(
    ("depth", "permittivity", "distance"), [(0.01, 4.0, 12.0), (0.02, 9.0, 8.0), (0.01, 2.5, 16.0)]
)
def test_the_refraction_shift_is_fermats_small_depth_limit(depth, permittivity, distance):
    """The path by Fermat's principle, and the place on the surface at the same one-way path."""
    height = 5.0

    def path(s):
        return math.hypot(height, s) + math.sqrt(permittivity) * math.hypot(depth, distance - s)

    best = optimize.minimize_scalar(
        path, bounds=(0, distance), method="bounded", options={"xatol": 1e-10}
    )
    shown = math.sqrt(best.fun**2 - height**2)
    assert refraction_shift(depth, permittivity, height, distance) == pytest.approx(
        shown - distance, rel=0.02
    )


def test_refraction_moves_buried_targets_away_from_the_radar_and_is_off_by_default():
    shift = refraction_shift(0.15, 6.0, 5.0, 12.0)
    alarms = pd.DataFrame({"x": [0.0], "y": [15.0 + shift], "confidence": [1.0]})
    truth = TRUTH.iloc[[2]].assign(x=0.0)
    assert roc(alarms, truth, LANE, 0.2).attrs["refraction"] == "none"
    assert roc(alarms, truth, LANE, 0.2)["n_detected"].iloc[-1] == 0
    moved = roc(alarms, truth, LANE, 0.2, refraction=Refraction(6.0))
    assert moved["n_detected"].iloc[-1] == 1
    assert "permittivity=6.0" in moved.attrs["refraction"]
    still = Refraction(6.0).move(TRUTH)
    assert still.loc[[0, 3], ["x", "y"]].equals(
        TRUTH.loc[[0, 3], ["x", "y"]]
    )  # flush, and of unknown depth
    for bad in (
        {"permittivity": 0.5},
        {"permittivity": 3.0, "height": 0.0},
        {"permittivity": 3.0, "radar_x": math.inf},
    ):
        with pytest.raises(ValueError, match="must be"):
            Refraction(**bad)


def test_survey_error_takes_its_share_of_the_halo():
    share = survey_share(0.2, 1.0)
    draws = jitter(TRUTH.iloc[[0] * 20_000].assign(target_id=range(20_000)), 0.2, 1)
    away = np.hypot(draws["x"] - 1, draws["y"] - 5)
    assert share.share == pytest.approx(0.2)
    assert (away <= share.radius_95).mean() == pytest.approx(
        0.95, abs=4 * math.sqrt(0.95 * 0.05 / 20_000)
    )
    assert (away > 0.3).mean() == pytest.approx(
        survey_share(0.2, 0.3).lost, abs=4 * math.sqrt(0.25 / 20_000)
    )
    assert survey_share(0.0).lost == 0.0


def test_survey_error_changes_no_count():
    plain = roc(ALARMS, TRUTH, LANE)
    told = roc(ALARMS, TRUTH, LANE, survey_error=0.3)
    assert told.attrs["survey_share_of_halo"] == pytest.approx(0.3)
    assert plain.to_numpy().tolist() == told.to_numpy().tolist()
    with pytest.raises(ValueError, match="survey_error must not"):
        roc(ALARMS, TRUTH, LANE, survey_error=-1)
    with pytest.raises(ValueError, match="halo must be"):
        survey_share(0.1, 0.0)
