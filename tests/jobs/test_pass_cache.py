"""Results of passes that jobs share: by which name, and what is told of their cost."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.jobs.checkpoint import PassCache, begin_work
from flgpr.jobs.job import make_job
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    home = tmp_path_factory.mktemp("job")
    save_run(small_run(scans=3), home / "run.zarr")
    return make_job(home / "run.zarr", small_recipe(), LANE, home / "result")


def test_a_pass_is_shared_by_name_only_with_a_pass_cache(job, tmp_path):
    depends_on = {"recipe": "what the pass reads of it"}
    assert PassCache(job).name_of("signature", depends_on) is None
    cached = replace(job, pass_cache=str(tmp_path), output=str(tmp_path / "a"))
    assert PassCache(cached).name_of("signature", None) is None
    name = PassCache(cached).name_of("signature", depends_on)
    assert len(name) == 32
    other = replace(cached, output=str(tmp_path / "b"), recipe="other")
    assert PassCache(other).name_of("signature", depends_on) == name
    assert PassCache(cached).name_of("gain", depends_on) != name
    assert PassCache(cached).name_of("signature", {}) != name
    other_run = PassCache(replace(cached, store_sha256="other"))
    assert other_run.name_of("signature", depends_on) != name


def test_what_a_job_leaves_another_takes_with_what_it_cost(job, tmp_path):
    first = replace(job, pass_cache=str(tmp_path / "cache"), output=str(tmp_path / "first"))
    second = replace(first, output=str(tmp_path / "second"), recipe="other")
    cost = {"lane": "first", "seconds": 2.0, "processor_seconds": 1.0, "peak_bytes": 5}
    block = {"lane": "first", "seconds": 1.0, "processor_seconds": 0.5, "peak_bytes": 9}
    with begin_work(first) as work, begin_work(second) as other_work:
        assert PassCache(second).take("a" * 32, other_work, "signature") is None
        work["signature"] = {"gains": np.arange(3.0)}
        PassCache(first).leave("a" * 32, work, "signature", [block, cost])
        reported = PassCache(second).take("a" * 32, other_work, "signature")
        assert other_work["signature"]["gains"].tolist() == [0.0, 1.0, 2.0]
    assert reported == {"lane": "second", "seconds": 3.0, "processor_seconds": 1.5, "peak_bytes": 9}
