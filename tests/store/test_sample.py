"""The packaged lanes are there, and their tables are as the documentation says."""

import pytest

from flgpr.store import SAMPLE_LANES, read_manifest, read_table, sample_lane


@pytest.mark.parametrize("name", SAMPLE_LANES)
def test_a_packaged_lane_is_complete(name):
    folder = sample_lane(name)
    assert (folder / "README.md").is_file()
    assert read_manifest(folder / "run.zarr")["scans"] > 0
    assert len(read_table(folder / "truth.csv", "truth")) > 0
    kinds = {"rock", "post"} if name == "lane-a" else {"rock", "stone"}
    assert set(read_table(folder / "objects.csv", "objects")["kind"]) == kinds


def test_a_lane_that_is_not_packaged_is_refused():
    with pytest.raises(ValueError, match=r"name must be one of lane-a, .*got '\.\./drive'"):
        sample_lane("../drive")
