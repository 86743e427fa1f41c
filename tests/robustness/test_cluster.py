"""A Dask cluster gives the same bytes, and a worker that is killed costs only what it was at."""

import os
import signal
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager

import pytest

import flgpr
from robust import content

pytestmark = pytest.mark.slow("starts a Dask cluster")

distributed = pytest.importorskip("distributed")
ENVIRONMENT = {**os.environ, "NUMBA_NUM_THREADS": "1", "DASK_LOGGING__DISTRIBUTED": "error"}


@contextmanager
def dask(*arguments):
    """A process of Dask's command line."""
    command = [sys.executable, "-m", "dask", *map(str, arguments)]
    process = subprocess.Popen(
        command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def scheduler():
    with distributed.LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster:
        yield cluster.scheduler_address


@contextmanager
def workers(scheduler, count, home):
    with dask(*worker(scheduler, home)) as first:
        if count == 1:
            yield [first]
            return
        with workers(scheduler, count - 1, home) as others:
            yield [first, *others]


def worker(scheduler, home):
    options = [
        "--nthreads",
        1,
        "--no-nanny",
        "--no-dashboard",
        "--death-timeout",
        60,
        "--local-directory",
        home,
    ]
    return ["worker", scheduler, *options]


def test_a_cluster_gives_the_same_bytes_and_a_killed_worker_costs_only_what_it_was_at(
    lane, scheduler, tmp_path
):
    done = []
    at_kill = {}
    with workers(scheduler, 2, tmp_path / "dask") as processes:

        def note(report):
            done.append(report)
            pids = Counter(int(one["worker"].split(":")[1]) for one in done)
            if not at_kill and len(pids) == 2 and len(done) >= 5:
                victim = int(report["worker"].split(":")[1])
                next(process for process in processes if process.pid == victim).send_signal(
                    signal.SIGKILL
                )
                at_kill.update(victim=victim, done=len(done))

        result = flgpr.detect(
            *lane.arguments, tmp_path / "result", lane.area, scheduler=scheduler, report=False, note=note
        )  # fmt: skip
    assert content(result.folder) == lane.content
    pieces = [(report["stage"], report["block"]) for report in done]
    assert len(pieces) == len(set(pieces)) == 4 * (lane.blocks + 1) + 2
    victims = [
        number
        for number, report in enumerate(done)
        if report["worker"].endswith(f":{at_kill['victim']}")
    ]
    assert victims
    assert max(victims) < at_kill["done"]
    again = [report for report in done[at_kill["done"] :] if report["seconds"] < 1e-3]
    assert len(again) <= 1  # a piece that was written but not yet reported is not made again


def test_the_messages_do_not_grow_with_the_images(lane):
    """What goes through the scheduler per piece: the job, the stage and a number one way, a report the other."""
    from distributed.protocol import serialize_bytes

    from flgpr.jobs.pieces import do_block
    from robust import small_job

    job = small_job(lane, lane.home / "other")
    assert len(serialize_bytes((do_block, job, "signature", 3))) < 8000


def test_no_scheduler_is_said_plainly(lane, tmp_path, monkeypatch):
    monkeypatch.setattr("flgpr.jobs.workers._PATIENCE", "0.5s")
    with pytest.raises(ValueError, match="scheduler must be the address"):
        flgpr.detect(*lane.arguments, tmp_path / "result", lane.area, scheduler="tcp://127.0.0.1:9")
    with pytest.raises(ValueError, match="exclude"):
        flgpr.detect(
            *lane.arguments,
            tmp_path / "result",
            lane.area,
            scheduler="tcp://127.0.0.1:9",
            workers=2,
        )
    assert list(tmp_path.iterdir()) == []
