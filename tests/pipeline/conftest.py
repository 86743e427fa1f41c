"""One demo run for all tests of the pipeline."""

import pytest

from flgpr.pipeline import tasks


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    return tasks.demo(tmp_path_factory.mktemp("demo") / "result")
