"""What a recipe depends on is read off a run: antennas, course, and whether it moves across."""

import numpy as np
import pytest

from flgpr.recipe.radar_setup import RadarSetup, allow_features, goes_across, radar_setup
from recipe.test_recipe_for_run import bare_run


def _setup_of(poses):
    antennas = np.array([[-1.0, 0.5, 2.0], [1.0, 0.5, 2.0]])
    return RadarSetup(["HH"], 1e9 + 5e6 * np.arange(20), antennas, antennas, np.array(poses))


def test_antennas_of_a_run_stand_in_the_scan_frame():
    setup = radar_setup(bare_run())
    assert setup.polarizations == [str(label) for label in bare_run()["polarization"].values]
    assert setup.height == pytest.approx((setup.tx + setup.rx)[:, 2].mean() / 2)
    assert not setup.aperture


def test_a_drive_has_enough_scans_far_enough_apart():
    drive = np.zeros((5, 6))
    drive[:, 1] = 0.5 * np.arange(5)
    assert _setup_of(drive).drives
    assert not _setup_of(drive[:4]).drives
    assert not _setup_of(drive * [1, 0.9, 1, 1, 1, 1]).drives


def test_how_far_behind_the_earliest_of_several_scans_lies():
    drive = np.zeros((4, 6))
    drive[:, 1] = [0.0, 1.0, 3.0, 4.0]
    assert _setup_of(drive).behind(1) == 0
    assert _setup_of(drive).behind(2) == 2
    assert _setup_of(drive).behind(3) == 3


def test_features_need_both_co_polarized_channels_and_a_cross_polarized_one():
    assert allow_features(["HH", "VV", "VH"])
    assert not allow_features(["HH", "VV"])
    assert not allow_features(["HH", "HV"])


def test_a_radar_that_drives_on_does_not_go_across():
    assert not goes_across(bare_run())
