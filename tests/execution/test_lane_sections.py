"""A lane in sections has the alarms of the lane in one piece."""

import json

import pandas as pd
import pytest

from flgpr.execution.driver import detect_lane
from flgpr.execution.job import make_job
from flgpr.execution.workers import InProcess
from flgpr.results.result import read_result
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The small lane, detected in one piece and in sections of 4 m at most."""
    home = tmp_path_factory.mktemp("sections")
    save_run(small_run(), home / "run.zarr")
    with InProcess() as executor:
        for name, longest in (("whole", None), ("cut", 4.0)):
            job = make_job(home / "run.zarr", small_recipe(), LANE, home / name, report=False)
            folders = detect_lane(job, executor, longest=longest)
    assert folders == [home / "cut" / "section-01", home / "cut" / "section-02"]
    return home


def test_the_table_of_all_alarms_is_that_of_one_piece(home):
    whole = read_result(home / "whole").detections[0].alarms
    table = pd.read_csv(home / "cut" / "alarms.csv")
    assert len(table) == len(whole)
    assert table["confidence"].is_monotonic_decreasing
    for name in ("x", "y", "confidence"):
        pd.testing.assert_series_equal(
            table[name].sort_values(ignore_index=True),
            whole[name].sort_values(ignore_index=True),
            check_dtype=False,
            rtol=1e-4,
        )


def test_alarms_name_their_sections(home):
    table = pd.read_csv(home / "cut" / "alarms.csv")
    for section in ("section-01", "section-02"):
        own = read_result(home / "cut" / section).detections[0].alarms
        wanted = {f"{section}/{name}" for name in own["alarm_id"]}
        assert wanted == {name for name in table["alarm_id"] if name.startswith(section)}


def test_the_folder_lists_its_sections_and_nothing_else_stays(home):
    names = {path.name for path in (home / "cut").iterdir()}
    assert names == {"section-01", "section-02", "alarms.csv", "lane.toml", "sections.json"}
    listed = json.dumps(json.loads((home / "cut" / "sections.json").read_text()))
    assert "section-01" in listed
    assert "section-02" in listed
    assert {path.name for path in home.iterdir()} == {"run.zarr", "whole", "cut"}
