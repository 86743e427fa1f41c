"""Passes handed out block by block, by an executor that only takes note of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.chain.engine import block_name
from flgpr.chain.progress import silent
from flgpr.execution.checkpoint import begin
from flgpr.execution.job import LaneJob, do_block, do_finish, do_merge
from flgpr.execution.pass_runner import PassRunner

COST = {"seconds": 1.0, "processor_seconds": 2.0, "peak_bytes": 10}


class Noting:
    """Does no work, and leaves what the work would leave."""

    def __init__(self, work):
        self.work = work
        self.asked = []

    def run(self, work, arguments, threads=1):
        for piece in arguments:
            self.asked.append((work, *piece[1:]))
            if work is do_block:
                self.work[block_name(*piece[1:])] = {}
            if work is do_merge:
                self.work[piece[1]] = {}
            yield COST | {"piece": piece[1:]}


@pytest.fixture
def job(tmp_path):
    return LaneJob(
        run="run.zarr", recipe="", lane=(0.0, 1.0, 0.0, 1.0), model=None,
        output=str(tmp_path / "result"), report=True, store_sha256="a", model_sha256="",
        code=(), cpu="",
    )  # fmt: skip


@pytest.fixture
def work(job):
    with begin(job.work, job.identity()) as opened:
        yield opened


def engine(*names):
    passes = {name: SimpleNamespace(name=name, title=f"title of {name}") for name in names}
    blocks = {"signature": [0, 1, 2], "alarms": []}
    return SimpleNamespace(passes=passes, block_numbers=blocks.__getitem__)


def runner_of(executor, notes, labels, *names):
    def track(items, label, total):
        labels.append((label, total))
        return silent(items, label, total)

    return PassRunner(executor, lambda _: engine(*names), track, notes.append, threads=1)


def test_blocks_are_done_and_merged_pass_by_pass_and_all_is_reported(job, work):
    executor, notes, labels = Noting(work), [], []
    runner = runner_of(executor, notes, labels, "signature", "alarms")
    runner.run(job, work, lambda _: True, "lane: ")
    assert executor.asked == [
        (do_block, "signature", 0),
        (do_block, "signature", 1),
        (do_block, "signature", 2),
        (do_merge, "signature", (0, 1, 2)),
        (do_merge, "alarms", ()),
    ]
    assert labels == [("lane: title of signature", 3)]  # nothing is shown of a pass without blocks
    assert len(notes) == 5


def test_what_the_work_folder_has_is_not_done_again(job, work):
    work["signature-000001"] = {}
    executor, notes, labels = Noting(work), [], []
    runner = runner_of(executor, notes, labels, "signature", "alarms")
    work["alarms"] = {}
    runner.run(job, work, lambda _: True)
    blocks = [piece[2] for piece in executor.asked if piece[0] is do_block]
    assert blocks == [0, 2]
    assert labels == [("title of signature", 2)]
    executor.asked.clear()
    runner.run(job, work, lambda _: True)
    assert executor.asked == []


def test_early_merged_blocks_are_not_done_again(job, work):
    work["signature-so-far"] = {"next": np.array(2)}
    executor = Noting(work)
    runner_of(executor, [], [], "signature").run(job, work, lambda _: True)
    assert executor.asked[0] == (do_block, "signature", 2)
    assert executor.asked[1] == (do_merge, "signature", (0, 1, 2))


def test_only_chosen_passes_are_done(job, work):
    executor = Noting(work)
    runner = runner_of(executor, [], [], "signature", "alarms")
    runner.run(job, work, lambda planned: planned.name == "alarms")
    assert executor.asked == [(do_merge, "alarms", ())]


def test_the_result_is_written_under_a_label_of_its_own(job, work):
    executor, notes, labels = Noting(work), [], []
    runner_of(executor, notes, labels).finish(job, "section-01: ")
    assert executor.asked == [(do_finish,)]
    assert labels == [("section-01: writing the result", 1)]
    assert len(notes) == 1
