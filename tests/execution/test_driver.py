"""One lane from run to result: in one piece, in sections, resumed and left as it is."""

from dataclasses import replace

import pytest

from flgpr.chain.lane_setup import LaneSetup
from flgpr.execution.driver import detect_lane, passes_of_lane
from flgpr.execution.job import make_job
from flgpr.execution.workers import InProcess
from flgpr.results.result import read_result
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("driver") / "run.zarr"
    save_run(small_run(scans=4), path)
    return path


def job_of(run, output):
    return make_job(run, small_recipe(), LANE, output, report=False)


def test_a_result_is_written_and_no_work_folder_stays(run, tmp_path):
    job = job_of(run, tmp_path / "result")
    reports = []
    with InProcess() as executor:
        assert detect_lane(job, executor, note=reports.append) == [tmp_path / "result"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]
    assert len(read_result(tmp_path / "result").detections) == 1
    assert reports


def test_a_whole_result_is_left_as_it_is_unless_it_is_to_be_overwritten(run, tmp_path, caplog):
    job = job_of(run, tmp_path / "result")
    reports = []
    with InProcess() as executor:
        detect_lane(job, executor)
        with caplog.at_level("INFO", "flgpr.outputs"):
            again = detect_lane(job, executor, note=reports.append, overwrite=False)
        assert again == [tmp_path / "result"]
        assert reports == []
        assert "result exists already" in caplog.text
        detect_lane(job, executor, note=reports.append)
        assert reports


def test_what_does_not_fit_is_refused_before_anything_is_written(run, tmp_path):
    small = replace(job_of(run, tmp_path / "result"), max_memory=1000)
    with InProcess() as executor, pytest.raises(ValueError, match="memory"):
        detect_lane(small, executor)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "own.txt").write_text("own")
    with InProcess() as executor, pytest.raises(FileExistsError, match="notes"):
        detect_lane(job_of(run, tmp_path / "notes"), executor)
    assert (tmp_path / "notes" / "own.txt").read_text() == "own"


def test_passes_without_explanations_leave_their_results_in_the_lane(run, tmp_path):
    job = job_of(run, tmp_path / "result")
    with InProcess() as executor, passes_of_lane(job, executor) as lane:
        assert isinstance(lane, LaneSetup)
        assert not lane.explains
        assert {"signature", "gain", "view", "alarms", "features"} <= set(lane.results)
    assert not (tmp_path / "result").exists()
