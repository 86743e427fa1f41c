"""What the server process of worker processes does once."""

import subprocess
import sys

import pytest

CODE = """
import gc
from flgpr.jobs import job
before = gc.get_freeze_count()
import flgpr.jobs.preload
after = gc.get_freeze_count()
print(before, after > 1000, job.code_versions.cache_info().currsize, job.processor.cache_info().currsize)
"""


@pytest.mark.slow("runs in processes of its own")
def test_what_every_worker_asks_for_is_there_before_the_first_is_forked():
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.split() == ["0", "True", "1", "1"]
