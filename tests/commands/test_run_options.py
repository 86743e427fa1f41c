"""Options of commands that run recipes become the options of a run."""

from pathlib import Path

import pytest

from flgpr.commands.runs import run_options
from flgpr.jobs.workers import RunOptions


def test_what_is_not_given_keeps_its_default():
    assert run_options() == RunOptions(max_memory=2_000_000_000)


def test_what_is_given_arrives_under_its_name():
    reports = []
    options = run_options(3, None, "500MB", note=reports.append, pass_cache=Path("passes"))
    assert options.workers == 3
    assert options.max_memory == 500_000_000
    assert options.note == reports.append
    assert options.pass_cache == Path("passes")
    assert run_options(scheduler="tcp://a:1").scheduler == "tcp://a:1"


def test_a_size_without_a_unit_that_is_known_is_refused():
    with pytest.raises(ValueError, match="2 elephants"):
        run_options(max_memory="2 elephants")


def test_workers_and_a_scheduler_exclude_each_other():
    with pytest.raises(ValueError, match="exclude each other, got 2 and tcp://a:1"):
        run_options(workers=2, scheduler="tcp://a:1").executor()
