"""Whether a result is there and whole, before anything is computed."""

from dataclasses import replace

import pytest

from flgpr.jobs.driver import detect_lane
from flgpr.jobs.finished import is_done, keeps_result, whole_results
from flgpr.jobs.job import make_job
from flgpr.jobs.workers import InProcess
from flgpr.method.sections import Section
from flgpr.results.sections import results_at
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    home = tmp_path_factory.mktemp("finished")
    save_run(small_run(scans=4), home / "run.zarr")
    job = make_job(home / "run.zarr", small_recipe(), LANE, home / "result", report=False)
    assert not keeps_result(job, [Section(0, 10)])
    assert not is_done(job)
    with InProcess() as executor:
        assert detect_lane(job, executor) == [home / "result"]
    return job


def test_a_whole_result_of_the_job_is_found(finished):
    job = finished
    one_piece = [Section(0, 10)]
    assert is_done(job)
    assert whole_results(job) == results_at(job.output)
    assert keeps_result(job, one_piece)
    assert [str(path) for path in results_at(job.output)] == [job.output]
    with_report = replace(job, report=True)
    assert whole_results(with_report) == []  # it lacks the report, and is completed
    assert not keeps_result(with_report, one_piece)


def test_a_result_of_another_job_is_refused(finished):
    job = finished
    other = replace(job, recipe=job.recipe.replace("density = 0.75", "density = 0.5"))
    assert not is_done(other)
    with pytest.raises(FileExistsError, match="choose another output"):
        keeps_result(other, [Section(0, 10)])
    with pytest.raises(FileExistsError, match="choose another output"):
        keeps_result(job, [Section(0, 5), Section(5, 10)])
    assert not keeps_result(other, [Section(0, 10)], overwrite=True)


def test_what_is_no_result_is_refused_even_where_results_are_overwritten(finished, tmp_path):
    (tmp_path / "own.txt").write_text("own")
    elsewhere = replace(finished, output=str(tmp_path))
    with pytest.raises(FileExistsError, match="output must be a new folder or an older result"):
        keeps_result(elsewhere, [Section(0, 10)], overwrite=True)
