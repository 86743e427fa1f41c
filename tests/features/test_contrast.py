import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.features import ContrastSums, PatchShape, local_contrast
from flgpr.model import Grid
from reference.wang2007 import equation_7_contrast, equation_7_mean_over_scans

X = -2.0 + 0.1 * np.arange(41)
Y = 1.0 + 0.1 * np.arange(61)


def image(values, pose_y):
    coords = {"polarization": ["HH"], "subband": ["F1"], "y": Y, "x": X}
    attrs = {"pose": [0.0, pose_y, 1.5, 0.0, 0.0, 0.0]}
    data = values.astype(np.complex64)[None, None] * np.exp(0.7j)
    return xr.DataArray(
        data, dims=("polarization", "subband", "y", "x"), coords=coords, attrs=attrs
    )


@pytest.fixture
def images():
    rng = np.random.default_rng(6)
    return [image(rng.random((61, 41)), pose_y) for pose_y in (0.0, 0.5, 1.0)]


def test_contrast_is_equation_7(images):
    alarms = pd.DataFrame({"x": [0.1, -0.3], "y": [4.0, 4.5]})
    got = local_contrast(images, alarms, "HH", "F1", y_max=10, patch=PatchShape())
    for i, (x, y) in enumerate(zip(alarms["x"], alarms["y"], strict=True)):
        top = bottom = 0.0
        for one in images:
            row = round((y - one.attrs["pose"][1] - 1.0) / 0.1)
            column = round((x + 2.0) / 0.1)
            patch = np.abs(one.values[0, 0, row - 12 : row + 13, column - 12 : column + 13])
            m_in, c = equation_7_contrast(patch, (5, 3), (9, 7))
            top, bottom = top + m_in * c, bottom + m_in
        assert got["contrast"][i] == pytest.approx(top / bottom, rel=1e-4)
    assert got["scans"].tolist() == [3, 3]


def test_scans_beyond_y_max_do_not_count(images):
    alarms = pd.DataFrame({"x": [0.0], "y": [4.0]})
    assert local_contrast(images, alarms, "HH", "F1", y_max=3.2)["scans"].item() == 1


def test_contrast_does_not_depend_on_calibration(images):
    alarms = pd.DataFrame({"x": [0.0], "y": [4.0]})
    louder = [one.copy(data=7 * one.values) for one in images]
    a, b = (
        local_contrast(them, alarms, "HH", "F1", 10)["contrast"].item() for them in (images, louder)
    )
    assert a == pytest.approx(b, rel=1e-5)


def test_an_alarm_nobody_sees_has_no_contrast_and_no_alarms_no_rows(images):
    far = pd.DataFrame({"x": [50.0], "y": [4.0]})
    assert np.isnan(local_contrast(images, far, "HH", "F1", 10)["contrast"].item())
    assert local_contrast(images, far.iloc[:0], "HH", "F1", 10).empty


def test_patches_that_reach_over_the_border_count_by_what_is_left_of_them(images):
    rng = np.random.default_rng(8)
    alarms = pd.DataFrame(
        {"x": rng.uniform(-2.5, 2.5, 40), "y": rng.uniform(0.5, 8.5, 40)}, index=np.arange(40) + 7
    )
    plain = [(Y, X, np.abs(one.values[0, 0]), one.attrs["pose"]) for one in images]
    contrast, scans = equation_7_mean_over_scans(plain, alarms, y_max=4.5)
    got = local_contrast(images, alarms, "HH", "F1", y_max=4.5)
    np.testing.assert_allclose(got["contrast"], contrast, rtol=1e-5)
    np.testing.assert_array_equal(got["scans"], scans)
    assert 0 < got["scans"].gt(0).sum() < 40
    assert got.index.tolist() == alarms.index.tolist()
    sums = ContrastSums(alarms, Grid(X[0], Y[0], X.size, Y.size, 0.1, 0.1), 4.5)
    for one in images:
        sums.add(np.abs(one.values[0, 0]), np.asarray(one.attrs["pose"]))
    pd.testing.assert_frame_equal(sums.table(), got, rtol=1e-5)


def test_without_an_image_no_scan_counts():
    alarms = pd.DataFrame({"x": [0.0], "y": [4.0]})
    table = local_contrast([], alarms, "HH", "F1", y_max=10)
    assert np.isnan(table["contrast"].item())
    assert table["scans"].item() == 0
