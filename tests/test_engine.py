"""Blocks of scans: sums over blocks are sums over scans."""

import threading
import time

import numba
import numpy as np
import pytest

from flgpr.clutter import BackgroundEstimator
from flgpr.engine import (
    BLOCK,
    Accumulator,
    Engine,
    PlannedPass,
    blocks_of,
    run_pieces,
    sum_accumulator,
    worker_state,
)
from flgpr.model import Grid
from flgpr.screen import RunViewSums


@pytest.mark.parametrize("scans", [1, 2, 15, 16, 17, 100, 600])
def test_blocks_hold_every_scan_once_and_are_even(scans):
    blocks = blocks_of(scans)
    assert [scan for block in blocks for scan in block] == list(range(scans))
    sizes = [len(block) for block in blocks]
    assert max(sizes) <= BLOCK
    assert max(sizes) - min(sizes) <= 1


def test_a_background_of_blocks_is_that_of_all_scans():
    rng = np.random.default_rng(3)
    images = (
        rng.normal(size=(11, 2, 2, 31, 29)) + 1j * rng.normal(size=(11, 2, 2, 31, 29))
    ).astype(np.complex64)
    images += 3
    plain = BackgroundEstimator((5, 5), (11, 11), 2)
    for image in images:
        plain.add_signature(image)
    for image in images:
        plain.add_gain(image)
    folded = BackgroundEstimator((5, 5), (11, 11), 2)
    for block in (range(0, 4), range(4, 8), range(8, 11)):
        part = BackgroundEstimator((5, 5), (11, 11), 2)
        for scan in block:
            part.add_signature(images[scan])
        folded.take_first(part.first_sums())
    first = folded.first_result()
    for block in (range(0, 4), range(4, 8), range(8, 11)):
        part = BackgroundEstimator((5, 5), (11, 11), 2)
        part.continue_from(first, slice(block.start, block.stop))
        for scan in block:
            part.add_gain(images[scan])
        folded.take_second(part.second_sums())
    for name, value in vars(plain.result()).items():
        np.testing.assert_allclose(getattr(folded.result(), name), value, rtol=2e-6)
    np.testing.assert_array_equal(np.stack(plain.gains), first["gains"])
    with pytest.raises(ValueError, match="shape"):
        folded.take_first({"shape": np.array([1, 2, 31, 29]), "gains": np.ones((1, 1, 2))})


def test_a_run_view_of_parts_in_any_order_is_exactly_that_of_all_scans():
    rng = np.random.default_rng(4)
    lane = Grid.spanning((-1, 1), (0, 8), 0.1)
    image = Grid.spanning((-1.5, 1.5), (1, 3), 0.05)
    values = rng.random((9, 2, *image.shape), dtype=np.float32)
    poses = [np.array([0.03 * k, 0.7 * k - 1, 2, 0.02 * k, 0, 0]) for k in range(9)]
    plain = RunViewSums(lane, 2.5)
    folded = RunViewSums(lane, 2.5)
    for one, pose in zip(values, poses, strict=True):
        plain.add(one, image, pose)
    for block in (range(6, 9), range(0, 3), range(3, 6)):
        reach = [plain.reach(image, poses[k]) for k in block]
        rows = slice(min(r.start for r in reach), max(r.stop for r in reach))
        assert rows.stop - rows.start < lane.ny
        part = RunViewSums(lane, 2.5, rows)
        for k in block:
            part.add(values[k], image, poses[k])
        folded.merge(part.state())
    for got, want in zip(folded.result(), plain.result(), strict=True):
        np.testing.assert_array_equal(got, want)


def test_sums_without_a_scan_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        BackgroundEstimator().first_sums()
    with pytest.raises(ValueError, match="at least one"):
        BackgroundEstimator().second_sums()
    with pytest.raises(ValueError, match="at least one"):
        RunViewSums(Grid.spanning((0, 1), (0, 1), 0.1), 1).state()


