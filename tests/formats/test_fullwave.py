"""Full-wave lanes in their archive."""

import json

import numpy as np
import pytest

from flgpr.formats import import_fullwave

SCANS, TX, RX, TONES = 3, 2, 2, 4


def archive(path, **changes):
    """Write a lane of two transmitters and two receivers that moves by 1 m a scan."""
    rng = np.random.default_rng(4)
    shape = (SCANS, TX, RX, 2, TONES)
    way = np.zeros((SCANS, 1, 3))
    way[:, 0, 1] = np.arange(SCANS)
    arrays = {
        "data": rng.normal(size=shape) + 1j * rng.normal(size=shape),
        "frequency_hz": 1e9 + 1e8 * np.arange(TONES),
        "polarisation": np.array(["HH", "VV"]),
        "tx_xyz_m": way + [[-0.5, 0.0, 1.0], [0.5, 0.0, 1.0]],
        "rx_xyz_m": way + [[-0.2, 0.3, 1.0], [0.2, 0.3, 1.0]],
    } | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path, arrays


def test_pairs_run_over_the_receivers_of_every_transmitter(tmp_path):
    path, arrays = archive(tmp_path / "a.npz")
    lane = import_fullwave(path)
    run = lane.run
    assert lane.truth is None
    assert lane.objects is None
    np.testing.assert_allclose(run["pose"].values[:, :3], [[0, k, 1.0] for k in range(SCANS)])
    np.testing.assert_allclose(run["tx_position"].values[:, 0], [-0.5, -0.5, 0.5, 0.5])
    np.testing.assert_allclose(run["rx_position"].values[:, 0], [-0.2, 0.2, -0.2, 0.2])
    for pair in range(TX * RX):
        wanted = arrays["data"][:, pair // RX, pair % RX]
        np.testing.assert_allclose(run["signal"].values[:, :, pair], wanted, rtol=1e-6)


def test_the_truth_is_that_of_its_world(tmp_path):
    world = {
        "mines": [["metal", 0.5, 4.0, 0.1]],
        "mine_radius_m": 0.15,
        "rocks": [[1.0, 2.0, 0.05]],
        "soil_eps": 4.5,
    }
    path, _ = archive(tmp_path / "a.npz", truth=np.array(json.dumps(world)))
    lane = import_fullwave(path)
    (mine,) = lane.truth.to_dict("records")
    assert (mine["target_id"], mine["kind"], mine["depth"]) == ("mine-1", "metal", 0.1)
    assert mine["radius"] == 0.15
    assert np.isnan(mine["height"])
    assert lane.objects["kind"].tolist() == ["rock"]
    assert lane.run.attrs["soil"] == {"permittivity": 4.5, "conductivity": 0.0}


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"tx_xyz_m": None}, "the archive must hold .*; missing: tx_xyz_m"),
        (
            {"data": np.ones((SCANS, TX, 2, TONES))},
            r"data must be \(scan, tx, rx, .*got \(3, 2, 2, 4\)",
        ),
        ({"rx_xyz_m": np.zeros((SCANS, 3, 3))}, r".*rx_xyz_m \(scan, rx, 3\), got .*\(3, 3, 3\)"),
        (
            {"rx_xyz_m": np.random.default_rng(1).normal(size=(SCANS, RX, 3))},
            "the array must keep its form and heading from scan to scan",
        ),
    ],
)
def test_archives_that_do_not_fit_are_refused(changes, rule, tmp_path):
    path, _ = archive(tmp_path / "a.npz", **changes)
    with pytest.raises(ValueError, match=rf"a\.npz: {rule}"):
        import_fullwave(path)
