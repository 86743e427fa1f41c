"""What the crew emplaced takes the place of the plan, once, before the truth is opened."""

import shutil

import numpy as np
import pandas as pd
import pytest

from flgpr.store import read_table
from flgpr.trials import read_register
from flgpr_trials.commands.plan import plan_lane, survey_plan
from scored import score_alarms

LANE = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 60.0\n"


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A planned lane, a registered recipe and one that is not, two alarm lists."""
    home = tmp_path_factory.mktemp("planned")
    (home / "lane.toml").write_text(LANE)
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,3\n")
    for name in ("mine", "other"):
        (home / f"{name}.toml").write_text(f"name = '{name}'\n")
    plan, _ = plan_lane(
        home / "lane.toml", home / "sorts.csv", home / "plan.csv", 7, recipe=home / "mine.toml"
    )
    near = plan[["x", "y"]] + 0.1
    near.assign(confidence=np.arange(len(plan))).to_csv(home / "a.csv", index=False)
    near[:4].assign(confidence=np.arange(4)).to_csv(home / "b.csv", index=False)
    return home


@pytest.fixture
def trial(planned, tmp_path):
    return shutil.copytree(planned, tmp_path / "trial")


@pytest.fixture
def book(trial):
    return trial / "plan.csv.register.jsonl"


def openly(trial, truth="plan.csv", lane="lane.toml", **how):
    options = {"recipe": trial / "mine.toml", "draws": 20, **how}
    return score_alarms(trial / "a.csv", trial / truth, trial / lane, trial / "score", **options)


def fill_in(trial, **changes):
    sheet = pd.read_csv(trial / "plan-sheet.csv", dtype=str).assign(emplaced="yes")
    for place, value in changes.items():
        column, row = place.rsplit("_", 1)
        sheet.loc[int(row), column] = value
    # As spreadsheets of other countries write it.
    (trial / "filled.csv").write_text(sheet.to_csv(index=False, sep=";").replace(".", ","))
    return trial / "filled.csv"


@pytest.mark.slow("runs a whole command more than once")
def test_what_was_emplaced_takes_the_place_of_the_plan(trial, book):
    plan = read_table(trial / "plan.csv", "truth")
    x, y = plan["x"].iloc[2] + 0.03, plan["y"].iloc[2] - 0.04
    changes = {
        "emplaced_x_m_2": f"{x:.3f}",
        "emplaced_y_m_2": f"{y:.3f}",
        "emplaced_depth_m_4": "0.07",
        "emplaced_5": "No",
    }
    truth, line = survey_plan(trial / "plan.csv", fill_in(trial, **changes), trial / "truth.csv")
    counted = [line[name] for name in ("moved", "largest_offset", "other_depth", "left_out")]
    assert counted == [1, 0.05, 1, 1]
    want = plan.copy()
    want.loc[2, ["x", "y"]] = np.round([x, y], 3)
    want.loc[4, "depth"] = 0.07
    pd.testing.assert_frame_equal(truth, want.drop(5).reset_index(drop=True))
    pd.testing.assert_frame_equal(read_table(trial / "truth.csv", "truth"), truth)
    with pytest.raises(ValueError, match="truth must be the survey in line 2"):
        openly(trial)
    openly(trial, truth="truth.csv")
    with pytest.raises(ValueError, match="before the truth is opened"):
        survey_plan(trial / "plan.csv", fill_in(trial), trial / "again.csv")
    assert not (trial / "again.csv").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"emplaced_3": ""}, "T4: emplaced must be yes or no, got ''"),
        ({"emplaced_depth_m_3": "5"}, "T4: emplaced_depth_m must be within 1 m of the planned"),
        (
            {"emplaced_x_m_3": "0.1"},
            "T4: emplaced_(x_m and emplaced_y_m must be filled in together|x_m must be within)",
        ),
        (
            {"emplaced_x_m_3": "left", "emplaced_y_m_3": "1"},
            "T4: emplaced_x_m must be a number of metres .* got left",
        ),
        (
            {"emplaced_3": "", "emplaced_depth_m_5": "12"},
            "T4: emplaced must be yes or no, got ''; T6: emplaced_depth_m must be within 1 m",
        ),
        (
            {"x_m_3": "9.5", "depth_m_5": "0.9"},
            "T4: x_m must stay the planned .* goes into emplaced_x_m, got 9.5; T6: depth_m must stay",
        ),
        (
            {"target_id_3": "T9"},
            "each target of the plan once and no other, got 1 × T9",
        ),
        (
            {"target_id_3": "T1"},
            "each target of the plan once and no other, got 2 × T1",
        ),
    ],
)
def test_a_sheet_with_slips_is_refused(changes, message, trial, book):
    with pytest.raises(ValueError, match=f"filled.csv: .*{message}"):
        survey_plan(trial / "plan.csv", fill_in(trial, **changes), trial / "truth.csv")
    assert not (trial / "truth.csv").exists()
    assert len(read_register(book)) == 1


def test_a_sheet_belongs_to_a_plan_that_is_registered_and_unaltered(trial, book):
    filled = fill_in(trial)
    (trial / "plan.csv").write_text((trial / "plan.csv").read_text().replace("metal", "plastic"))
    with pytest.raises(ValueError, match="plan must be one that stands in"):
        survey_plan(trial / "plan.csv", filled, trial / "truth.csv")


def test_the_first_survey_is_entered_again_after_another(trial, book):
    surveys = []
    for name, changes in (("1st", {}), ("2nd", {"emplaced_2": "no"}), ("3rd", {})):
        sheet = fill_in(trial, **changes)
        surveys.append(survey_plan(trial / "plan.csv", sheet, trial / f"{name}.csv")[1])
    assert [line["number"] for line in surveys] == [2, 3, 4], "the last survey counts"
    assert survey_plan(trial / "plan.csv", sheet, trial / "3rd.csv")[1]["number"] == 4
    assert len(read_register(book)) == 4


def test_a_target_outside_the_lane_is_told(trial, caplog):
    caplog.set_level("INFO")
    x, y = read_table(trial / "plan.csv", "truth")[["x", "y"]].iloc[2] + [10.0, 0.0]
    sheet = fill_in(trial, emplaced_x_m_2=f"{x:.3f}", emplaced_y_m_2=f"{y:.3f}")
    survey_plan(trial / "plan.csv", sheet, trial / "truth.csv", within=20.0)
    assert "filled.csv: 1 of 8 targets lie outside the lane" in caplog.text


@pytest.mark.parametrize("within", [np.nan, np.inf, -1.0])
def test_a_difference_that_is_believed_has_bounds(trial, within):
    with pytest.raises(ValueError, match="within must be finite and not negative"):
        survey_plan(trial / "plan.csv", fill_in(trial), trial / "truth.csv", within=within)
