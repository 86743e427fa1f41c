"""All ten features against the paper's equations, alarm by alarm and scan by scan."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.features import (
    FEATURES,
    POLARIMETRIC,
    FeatureSettings,
    FeatureSums,
    PatchShape,
    local_contrast,
)
from flgpr.model import Grid
from reference import wang2007

GRID = Grid.spanning((-2.0, 2.0), (1.0, 6.0), 0.05)
POLARIZATIONS = ["HH", "VV", "HV"]
SUBBANDS = ["F1", "F2"]
POSES = [np.array([0.0, y, 5.0, 0.0, 0.0, 0.0]) for y in (0.0, 0.5, 1.0)]
ALARMS = pd.DataFrame({"x": [0.1, -0.35], "y": [4.0, 4.5]}, index=[7, 3])


@pytest.fixture
def scans():
    rng = np.random.default_rng(11)
    shape = (3, 2, *GRID.shape)
    return [
        (
            rng.random(shape).astype(np.float32) + 0.1,
            (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype("c8"),
        )
        for _ in POSES
    ]


def features_of(scans, settings=None, poses=POSES):
    sums = FeatureSums(ALARMS, POLARIZATIONS, SUBBANDS, GRID, settings)
    for (magnitude, coherent), pose in zip(scans, poses, strict=True):
        sums.add(magnitude, coherent, pose)
    return sums.table()


def patches_of(scans, x, y, band, step, half):
    """Patches (magnitude or complex) of every scan, cut pixel by pixel: the alarms lie on pixel centres."""
    found = []
    for which, pose in zip(scans, POSES, strict=True):
        row = round((y - pose[1] - GRID.y_min) / 0.05)
        column = round((x - GRID.x_min) / 0.05)
        found.append(which[:, band, row - step * half : row + step * half + 1 : step,
                           column - step * half : column + step * half + 1 : step])  # fmt: skip
    return found


def test_scans_taken_in_at_once_are_those_taken_in_one_by_one(scans):
    sums = FeatureSums(ALARMS, POLARIZATIONS, SUBBANDS, GRID)
    sums.add_all(
        (magnitude, coherent, pose)
        for (magnitude, coherent), pose in zip(scans, POSES, strict=True)
    )
    pd.testing.assert_frame_equal(sums.table(), features_of(scans), check_exact=True)


@pytest.mark.parametrize("psi", ["circular", "linear"])
@pytest.mark.parametrize("swap", [False, True])
def test_the_ten_features_are_equations_6_to_17(scans, swap, psi):
    settings = FeatureSettings(psi=psi)
    inner, guard = ((3, 5), (7, 9)) if swap else ((5, 3), (9, 7))
    got = features_of(scans, settings.swapped() if swap else settings)
    assert got.index.tolist() == [7, 3]
    assert list(got.columns) == ["scans"] + [
        f"{name}_{band}" for band in SUBBANDS for name in FEATURES
    ]
    for alarm, (x, y) in ALARMS.iterrows():
        for b, band in enumerate(SUBBANDS):
            magnitude = patches_of([m for m, _ in scans], x, y, b, 2, 12)
            coherent = patches_of([c for _, c in scans], x, y, b, 1, 5)
            want = wang2007.equations_6_to_17_features(magnitude, coherent, inner, guard, psi)
            for name in FEATURES:
                assert got.loc[alarm, f"{name}_{band}"] == pytest.approx(
                    want[name], rel=1e-5, abs=1e-6
                ), name


@pytest.mark.parametrize("wanted", [("F2",), ("F1",), ()])
def test_polarimetric_features_of_some_sub_bands_leave_the_others_out(scans, wanted):
    whole = features_of(scans)
    some = features_of(scans, FeatureSettings(polarimetric=wanted))
    left_out = [
        f"{name}_{band}" for band in SUBBANDS if band not in wanted for name in POLARIMETRIC
    ]
    assert some[left_out].isna().all(axis=None)
    pd.testing.assert_frame_equal(some.drop(columns=left_out), whole.drop(columns=left_out))


def test_contrast_agrees_with_the_single_feature_routine():
    rng = np.random.default_rng(6)
    grid = Grid.spanning((-2.0, 2.0), (1.0, 7.0), 0.1)
    coords = {"polarization": ["HH"], "subband": ["F1"], "y": grid.y, "x": grid.x}
    images = [
        xr.DataArray(
            rng.random((1, 1, *grid.shape)).astype("c8"),
            dims=tuple(coords),
            coords=coords,
            attrs={"pose": list(pose)},
        )
        for pose in POSES
    ]
    alarms = pd.DataFrame(
        {"x": [0.13, 1.4], "y": [4.04, 6.9]}
    )  # between pixels, and near the border
    sums = FeatureSums(alarms, POLARIZATIONS, ["F1"], grid, FeatureSettings(y_max=10))
    for one in images:
        block = np.repeat(one.values, 3, axis=0)
        sums.add(np.abs(block).astype(np.float32), block, np.asarray(one.attrs["pose"]))
    want = local_contrast(images, alarms, "HH", "F1", 10)
    np.testing.assert_allclose(sums.table()["C_HH_F1"], want["contrast"], rtol=1e-4)
    np.testing.assert_array_equal(sums.table()["scans"], want["scans"])


def test_what_calibration_changes_and_what_not(scans):
    gain = np.array([3.0, 0.5, 7.0], np.float32)[:, None, None, None]
    plain = features_of(scans)
    common = features_of([(9 * m, (9 * np.exp(1j) * c).astype("c8")) for m, c in scans])
    each = features_of([(gain * m, c) for m, c in scans])
    for band in SUBBANDS:
        free = [f"{name}_{band}" for name in FEATURES if not name.startswith("M_")]
        np.testing.assert_allclose(common[free], plain[free], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(common[f"M_HH_{band}"], 9 * plain[f"M_HH_{band}"], rtol=1e-5)
        own = [f"C_{pol}_{band}" for pol in ("HH", "VV")]
        np.testing.assert_allclose(each[own], plain[own], rtol=1e-4)
        np.testing.assert_allclose(
            each[f"R_HH_HV_{band}"], 3 / 7 * plain[f"R_HH_HV_{band}"], rtol=1e-4
        )


def test_scans_beyond_y_max_or_out_of_sight_do_not_count(scans):
    near = features_of(scans, FeatureSettings(y_max=3.6))
    assert near["scans"].tolist() == [2, 1]
    away = features_of(scans, poses=[pose + [50.0, 0, 0, 0, 0, 0] for pose in POSES])
    assert away["scans"].tolist() == [0, 0]
    assert away.drop(columns="scans").isna().all().all()


def test_bad_input():
    with pytest.raises(ValueError, match="HH, VV and HV"):
        FeatureSums(ALARMS, ["HH", "VV"], SUBBANDS, GRID)
    with pytest.raises(ValueError, match="odd"):
        FeatureSettings(inner=(4, 3))
    with pytest.raises(ValueError, match="psi"):
        FeatureSettings(psi="none")
    FeatureSums(ALARMS.iloc[:0], POLARIZATIONS, SUBBANDS, GRID, FeatureSettings(patch=PatchShape()))
