"""Where a run and its result lie: on paths, and in a temporary folder that nobody has to delete.

That a result without an output lives as long as its object is tested with the command.
"""

import xarray as xr

from flgpr.commands.runs import RunLocations, is_in_memory
from small_lane import small_run


def test_a_run_is_in_memory_unless_it_is_a_path(tmp_path):
    assert not is_in_memory("run.zarr")
    assert not is_in_memory(tmp_path)
    assert is_in_memory(xr.Dataset())


def test_stored_runs_stay_where_they_are(tmp_path):
    with RunLocations("run.zarr", tmp_path / "out", {"x": tmp_path / "x.zarr"}) as locations:
        assert str(locations.run) == "run.zarr"
        assert locations.other_runs == {"x": tmp_path / "x.zarr"}
        assert locations.output == tmp_path / "out"
    assert not list(tmp_path.iterdir())


def test_runs_in_memory_are_stored_until_the_work_ends(tmp_path):
    run = small_run(scans=3)
    with RunLocations(run, tmp_path / "out", {"x": run}) as locations:
        assert locations.run.is_dir()
        assert locations.other_runs["x"].is_dir()
        home = locations.run.parent
    assert not home.exists()
