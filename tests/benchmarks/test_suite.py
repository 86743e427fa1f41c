"""Every benchmark of the suite runs, on small data: what is timed is what flgpr does today."""

import importlib
import inspect
import os
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow("runs the work of every benchmark")

HOME = Path(__file__).parents[2] / "benchmarks"
MODULES = sorted(
    path.stem for path in (HOME / "suite").glob("*.py") if path.stem not in ("__init__", "data")
)
KINDS = ("time_", "peakmem_", "track_")


@pytest.fixture
def suite(monkeypatch, tmp_path):
    """Import a module of the suite with small data, in a folder of its own, as asv does."""
    monkeypatch.setenv("FLGPR_BENCHMARK_SIZE", "small")
    monkeypatch.syspath_prepend(str(HOME))
    monkeypatch.chdir(tmp_path)
    source = str(HOME.parent / "src")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([source, os.environ.get("PYTHONPATH", "")]))
    yield lambda name: importlib.import_module(f"suite.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == "suite"]:
        del sys.modules[name]


def benchmarks_of(module):
    """Return the classes of a module that hold benchmarks."""
    classes = [
        found
        for _, found in inspect.getmembers(module, inspect.isclass)
        if found.__module__ == module.__name__
    ]
    return [found for found in classes if methods_of(found)]


def methods_of(benchmark):
    """Return the names of a class's benchmarks, one for each kind of work.

    ``peakmem_x`` does the work of ``time_x`` once more.
    """
    names = [name for name in dir(benchmark) if name.startswith(KINDS)]
    timed = {name.removeprefix("time_") for name in names if name.startswith("time_")}
    return [name for name in names if name.removeprefix("peakmem_") not in timed]


def first_parameters(benchmark):
    """Return the first value of every parameter, as asv hands them over."""
    params = getattr(benchmark, "params", ())
    if not params:
        return []
    several = all(isinstance(values, list) for values in params)
    return [values[0] for values in params] if several else [params[0]]


@pytest.mark.parametrize("name", MODULES)
def test_benchmarks_run(suite, name):
    module = suite(name)
    benchmarks = benchmarks_of(module)
    assert benchmarks, f"benchmarks/suite/{name}.py has no benchmark"
    for benchmark in benchmarks:
        case = benchmark()
        arguments = first_parameters(benchmark)
        if hasattr(case, "setup_cache"):
            arguments = [case.setup_cache(), *arguments]
        if hasattr(case, "setup"):
            case.setup(*arguments)
        for method in methods_of(benchmark):
            value = getattr(case, method)(*arguments)
            assert not method.startswith("track_") or value > 0, f"{benchmark.__name__}.{method}"


def test_small_is_small_and_full_is_full(suite, monkeypatch):
    assert suite("data").size(240, 24) == 24
    monkeypatch.delenv("FLGPR_BENCHMARK_SIZE")
    data = importlib.reload(sys.modules["suite.data"])
    assert data.size(240, 24) == 240
