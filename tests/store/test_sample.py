"""The packaged lane is there, and its tables are as its documentation says."""

from flgpr.store import read_manifest, read_table, sample_lane


def test_the_packaged_lane_is_complete():
    folder = sample_lane()
    assert (folder / "README.md").is_file()
    assert read_manifest(folder / "run.zarr")["scans"] > 0
    assert len(read_table(folder / "truth.csv", "truth")) > 0
    assert set(read_table(folder / "objects.csv", "objects")["kind"]) == {"rock", "post"}
