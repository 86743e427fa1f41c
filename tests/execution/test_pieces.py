"""Pieces of work: what a process refuses, blocks that are merged early, and reports."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.execution.checkpoint import begin
from flgpr.execution.job import make_job, processor
from flgpr.execution.pieces import do_block, merged_blocks, open_lane, report
from flgpr.store import BundleError, save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    home = tmp_path_factory.mktemp("job")
    save_run(small_run(scans=3), home / "run.zarr")
    return make_job(home / "run.zarr", small_recipe(), LANE, home / "result")


def test_another_run_at_the_path_of_the_drivers_is_refused(job):
    with pytest.raises(ValueError, match="must see the run of the driver, got another at"):
        open_lane(replace(job, store_sha256="other"))


def test_a_worker_of_other_versions_names_them(job):
    other = tuple((name, "0.0" if name == "numpy" else value) for name, value in job.code)
    with pytest.raises(ValueError, match=rf"got numpy {np.__version__} and 0\.0"):
        do_block(replace(job, code=other), "signature", 0)


def test_a_worker_without_the_work_folder_names_it(job):
    with pytest.raises(
        ValueError, match=r"must see the work folder of the driver, got no .*\.work"
    ):
        do_block(job, "signature", 0)


def test_the_number_of_merged_blocks_survives_a_file_that_is_replaced_while_it_is_read(
    tmp_path, monkeypatch
):
    with begin(tmp_path / "work", {}) as work:
        assert merged_blocks(work, "gain") == 0
        work["gain-so-far"] = {"total": np.zeros(100), "next": np.array(3)}
        assert merged_blocks(work, "gain") == 3
        original = type(work).bundle
        replaced = []

        def bundle(self, name):
            opened = original(self, name)
            if not replaced:
                replaced.append(name)
                self[name] = {"total": np.ones(100), "next": np.array(5)}
            return opened

        monkeypatch.setattr(type(work), "bundle", bundle)
        assert merged_blocks(work, "gain") == 5
        assert replaced == ["gain-so-far"]


def test_a_damaged_state_of_merged_blocks_is_an_error(tmp_path):
    with begin(tmp_path / "work", {}) as work:
        work["gain-so-far"] = {"next": np.array(3)}
        path = work.path("gain-so-far")
        data = bytearray(path.read_bytes())
        position = data.rfind(np.array(3).tobytes())
        data[position] ^= 1
        path.write_bytes(bytes(data))
        with pytest.raises(BundleError, match="next differs from what was written"):
            merged_blocks(work, "gain")


def test_a_report_counts_from_the_clocks_at_the_beginning():
    row = report("lane", "gain", 4, (0.0, 0.0), 12)
    assert (row["lane"], row["stage"], row["block"], row["bytes"]) == ("lane", "gain", 4, 12)
    assert row["seconds"] > 0
    assert row["processor_seconds"] > 0
    assert row["peak_bytes"] > 0
    assert row["cpu"] == processor()
