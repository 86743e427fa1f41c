import numpy as np
import pytest

from flgpr.calibrate import channel_health, health_summary
from flgpr.model import make_run


def made(change=None, standing=3.0):
    rng = np.random.default_rng(2)
    shape = (16, 2, 5, 30)
    clutter = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    own = standing * (rng.normal(size=shape[1:]) + 1j * rng.normal(size=shape[1:]))
    signal = clutter + own
    if change is not None:
        change(signal, own)
    pose = np.zeros((16, 6))
    return make_run(
        signal, 1e9 + 1e7 * np.arange(30), ["HH", "VV"], np.zeros((5, 3)), np.zeros((5, 3)), pose
    )


def test_a_healthy_array_is_left_in_peace():
    table = channel_health(made())
    assert not table["dead"].any()
    assert len(table) == 10
    # the standing part has 9 times the clutter's power
    np.testing.assert_allclose(table["coherence"], 0.9, atol=0.05)
    assert health_summary(table) == ["all 10 channels are alive, none drifts"]


def test_dead_channels_are_named():
    def change(signal, own):
        signal[:, 0, 1] *= 0.01
        signal[:, 1, 3] = 0
        signal[:, 1, 4] = np.nan
        signal[:, 0, 2] = signal[0, 0, 2]

    table = channel_health(made(change)).set_index(["polarization", "pair"])
    assert table.index[table["dead"]].tolist() == [("HH", 1), ("HH", 2), ("VV", 3), ("VV", 4)]
    assert table.loc[("HH", 1), "level_db"] == pytest.approx(-40, abs=1.5)
    assert table.loc[("VV", 4), "missing"] == 16
    assert table.loc[("HH", 2), "stuck"] == 1
    assert (
        "4 of 10 channels are dead: HH pair 1, HH pair 2" in health_summary(table.reset_index())[0]
    )


def test_drift_is_measured_from_the_standing_part():
    def change(signal, own):
        ramp = np.linspace(0, 1, 16)[:, None]
        factor = 10 ** (ramp * 3 / 20) * np.exp(0.5j * ramp)
        signal[:, 1, 2] += own[1, 2] * (factor - 1)

    table = channel_health(made(change, standing=10.0)).set_index(["polarization", "pair"])
    # last quarter against first: 12/15 of the ramp
    assert table.loc[("VV", 2), "gain_drift_db"] == pytest.approx(2.4, abs=0.3)
    assert table.loc[("VV", 2), "phase_drift_rad"] == pytest.approx(0.4, abs=0.05)
    assert table["gain_drift_db"].drop(("VV", 2)).abs().max() < 1
    assert "1 of 10 channels with a standing part drift" in health_summary(table.reset_index())[0]


def test_clutter_alone_is_not_called_drift():
    table = channel_health(made(standing=0.0))
    assert table["coherence"].max() < 0.3
    assert health_summary(table) == ["all 10 channels are alive"]
    assert health_summary(table[:1]) == ["the channel is alive"]


def test_one_scan_tells_no_drift():
    table = channel_health(made().isel(scan=[0]))
    assert table["gain_drift_db"].isna().all()
    assert not table["dead"].any()
