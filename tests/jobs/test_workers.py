"""Who does the work."""

import pytest

from flgpr.jobs.job import processor
from flgpr.jobs.workers import InProcess, Processes, RunOptions, StoppedError


def test_options_choose_who_does_the_work():
    assert isinstance(RunOptions().executor(), InProcess)
    processes = RunOptions(workers=3).executor()
    assert isinstance(processes, Processes)
    assert processes.count == 3
    with pytest.raises(ValueError, match="workers and scheduler exclude each other, got 2 and tcp"):
        RunOptions(workers=2, scheduler="tcp://host:8786").executor()
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        RunOptions(workers=0).executor()


def test_work_that_was_stopped_is_not_begun():
    executor = Processes(1)
    executor.stop()
    with pytest.raises(StoppedError, match="the work was stopped"):
        list(executor.run(processor, [()]))
