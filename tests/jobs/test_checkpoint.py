"""The work folder: groups of arrays that are whole or absent, and who may use it."""

from types import SimpleNamespace

import numpy as np
import pytest

from flgpr import system
from flgpr.engine import sum_accumulator
from flgpr.jobs import checkpoint
from flgpr.jobs.checkpoint import (
    BlockCheckpoint,
    Checkpoint,
    WorkError,
    begin,
    begin_work,
    block_name,
    finish,
    work_until_done,
)
from flgpr.jobs.job import make_job
from flgpr.method.sections import Section
from flgpr.store import BundleError, save_run
from small_lane import LANE, small_recipe, small_run

JOB = {"run": "abc"}


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "result.work"


def damage(path):
    """Change a byte of an array of ones in a file of its own: others may be links to the old one."""
    data = bytearray(path.read_bytes())
    data[data.rfind(np.ones(2).tobytes())] ^= 1
    path.unlink()
    path.write_bytes(bytes(data))


def summed():
    """Return an accumulator that adds up the indices of scans."""
    sums = {"total": np.zeros(1), "count": np.zeros(1, np.int64)}

    def add(index):
        sums["total"] += index
        sums["count"] += 1

    return sum_accumulator(sums, add)


def test_groups_are_read_as_they_were_written_and_the_latest_is_forgotten_when_it_changes(folder):
    with begin(folder, JOB) as work:
        work["signature"] = {"total": np.arange(3.0)}
        np.testing.assert_array_equal(work["signature"]["total"], [0, 1, 2])
        work["signature"] = {"total": np.arange(2.0)}
        np.testing.assert_array_equal(work["signature"]["total"], [0, 1])
        assert (list(work), len(work), work.size("signature") > 0) == (["signature"], 1, True)
        del work["signature"]
        assert "signature" not in work
        assert work.size("signature") == 0
        with pytest.raises(KeyError):
            work["signature"]


def test_a_job_continues_and_another_begins_anew(folder):
    with begin(folder, JOB) as work:
        work["gain"] = {"total": np.ones(2)}
    with begin(folder, JOB) as work:
        assert list(work) == ["gain"]
    with begin(folder, {"run": "other"}) as work:
        assert list(work) == []
    finish(folder)
    assert not folder.exists()


def test_damaged_groups_are_deleted_and_named(folder):
    with begin(folder, JOB) as work:
        work["gain"] = {"total": np.ones(2)}
        work["view"] = {"total": np.ones(2)}
        damage(work.path("view"))
        assert work.drop_damaged() == ["view"]
        assert list(work) == ["gain"]


def test_one_process_uses_a_work_folder_at_a_time(folder):
    with (
        begin(folder, JOB),
        pytest.raises(WorkError, match="/result: another process is at work on it"),
        begin(folder, JOB),
    ):
        pass


def test_a_folder_of_somebody_else_is_refused(folder):
    folder.mkdir()
    (folder / "letter.txt").write_text("mine")
    with (
        pytest.raises(FileExistsError, match=r"must hold nothing else, got .*letter\.txt"),
        begin(folder, JOB),
    ):
        pass
    assert (folder / "letter.txt").read_text() == "mine"


class ThreeBlocks:
    """An engine with one pass that adds up three blocks."""

    def __init__(self):
        self.passes = {"gain": SimpleNamespace(all_scans=True, keep_blocks=False)}

    def block_numbers(self, _):
        return range(3)

    def merge_blocks(self, _, states):
        merged = summed()
        for state in states:
            merged.merge(state)
        return merged


def test_one_process_merges_states_at_a_time(folder, monkeypatch):
    monkeypatch.setattr(checkpoint, "MERGE_BYTES", 0)
    with begin(folder, JOB) as work:
        for number in range(3):
            block = summed()
            block.add(number)
            work[block_name("gain", number)] = block.state(True)
        with open(folder / "folding", "ab") as other:
            system.lock(other)
            work.merge_ahead(ThreeBlocks(), "gain")
            assert work.merged_blocks("gain") == 0
        work.merge_ahead(ThreeBlocks(), "gain")
        assert work.merged_blocks("gain") == 3
        (merged,) = work.block_states("gain", [])
        assert (merged["total"], merged["count"]) == (0 + 1 + 2, 3)


