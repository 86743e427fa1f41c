import threading

import numba
import pytest

from flgpr.jit.threads import share


@pytest.mark.parametrize("count", [0, 1, 7, 1000])
@pytest.mark.parametrize("step", [None, 3])
def test_every_item_is_worked_on_once(count, step):
    done = []
    share(count, lambda begin, end: done.extend(range(begin, end)), step)
    assert sorted(done) == list(range(count))


def test_an_error_in_a_task_reaches_the_caller():
    def fail(begin, end):
        raise RuntimeError(f"task {begin}")

    with pytest.raises(RuntimeError, match="task"):
        share(100, fail)
    done = []
    share(10, lambda begin, end: done.append(begin), step=10)
    assert done == [0]


def test_one_thread_works_alone():
    most = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        order = []
        share(9, lambda begin, end: order.append(begin), step=2)
    finally:
        numba.set_num_threads(most)
    assert order == [0, 2, 4, 6, 8]


def test_what_is_small_is_done_by_the_caller_in_one_part():
    done = []
    share(9, lambda begin, end: done.append((begin, end, threading.get_ident())), alone=True)
    assert done == [(0, 9, threading.get_ident())]
