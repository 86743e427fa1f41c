"""The description of a run in a manifest."""

import numpy as np
import pytest

from flgpr.results.description import describe_run, left_out_scans, plausible_poses
from flgpr.store import open_run, read_manifest, sample_lane
from live_lane import make_lane_run

LANE = sample_lane() / "run.zarr"


@pytest.fixture(scope="module")
def run():
    return open_run(LANE)


def test_counts_band_and_poses_are_the_runs(run):
    description = describe_run(run, LANE)
    assert description["scans"] == run.sizes["scan"]
    assert description["polarizations"] == run["polarization"].values.tolist()
    assert description["frequency_hz"] == run["frequency"].values[[0, -1]].tolist()
    assert description["pose"] == run["pose"].values.tolist()
    assert description["store_sha256"] == read_manifest(LANE)["sha256"]
    assert "motion" not in description
    assert "path" not in describe_run(run)


def test_missing_sweeps_and_implausible_poses_leave_scans_out():
    changed = make_lane_run(scans=12)
    changed["valid"].values[1] = False
    changed["pose"].values[5, 1] += 5000.0
    description = describe_run(changed)
    assert description["masked_scans"] == [1]
    assert description["motion"]["scans"] == [5]
    assert description["motion"]["notes"]
    assert left_out_scans(description) == [1, 5]
    poses = plausible_poses(description)
    np.testing.assert_array_equal(poses, np.delete(changed["pose"].values, 5, axis=0))


def test_descriptions_of_older_versions_are_read():
    assert left_out_scans({"masked_scans": [3]}) == [3]
    assert plausible_poses({}).shape == (0, 6)
