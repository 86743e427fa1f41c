"""The calculation of many workers: its limits are known in closed form."""

import importlib.util
import sys
from pathlib import Path

import pytest

spec = importlib.util.spec_from_file_location(
    "scaling", Path(__file__).parents[2] / "benchmarks/scaling.py"
)
scaling = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = scaling
spec.loader.exec_module(scaling)

FREE = {"driver": 0.0, "scheduler": 0.0, "latency": 0.0, "start": 0.0}
COSTS = {"blocks": [[1.0, 3.0], [], [2.0]], "merges": [0.5, 0.25, 0.0], "finish": 0.125}


def test_one_worker_takes_all_the_work_and_endless_ones_the_longest_way():
    costs = scaling.Costs(**COSTS, **FREE)
    blocks = 4
    work = 2 * (1 + 3) + blocks * (0.5 + 0.25 + 2 + 0.125)
    assert scaling.simulate(costs, [blocks] * 3, 1, 2) == pytest.approx(3 * work)
    assert scaling.simulate(costs, [blocks], 100, 1) == pytest.approx(3 + 2 + 1 + 2 + 0.5)


@pytest.mark.parametrize(
    ("cost", "seconds"),
    [("scheduler", 0.1 * 10 * 12), ("driver", 0.1 * 10), ("start", 0.1), ("latency", 0.1 * 10 * 6)],
)
def test_each_cost_alone_takes_what_it_must(cost, seconds):
    nothing = {"blocks": [[0.0], [], [0.0]], "merges": [0.0] * 3, "finish": 0.0}
    costs = scaling.Costs(**nothing, **FREE | {cost: 0.1})
    assert scaling.simulate(costs, [4] * 10, 100, 1) == pytest.approx(seconds)
    if cost != "start":
        assert scaling.bounds(costs, [4] * 10, 1)[
            cost if cost != "latency" else "a lane's own order"
        ] == pytest.approx(seconds)


def test_more_workers_are_never_slower_and_never_better_than_ideal():
    costs = scaling.Costs(**COSTS, **FREE | {"scheduler": 0.01, "driver": 0.1, "latency": 0.02})
    times = [scaling.simulate(costs, [7] * 20, workers, 5) for workers in (1, 2, 4, 8, 16)]
    assert times == sorted(times, reverse=True)
    assert all(times[0] / seconds <= 2**k for k, seconds in enumerate(times))
