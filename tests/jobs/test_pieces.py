"""What a process refuses to do of a job, and reports."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.jobs.job import make_job, processor
from flgpr.jobs.pieces import do_block, open_lane, report
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    home = tmp_path_factory.mktemp("job")
    save_run(small_run(scans=3), home / "run.zarr")
    return make_job(home / "run.zarr", small_recipe(), LANE, home / "result")


def test_a_worker_of_other_versions_names_them(job):
    other = tuple((name, "0.0" if name == "numpy" else value) for name, value in job.code)
    with pytest.raises(ValueError, match=rf"got numpy {np.__version__} and 0\.0"):
        do_block(replace(job, code=other), "signature", 0)


def test_a_worker_without_the_work_folder_names_it(job):
    with pytest.raises(
        ValueError, match=r"must see the work folder of the driver, got no .*\.work"
    ):
        do_block(job, "signature", 0)


def test_another_run_at_the_path_of_the_drivers_is_refused(job):
    with pytest.raises(ValueError, match="must see the run of the driver, got another at"):
        open_lane(replace(job, store_sha256="other"))


def test_a_report_counts_from_the_clocks_at_the_beginning():
    row = report("lane", "gain", 4, (0.0, 0.0), 12)
    assert (row["lane"], row["stage"], row["block"], row["bytes"]) == ("lane", "gain", 4, 12)
    assert row["seconds"] > 0
    assert row["processor_seconds"] > 0
    assert row["peak_bytes"] > 0
    assert row["cpu"] == processor()
