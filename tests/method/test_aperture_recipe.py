"""A run that is one synthetic aperture: its image, its recipe, and detection that finds reflectors where they are."""

import json

import numpy as np
import pandas as pd
import pytest

import flgpr
from calibrate.echoes import echo
from flgpr.commands.replay import replay
from flgpr.imaging import ScanImager, aperture_blocks, aperture_image
from flgpr.method.method import detect
from flgpr.model import aperture, aperture_pose, aperture_run, lane_to_scan, make_run, way_weights
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import lane_of, parse_recipe
from flgpr.store import save_run

FREQUENCY = np.linspace(2.0e9, 3.0e9, 81)  # ranges repeat after 12 m
MARKS = np.array([[2.0, -1.0, 0.0], [3.0, 1.2, 0.0]])


def rail(heading=np.pi / 2, waits=20, noise=0.3):
    """An antenna that goes along y at x = -3 m, looks along +x and waits at the beginning."""
    rng = np.random.default_rng(5)
    y = np.append(np.full(waits, -1.5), np.linspace(-1.5, 1.5, 61) + rng.normal(0, 0.005, 61))
    pose = np.zeros((y.size, 6))
    pose[:, 0] = -3.0
    pose[:, 1] = y
    pose[:, 2] = 1.5
    pose[:, 3] = heading
    signal = echo(pose[:, :3], pose[:, :3], MARKS, FREQUENCY)
    signal = signal + noise * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))
    return make_run(
        signal[:, None, None], FREQUENCY, ["VV"], [[0, 0, 0]], [[0, 0, 0]], pose, np.arange(y.size)
    )


def test_the_image_of_the_aperture_is_the_weighted_sum_of_its_scans():
    run = rail()
    run["valid"][30] = False
    taken = aperture_run(run)
    recipe = parse_recipe(fit_recipe(rail()))
    assert dict(taken["signal"].sizes) == {
        "scan": 1,
        "polarization": 1,
        "pair": 80,
        "frequency": 81,
    }
    imager = ScanImager(taken, recipe.image.grid(), {"all": (2e9, 3e9)}, "hann")
    image = imager.image(0)
    points = recipe.image.grid().points()
    pose = aperture_pose(run)
    np.testing.assert_allclose(pose, taken["pose"].values[0])
    places = (
        np.linalg.inv(turn(pose))
        @ np.append(points.reshape(-1, 3), np.ones((points[..., 0].size, 1)), axis=1).T
    )
    lane = places[:3].T.reshape(points.shape)
    np.testing.assert_allclose(lane_to_scan(lane, pose), points, atol=1e-9)
    scans = np.delete(np.arange(81), 30)
    weights = np.zeros(81)
    weights[scans] = way_weights(run["pose"].values[scans, :3])
    slow = aperture_image(run, lane, aperture_blocks(run, scans), weights, window="hann")
    assert np.abs(image.values[0, 0] - slow[0]).max() < 2e-3 * np.abs(slow).max()


def turn(pose):
    """Matrix (4, 4) from the lane to the scan frame of a level pose: x' = x cos - y sin, y' = x sin + y cos."""
    c = np.cos(pose[3])
    s = np.sin(pose[3])
    move = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    move[:2, 3] = -move[:2, :2] @ pose[:2]
    return move


@pytest.mark.parametrize("heading", [np.pi / 2, np.pi / 2 + 0.3])
def test_a_radar_that_moves_past_reflectors_finds_them_where_they_are(heading):
    run = rail(heading)
    recipe = parse_recipe(fit_recipe(run))
    assert recipe.image.frames == "all"
    alarms = detect(run, recipe).alarms
    top = alarms[["x", "y"]].to_numpy()[:2]
    assert np.linalg.norm(top[np.argsort(top[:, 1])] - MARKS[:, :2], axis=1).max() < 0.08
    assert alarms["confidence"][1] > 3 * alarms["confidence"][2:].max()


@pytest.mark.slow("images every scan alone")
def test_without_summing_the_scans_the_reflectors_are_arcs():
    """The experiment that could prove the aperture needless."""
    run = rail()
    lone = fit_recipe(run).replace('frames = "all"', "frames = 1")
    alarms = detect(run, parse_recipe(lone), lane_of(run, parse_recipe(fit_recipe(run)))).alarms
    near = [
        np.linalg.norm(alarms[["x", "y"]].to_numpy()[:2] - mark[:2], axis=1).min() for mark in MARKS
    ]
    assert max(near) > 0.3


@pytest.mark.slow("detects three times")
def test_stored_detection_is_that_in_memory_and_is_replayed(tmp_path):
    run = rail()
    save_run(run, tmp_path / "rail.zarr")
    (tmp_path / "r.toml").write_text(fit_recipe(run))
    recipe = parse_recipe(fit_recipe(run))
    folder = flgpr.detect(tmp_path / "rail.zarr", tmp_path / "r.toml", tmp_path / "found").folder
    stored = pd.read_csv(folder / "alarms.csv")
    there = detect(run, recipe)
    np.testing.assert_allclose(stored[["x", "y"]], there.alarms[["x", "y"]])
    assert (
        np.isfinite(there.view.values).mean() > 0.95
    )  # the image is upright in the lane: it covers all of it
    assert json.loads((folder / "view" / "index.json").read_text())["aperture"] is True
    assert replay(folder)["identical"]


def test_what_an_aperture_cannot_do_is_refused(monkeypatch):
    text = fit_recipe(rail())
    for more in ('self_signature = "mean"', None):
        bad = (
            text.replace('self_signature = "none"', more)
            if more
            else text + '\n[[clutter]]\nstage = "standing"\n'
        )
        with pytest.raises(ValueError, match="flgpr prepare"):
            parse_recipe(bad)
    assert any("image.frames" in reason for reason in parse_recipe(text).not_live_because())
    run = rail()
    run["valid"][:] = False
    with pytest.raises(ValueError, match="without missing sweeps"):
        aperture_run(run)
    monkeypatch.setattr(aperture, "_LARGEST", 1e4)
    with pytest.raises(ValueError, match="at most 1e-05 GB"):
        aperture_run(rail())


def test_a_vehicle_that_drives_ahead_keeps_its_scans():
    run = rail(heading=0.0)
    assert parse_recipe(fit_recipe(run)).image.frames == 1


def test_a_vehicle_that_drives_there_and_back_keeps_its_scans():
    run = rail(waits=0)
    pose = run["pose"].values
    pose[:, 3] = np.where(np.arange(len(pose)) < 31, 0.0, np.pi - 0.01)
    pose[:, 0] = np.where(np.arange(len(pose)) < 31, -3.0, 1.0)
    assert parse_recipe(fit_recipe(run)).image.frames == 1
    with pytest.raises(ValueError, match="head one way"):
        aperture_pose(run)
