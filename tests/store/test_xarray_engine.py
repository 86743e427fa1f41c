import tomllib
from importlib import import_module
from pathlib import Path

import pytest
import xarray as xr

from flgpr.store import RunStoreError, save_run
from flgpr.store.xarray_engine import RunStoreBackend

ROOT = Path(__file__).parents[2]


@pytest.fixture
def store(small_run, tmp_path):
    return save_run(small_run, tmp_path / "a.zarr")


def test_the_engine_is_the_one_that_the_package_declares():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module, name = project["entry-points"]["xarray.backends"]["flgpr"].split(":")
    assert getattr(import_module(module), name) is RunStoreBackend


def test_a_run_has_units_and_names_of_its_variables(store, small_run):
    run = xr.open_dataset(store, engine=RunStoreBackend)
    assert run["frequency"].attrs["units"] == "Hz"
    assert all(run[name].attrs["long_name"] for name in run.data_vars)
    xr.testing.assert_equal(run.load(), small_run)
    assert run.attrs == small_run.attrs


def test_variables_may_be_left_out(store):
    assert "pose" not in xr.open_dataset(store, engine=RunStoreBackend, drop_variables="pose")
    few = xr.open_dataset(store, engine=RunStoreBackend, drop_variables=["pose", "valid"])
    assert set(few.data_vars) == {"signal", "tx_position", "rx_position"}


def test_scans_are_verified_when_they_are_read(store):
    run = xr.open_dataset(store, engine=RunStoreBackend)
    chunk = store / "signal" / "c" / "1" / "0" / "0" / "0"
    chunk.write_bytes(bytes(len(chunk.read_bytes())))
    with pytest.raises(RunStoreError, match="signal/c/1"):
        run["signal"][1].load()
    with pytest.raises(RunStoreError, match="max_memory"):
        xr.open_dataset(store, engine=RunStoreBackend, max_memory=10)


def test_only_run_stores_are_claimed(store, tmp_path):
    engine = RunStoreBackend()
    assert engine.guess_can_open(store)
    assert engine.guess_can_open(str(store))
    assert not engine.guess_can_open(tmp_path)
    assert not engine.guess_can_open(tmp_path / "missing")
    assert not engine.guess_can_open(b"bytes")
    other = tmp_path / "other"
    other.mkdir()
    (other / "commit.json").write_text("{}")
    assert not engine.guess_can_open(other)
    with pytest.raises(FileNotFoundError):
        engine.open_dataset(tmp_path / "missing")
