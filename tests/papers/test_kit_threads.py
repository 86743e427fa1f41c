"""Studies run on one thread of the linear algebra, which does its small products fastest."""

from importlib import import_module

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from flgpr_papers import overview
from flgpr_papers.kit.study import one_blas_thread

pytestmark = pytest.mark.slow("studies of papers")


def threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_a_study_runs_on_one_blas_thread_and_gives_them_back():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert one_blas_thread(threads)() == {1}
        assert threads() == before

        @one_blas_thread
        def fails():
            raise OSError("stopped")

        with pytest.raises(OSError, match="stopped"):
            fails()
        assert threads() == before


@pytest.mark.parametrize(
    ("paper", "first"),
    [
        ("cosgrove2004", "study_recipe"),
        ("flsar2004", "load_settings"),
        ("fuse2018", "fuse_recipe"),
        ("wang2007", "lane_scenes"),
    ],
)
def test_every_study_has_one_blas_thread_while_it_runs(paper, first, tmp_path, monkeypatch):
    study = overview.study_of(paper)
    module = import_module(f"flgpr_papers.{paper}.study")
    seen = []

    def stop(*_, **__):
        seen.append(threads())
        raise InterruptedError

    monkeypatch.setattr(module, first, stop)
    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(InterruptedError):
            study.reproduce(tmp_path, True)
        if study.part is not None:
            with pytest.raises(InterruptedError):
                study.make_part(tmp_path, "1", True)
    assert seen
    assert all(one == {1} for one in seen)