class Counted:
    """An engine of two passes: the sum of the scans' numbers, then how many lie above their mean."""

    def __init__(self, scans):
        self.added = []
        self.results = {}
        passes = (
            PlannedPass("sum", "adding", self._sum),
            PlannedPass("above", "comparing", self._above),
        )
        self.engine = Engine(passes, scans, self.results)

    def _gathered(self, count):
        state = {"n": np.array(0.0), "scans": np.array(0)}

        def add(place):
            self.added.append(place)
            state["n"], state["scans"] = state["n"] + count(place), state["scans"] + 1

        def merge(other):
            state.update({name: state[name] + other[name] for name in state})

        return Accumulator(add, lambda exact: dict(state), merge, lambda: dict(state))

    def _sum(self, block):
        return self._gathered(float)

    def _above(self, block):
        total = self.results["sum"]
        return self._gathered(lambda place: place > total["n"] / total["scans"])


class Slow(Engine):
    """Sums of numbers of all magnitudes, which show another order; the first block takes longest."""

    numbers_ = np.random.default_rng(1).standard_normal(200) * 10.0 ** np.arange(200)

    def __init__(self, concurrent):
        super().__init__([PlannedPass("sum", "sum", self._start)], self.numbers_.size, {})
        self.workers = set()
        self.concurrent = concurrent

    def _start(self, block):
        total = np.zeros(1)

        def add(index):
            self.workers.add(threading.current_thread().name)
            time.sleep(0.01 if index < 16 else 0.001)
            total[:] += self.numbers_[index]

        return sum_accumulator({"total": total}, add)


@pytest.fixture(params=[2, 4])
def threads(request, monkeypatch):
    """As on a machine of so many processors."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)
    return request.param


def test_threads_that_take_blocks_give_the_bits_of_one(threads):
    chain = Slow(False)
    several = Slow(True)
    chain.run()
    several.run()
    assert several.results["sum"]["total"] == chain.results["sum"]["total"]
    assert chain.workers == {"MainThread"}
    assert len(several.workers) == threads + 1  # the thirteenth block is left for this one


@pytest.mark.parametrize(("pieces", "left"), [(1, 1), (2, 0), (5, 1), (8, 0), (10, 2), (11, 0)])
def test_what_would_leave_most_threads_without_a_piece_is_shared(pieces, left, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: 4)
    names = list(
        run_pieces(
            lambda _: threading.current_thread().name, [(number,) for number in range(pieces)], 4
        )
    )
    assert [name == "MainThread" for name in names] == [False] * (pieces - left) + [True] * left


def test_an_error_ends_the_pieces_at_work_at_their_next_scan(threads):
    """The first piece that fails is told, whichever fails first, and none goes on in the background."""
    begun = threading.Event()
    gone = []

    class Broken(Slow):
        def _start(self, block):
            def add(index):
                if index == block.start == self.blocks[1].start:
                    begun.set()
                    assert worker_state.stop.wait(20)
                if block.start == 0:
                    assert begun.wait(20)
                    raise ValueError(f"scan {index} is broken")
                gone.append(index)

            return sum_accumulator({}, add)

    chain = Broken(True)
    with pytest.raises(ValueError, match="scan 0 is broken"):
        chain.run()
    second = chain.blocks[1]
    assert [index for index in gone if index in second] == [second.start]
    assert not [one for one in threading.enumerate() if one.name.startswith("flgpr-block")]
    assert not worker_state.stop.is_set()


def test_an_engine_does_its_passes_in_order_once_and_a_block_goes_on_where_it_was_kept():
    one = Counted(40)
    one.engine.run()
    assert (one.results["sum"]["n"], one.results["above"]["n"]) == (780, 20)
    assert one.added == 2 * list(range(40))
    one.engine.run()
    assert len(one.added) == 80  # what is known is not done again
    other = Counted(40)
    parts = [
        other.engine.gather_block("sum", number) for number in other.engine.block_numbers("sum")
    ]

    def resumed(block, gathered):
        gathered.merge({"n": np.array(float(block.start)), "scans": np.array(1)})
        yield from range(block.start + 1, block.stop)

    parts[1] = other.engine.gather_block("sum", 1, resumed)
    assert other.engine.merge_blocks("sum", parts).result()["n"] == 780
