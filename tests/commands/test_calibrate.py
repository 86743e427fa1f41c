"""What the calibrations refuse, by the option that breaks its rule."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from calibrate.rough_ground import drive
from flgpr.commands.app import app
from flgpr.commands.calibrate import (
    calibrate_clock,
    calibrate_permittivity,
    calibrate_range_bias,
)
from flgpr.model import make_run
from flgpr.model.phase import path_phase
from flgpr.model.run import with_signal
from flgpr.store import open_run, save_run


@pytest.fixture
def stored(small_run, tmp_path):
    return save_run(small_run, tmp_path / "run.zarr")


@pytest.fixture
def reflectors(tmp_path):
    path = tmp_path / "reflectors.csv"
    path.write_text("x_m,y_m,z_m\n0,5,0\n")
    return path


@pytest.mark.parametrize("limits", [(5.0, 2.0), (4.0, 4.0), (0.5, 9.0), (2.0, float("inf"))])
def test_permittivities_increase_from_that_of_air(limits, stored):
    with pytest.raises(
        ValueError, match=f"increase from 1 or more, got {limits[0]:g}, {limits[1]:g}"
    ):
        calibrate_permittivity(stored, limits=limits)


def test_delays_below_a_hyperbola_are_doubted(tmp_path):
    tones = 0.2e9 + 10e6 * np.arange(101)
    pose = np.zeros((81, 6))
    pose[:, 1] = 0.05 * np.arange(81)
    way = 2 * np.sqrt(6.0) * np.hypot(pose[:, 1] - 1.5, 0.4)
    signal = np.array([path_phase(tones, np.array([path])) for path in way])[:, None]
    antenna = np.zeros((1, 3))
    save_run(make_run(signal, tones, ["HH"], antenna, antenna, pose), tmp_path / "line.zarr")
    fit = calibrate_permittivity(tmp_path / "line.zarr", delays=(1.0, 15.0), trials=21)
    assert (fit.place, 1e9 * fit.delay) == pytest.approx((1.5, 6.5), abs=0.7)
    assert fit.doubt == ""
    below = calibrate_permittivity(tmp_path / "line.zarr", delays=(9.0, 15.0), trials=21)
    assert below.doubt == ", the edge of the delays: do these hold the top of a hyperbola?"
    with pytest.raises(ValueError, match="trials must be three or more that increase, got 1"):
        calibrate_permittivity(tmp_path / "line.zarr", trials=1)


@pytest.mark.parametrize("search", [0.0, -1.0, float("nan")])
def test_a_search_for_a_bias_has_a_width(search, stored, reflectors):
    with pytest.raises(ValueError, match=f"search must be positive, got {search:g}"):
        calibrate_range_bias(stored, reflectors, search=search)


def test_a_clock_needs_a_track(stored):
    with pytest.raises((ValueError, OSError), match=r"run-track\.csv"):
        calibrate_clock(stored, area=(-1.0, 1.0, 4.0, 6.0), offsets=(-1.0, 1.0))


def test_what_is_refused_is_one_line_and_stores_nothing(stored, reflectors, tmp_path):
    words = ["calibrate", "range-bias", str(stored), "--reflectors", str(reflectors)]
    words += ["--search", "0", "-o", str(tmp_path / "new.zarr")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert done.output == "error: search must be positive, got 0\n"
    assert not (tmp_path / "new.zarr").exists()


@pytest.fixture
def driven(tmp_path):
    run = drive()
    pose = run["pose"].values.copy()
    pose[:, :3] += np.random.default_rng(5).normal(0, 0.01, (len(pose), 3))
    return save_run(run.assign(pose=(run["pose"].dims, pose)), tmp_path / "driven.zarr")


def test_poses_are_stored_with_what_they_were_moved_by(driven, tmp_path):
    new = tmp_path / "new.zarr"
    done = CliRunner().invoke(app, ["calibrate", "poses", str(driven), "-o", str(new)])
    assert done.exit_code == 0
    first, second = done.stdout.splitlines()[:2]
    assert first.startswith("along the line of sight a scan's pose was off by 1")
    assert second.startswith("so a sum over many scans from 0.5 to 1.33 GHz loses 0.")
    few = "the mean of 7 scans was left out of the search"
    assert few in done.stdout
    kept = CliRunner().invoke(app, ["calibrate", "poses", str(driven), "--keep-standing"])
    assert kept.exit_code == 0
    assert few not in kept.stdout
    moved = pd.read_csv(tmp_path / "new-poses.csv")
    before, after = (open_run(path) for path in (driven, new))
    change = (after["pose"] - before["pose"]).values
    np.testing.assert_allclose(
        moved[["x_moved_m", "y_moved_m", "z_moved_m"]], change[:, :3], atol=1e-6
    )
    assert np.abs(change[:, :3]).max() > 5e-3
    assert after.attrs["calibration"]["pose_error_m"] < 0.003
    np.testing.assert_array_equal(after["signal"].values, before["signal"].values)


def test_poses_that_the_ground_does_not_tell_are_not_stored(driven, tmp_path):
    run = open_run(driven)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=run["signal"].shape) + 1j * rng.normal(size=run["signal"].shape)
    noisy = save_run(with_signal(run, noise), tmp_path / "noise.zarr")
    new = tmp_path / "new.zarr"
    done = CliRunner().invoke(app, ["calibrate", "poses", str(noisy), "-o", str(new)])
    assert done.exit_code == 2
    assert "pairs of scans see the ground alike" in done.output
    assert not list(tmp_path.glob("new*"))