def test_a_group_is_copied_if_it_is_whole(folder, tmp_path):
    with begin(folder, JOB) as work:
        work["gain"] = {"total": np.ones(2)}
        shared = tmp_path / "shared"
        shared.mkdir()
        other = Checkpoint(shared)
        assert other.take(work, "gain", "abc")
        np.testing.assert_array_equal(other["abc"]["total"], [1, 1])
        assert not other.take(work, "view", "def")
        damage(work.path("gain"))
        assert not other.take(work, "gain", "ghi")
    assert list(other) == ["abc"]


def test_a_block_continues_after_the_last_state_that_was_stored(folder):
    block = range(4, 10)
    with begin(folder, JOB) as work:
        gatherer = summed()
        scans = BlockCheckpoint(work, "sum-000001", every=0.0)(block, gatherer)
        for _ in range(3):
            gatherer.add(next(scans))
        scans.close()
        again = summed()
        checkpoint = BlockCheckpoint(work, "sum-000001", every=0.0)
        left = []
        for index in checkpoint(block, again):
            left.append(index)
            again.add(index)
        assert left == [6, 7, 8, 9]  # the third scan was in progress
        assert again.result()["total"] == sum(block)
        assert again.result()["count"] == len(block)
        checkpoint.drop()
        assert list(work) == []


def test_the_number_of_merged_blocks_survives_a_file_that_is_replaced_while_it_is_read(
    tmp_path, monkeypatch
):
    with begin(tmp_path / "work", {}) as work:
        assert work.merged_blocks("gain") == 0
        work["gain-so-far"] = {"total": np.zeros(100), "next": np.array(3)}
        assert work.merged_blocks("gain") == 3
        original = type(work).bundle
        replaced = []

        def bundle(self, name):
            opened = original(self, name)
            if not replaced:
                replaced.append(name)
                self[name] = {"total": np.ones(100), "next": np.array(5)}
            return opened

        monkeypatch.setattr(type(work), "bundle", bundle)
        assert work.merged_blocks("gain") == 5
        assert replaced == ["gain-so-far"]


def test_blocks_are_missing_that_are_neither_there_nor_merged(tmp_path):
    with begin(tmp_path / "work", {}) as work:
        assert work.missing_blocks("gain", range(4)) == [0, 1, 2, 3]
        work["gain-000002"] = {}
        assert work.missing_blocks("gain", range(4)) == [0, 1, 3]
        work["gain-so-far"] = {"next": np.array(2)}
        assert work.missing_blocks("gain", range(4)) == [3]


def test_a_damaged_state_of_merged_blocks_is_an_error(tmp_path):
    with begin(tmp_path / "work", {}) as work:
        work["gain-so-far"] = {"next": np.array(3)}
        path = work.path("gain-so-far")
        data = bytearray(path.read_bytes())
        position = data.rfind(np.array(3).tobytes())
        data[position] ^= 1
        path.write_bytes(bytes(data))
        with pytest.raises(BundleError, match="next differs from what was written"):
            work.merged_blocks("gain")


@pytest.fixture
def job(tmp_path):
    save_run(small_run(scans=3), tmp_path / "run.zarr")
    return make_job(tmp_path / "run.zarr", small_recipe(), LANE, tmp_path / "result")


def test_the_work_of_another_division_of_the_lane_is_begun_anew(job):
    sections = [Section(0, 5), Section(5, 9)]
    with begin_work(job, sections) as work:
        work["signature"] = {}
    with begin_work(job, sections) as work:
        assert list(work) == ["signature"]
    with begin_work(job) as work:
        assert list(work) == []


def test_the_work_of_a_job_that_is_done_is_deleted_and_that_of_a_stopped_one_stays(job):
    def stop_after_a_pass():
        with work_until_done(job) as work:
            work["signature"] = {}
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop_after_a_pass()
    with work_until_done(job) as work:
        assert list(work) == ["signature"]
    assert not job.work.exists()
