from itertools import product

import numpy as np
import pytest
import xarray as xr

from flgpr.model import Grid, lane_to_scan
from flgpr.screen import MeanViewSums, run_view, select
from flgpr.screen.views import view_array
from reference.wang2007 import second_largest

GRID = Grid.spanning((-1.0, 1.0), (1.0, 4.0), 0.05)


def scan_image(value, pose):
    """Image whose magnitude is a plane in the lane frame, so that bilinear sampling is exact."""
    points = GRID.points()
    c = np.cos(pose[3])
    s = np.sin(pose[3])
    x = pose[0] + c * points[..., 0] + s * points[..., 1]
    y = pose[1] - s * points[..., 0] + c * points[..., 1]
    data = value(x, y)[None, None].astype(np.complex64)
    coords = {"polarization": ["HH"], "subband": ["F1"], "y": GRID.y, "x": GRID.x}
    return xr.DataArray(
        data, dims=("polarization", "subband", "y", "x"), coords=coords, attrs={"pose": list(pose)}
    )


POSES = [
    (0, 0, 1.5, 0, 0, 0),
    (0.2, 0.6, 1.5, 0.1, 0, 0),
    (-0.1, 1.3, 1.5, -0.2, 0, 0),
    (0.0, 9.0, 1.5, 0, 0, 0),
]
PLANES = [lambda x, y, k=k: 20 + (1 + k) * x - (2 - k) * y for k in range(4)]


@pytest.mark.parametrize("y_max", [2.5, 4.5])
def test_run_view_is_the_second_largest_over_the_scans_that_see_the_pixel(y_max):
    grid = Grid.spanning((-0.9, 0.9), (1.0, 5.0), 0.1)
    view = run_view([scan_image(f, p) for f, p in zip(PLANES, POSES, strict=True)], grid, y_max)
    x_min = GRID.x[0]
    x_max = GRID.x[-1]
    y_min = GRID.y[0]
    y_high = min(GRID.y[-1], y_max)
    checked = 0
    for iy, y in enumerate(grid.y):
        for ix, x in enumerate(grid.x):
            values = []
            for plane, pose in zip(PLANES, POSES, strict=True):
                local = lane_to_scan([x, y, 0.0], pose)
                near = min(
                    abs(local[0] - x_min),
                    abs(local[0] - x_max),
                    abs(local[1] - y_min),
                    abs(local[1] - y_high),
                )
                if near < 1e-6:
                    break  # exactly on an edge: rounding decides
                inside = x_min < local[0] < x_max and y_min < local[1] < y_high
                values.append(plane(x, y) if inside else np.nan)
            else:
                assert view.values[0, 0, iy, ix] == pytest.approx(
                    second_largest(values), rel=1e-5, nan_ok=True
                )
                assert view["looks"].values[iy, ix] == np.isfinite(values).sum()
                checked += 1
    assert checked > 500


def test_in_a_mean_view_near_looks_weigh_more():
    grid = Grid.spanning((-0.5, 0.5), (2.0, 2.4), 0.1)
    whole, parts = (MeanViewSums(grid, 3.5, falloff=2.0) for _ in range(2))
    for plane, pose in zip(PLANES[:3], POSES, strict=False):
        one = scan_image(plane, pose)
        part = MeanViewSums(grid, 3.5, falloff=2.0)
        for sums in (whole, part):
            sums.add(np.abs(one.values), GRID, np.asarray(pose))
        parts.merge(part.state())
    view, looks = whole.result()
    np.testing.assert_allclose(parts.result()[0], view)
    checked = 0
    for (iy, y), (ix, x) in product(enumerate(grid.y), enumerate(grid.x)):
        local = [lane_to_scan([x, y, 0.0], pose) for pose in POSES[:3]]
        edges = [(abs(a) - 1, 1 - b, b - 3.5) for a, b, _ in local]
        if any(abs(one) < 1e-6 for edge in edges for one in edge):
            continue  # exactly on an edge: rounding decides
        seen = [max(edge) < 0 for edge in edges]
        weight = np.array([max(np.hypot(a, b), 1) ** -2.0 for a, b, _ in local]) * seen
        values = np.array([plane(x, y) for plane in PLANES[:3]])
        assert looks[iy, ix] == sum(seen)
        if any(seen):
            assert view[0, 0, iy, ix] == pytest.approx(
                (weight * values).sum() / weight.sum(), rel=1e-5
            )
            checked += sum(seen) > 1
    assert checked > 30


def test_select_names_what_there_is():
    view = run_view([scan_image(PLANES[0], POSES[0])], Grid.spanning((-0.5, 0.5), (1, 2), 0.1), 5)
    assert select(view, "HH", "F1").dims == ("y", "x")
    with pytest.raises(ValueError, match="HH"):
        select(view, "VV", "F1")
    with pytest.raises(ValueError, match="at least one scan"):
        run_view([], GRID, 5)


def test_a_run_view_has_units_and_names():
    grid = Grid.spanning((0.0, 1.0), (0.0, 1.0), 0.5)
    size = (len(grid.y), len(grid.x))
    view = view_array(
        np.zeros((1, *size), np.float32), np.zeros(size, int), grid, {"polarization": ["HH"]}
    )
    assert view.attrs == {"units": "1", "long_name": "magnitude of the run-view"}
    assert view["y"].attrs["units"] == view["x"].attrs["units"] == "m"
    assert view["looks"].attrs["long_name"]
