"""flsar2004's prescreeners against loops and on images with a known answer."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.screen import (
    ClusterThresholds,
    Ellipse,
    energy_ratio,
    find_clusters,
    fit_ellipse,
    fuse_clusters,
    learn_thresholds,
    prescreen_clusters,
)
from reference import flsar2004

X = np.arange(-1.5, 1.51, 0.08)
Y = np.arange(0, 6.01, 0.04)


def learn(places, **more):
    return learn_thresholds([(image_of(np.ones((Y.size, X.size))), places)], Ellipse(1, 1), **more)


def image_of(values):
    return xr.DataArray(values, dims=("y", "x"), coords={"y": Y, "x": X})


def mine(x, y, peak, width=(0.14, 0.07)):
    return peak * np.exp(-(((X[None] - x) / width[0]) ** 2) - ((Y[:, None] - y) / width[1]) ** 2)


@pytest.fixture
def speckle():
    return np.random.default_rng(1).rayleigh(1.0, (Y.size, X.size))


def test_clusters_are_those_of_the_loop(speckle):
    table = find_clusters(image_of(speckle), 2.6, 0.2)
    slow = flsar2004.section_311_clusters(speckle, X, Y, 2.6, 0.2)
    assert len(table) == len(slow) > 20
    for row, ((x, y), amplitudes) in zip(table.itertuples(), slow, strict=True):
        assert (row.x, row.y) == pytest.approx((x, y))
        assert row.size == pytest.approx(len(amplitudes) * 0.08 * 0.04)
        assert (row.peak, row.mean, row.std) == pytest.approx(
            (max(amplitudes), np.mean(amplitudes), np.std(amplitudes))
        )


def test_energy_ratio_is_that_of_the_loop(speckle):
    ellipse = Ellipse(0.3, 0.2)
    places = [(0.0, 3.0), (0.51, 1.23), (-1.2, 5.7)]
    slow = [flsar2004.section_313_ratio(speckle, X, Y, u, v, 0.3, 0.2) for u, v in places]
    np.testing.assert_allclose(energy_ratio(image_of(speckle), places, ellipse), slow, rtol=1e-12)


def test_energy_ratio_tells_a_mine_from_what_is_too_large():
    ellipse = Ellipse(0.3, 0.15)
    small, large = energy_ratio(
        image_of(mine(0, 2, 5) + mine(0, 4, 5, (0.6, 0.5))), [(0, 2), (0, 4)], ellipse
    )
    assert small < 0.05
    assert large > 1
    # Even energy: the rectangle's area over the ellipse's, 16/π, less one.
    assert energy_ratio(image_of(np.ones((Y.size, X.size))), [(0, 3)], Ellipse(0.6, 0.5))[
        0
    ] == pytest.approx(16 / np.pi - 1, rel=0.05)
    assert energy_ratio(image_of(np.zeros((Y.size, X.size))), [(0, 3)], ellipse)[0] == np.inf


def test_prescreeners_in_sequence_keep_the_mine_and_drop_the_rest():
    scene = mine(0.5, 1.5, 6) + mine(-0.6, 3.0, 6, (0.05, 0.03)) + mine(0.3, 4.6, 6, (0.5, 0.5))
    scene = scene + mine(-0.9, 1.2, 1.5)
    limits = ClusterThresholds(2.0, 0.02, 1.6, 0.6)
    passed = prescreen_clusters(image_of(scene), limits, Ellipse(0.3, 0.16))
    assert len(passed) == 1
    assert (passed["x"][0], passed["y"][0]) == pytest.approx((0.5, 1.5), abs=0.05)
    spiky = ClusterThresholds(2.0, 0.02, 0.2, 0.6)
    assert prescreen_clusters(image_of(scene), spiky, Ellipse(0.3, 0.16)).empty


def test_nothing_above_the_threshold_is_an_empty_table():
    table = prescreen_clusters(
        image_of(np.zeros((Y.size, X.size))), ClusterThresholds(1, 0, 1, 1), Ellipse(0.3, 0.2)
    )
    assert table.empty
    assert "energy_ratio" in table.columns


def test_thresholds_let_the_stated_share_of_mines_through(speckle):
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(-1, 1, 12), np.linspace(0.5, 5.5, 12)])
    scene = 0.2 * speckle + sum(mine(x, y, rng.uniform(4, 8)) for x, y in places)
    ellipse = Ellipse(0.3, 0.16)
    for share in (1.0, 0.75):
        limits = learn_thresholds([(image_of(scene), places)], ellipse, reach=0.2, pass_share=share)
        passed = prescreen_clusters(image_of(scene), limits, ellipse)
        hit = [np.hypot(passed["x"] - x, passed["y"] - y).min() < 0.2 for x, y in places]
        assert np.mean(hit) >= 1 - 3 * (
            1 - share
        )  # three limits, each of which may give up its share
    weak = 0.2 * speckle + sum(mine(x, y, 0.3) for x, y in places)
    missed = prescreen_clusters(image_of(weak), limits, ellipse)
    assert len(missed) == 0


def test_every_training_mine_passes_the_thresholds_that_were_learnt_on_it(speckle):
    # Two flashes of almost the same strength and speckle between: the cluster is not the disc about
    # the peak.
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-1, 1, 12), np.linspace(0.5, 5.5, 12)])
    scene = 0.8 * speckle
    for x, y in places:
        peak = rng.uniform(3, 8)
        scene = scene + mine(x, y - 0.08, peak) + mine(x, y + 0.08, peak * rng.uniform(0.8, 1.2))
    ellipse = fit_ellipse(mine(0, 2.92, 5) + mine(0, 3.08, 5), (0.08, 0.04))
    limits = learn_thresholds([(image_of(scene), places)], ellipse, reach=0.3, pass_share=1.0)
    passed = prescreen_clusters(image_of(scene), limits, ellipse)
    assert all(np.hypot(passed["x"] - x, passed["y"] - y).min() <= 0.3 for x, y in places)
    # The limits are those of clusters, which reach beyond no limit set by a disc of the same
    # radius.
    clusters = find_clusters(image_of(scene), limits.amplitude)
    assert limits.std in clusters["std"].to_numpy()
    assert limits.size in clusters["size"].to_numpy()


def test_the_ellipse_lies_about_the_centroid_though_it_is_applied_at_the_brightest_pixel():
    two = mine(0, 2.9, 5) + mine(0, 3.1, 4.5)
    ellipse = fit_ellipse(two, (0.08, 0.04))
    row, column = np.unravel_index(two.argmax(), two.shape)
    power = two**2
    centroid = (Y[:, None] * power).sum() / power.sum()
    assert Y[row] + ellipse.offset_y == pytest.approx(centroid, abs=0.01)
    assert ellipse.offset_y > 0.05
    assert X[column] + ellipse.offset_x == pytest.approx(0, abs=1e-6)
    cluster = find_clusters(image_of(two), 2.0)[["x", "y"]].to_numpy()[:1]
    centred = energy_ratio(image_of(two), cluster, ellipse)[0]
    off = energy_ratio(image_of(two), cluster, Ellipse(ellipse.half_x, ellipse.half_y))[0]
    x, y = cluster[0] + [ellipse.offset_x, ellipse.offset_y]
    slow = flsar2004.section_313_ratio(two, X, Y, x, y, ellipse.half_x, ellipse.half_y)
    assert centred == pytest.approx(slow)
    assert centred < 0.5 * off


def test_ellipse_matches_the_signature():
    one = fit_ellipse(mine(0, 3, 5), (0.08, 0.04))
    # exp(-(x/w)²) has the energy's rms w/2; an even ellipse with that rms has the half-axis w.
    assert (one.half_x, one.half_y) == pytest.approx((0.14, 0.07), rel=0.05)


def table_of(*places):
    return pd.DataFrame([(x, y, 1.0) for x, y in places], columns=["x", "y", "peak"])


def test_fusion_rules():
    tables = {
        ("HH", 10.0): table_of((0, 1), (1, 5)),
        ("HH", 20.0): table_of((0.1, 1.1), (1, 5.2)),
        ("VV", 10.0): table_of((0, 0.9), (-1, 8)),
        ("VV", 20.0): table_of((0.05, 1.0), (0.5, 12)),
    }
    both = fuse_clusters(tables, 0.4, "and")
    assert len(both) == 1
    assert (both["x"][0], both["y"][0]) == pytest.approx((0.0375, 1.0))
    assert both["images"][0] == 4
    assert len(fuse_clusters(tables, 0.4, "or")) == 4
    either = fuse_clusters(tables, 0.4, "and-or")
    assert sorted(either["y"].round(1)) == [1.0, 5.1]
    none = fuse_clusters({("HH", 10.0): table_of(), ("VV", 10.0): table_of((0, 0))}, 0.4, "and")
    assert none.empty


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: find_clusters(image_of(np.ones((Y.size, X.size))), 1.0, 0.0),
            "radius must be positive",
        ),
        (
            lambda: find_clusters(image_of(np.ones((Y.size, X.size))).expand_dims("scan"), 1.0),
            "dimensions",
        ),
        (lambda: Ellipse(0.0, 1.0), "half-axes must be positive"),
        (lambda: fuse_clusters({}, 0.4), "at least one image"),
        (lambda: fuse_clusters({("HH", 1.0): table_of()}, 0.4, "xor"), "rule must be one of"),
        (
            lambda: learn_thresholds(
                [(image_of(np.ones((Y.size, X.size))), [(90, 90)])], Ellipse(1, 1)
            ),
            "at least one mine",
        ),
        (
            lambda: learn_thresholds(
                [(image_of(np.ones((Y.size, X.size))), [(0, 1)])], Ellipse(1, 1), pass_share=0
            ),
            "pass_share",
        ),
    ],
)
def test_errors_name_the_parameter(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_given_size_takes_the_place_of_that_of_the_mines_and_lowers_the_threshold_to_it():
    places = [(0.0, 1.0), (0.6, 4.0)]
    image = image_of(mine(0.0, 1.0, 4.0) + mine(0.6, 4.0, 1.0))
    size = np.pi * 0.2**2
    limits = learn_thresholds([(image, places)], Ellipse(1, 1), 0.4, pass_share=1.0, size=size)
    assert limits.size == size
    weakest = find_clusters(image, limits.amplitude, 0.4)["size"].min()
    assert weakest == pytest.approx(size, abs=4 * 0.08 * 0.04)  # the weakest mine barely passes
    assert weakest >= size
    forming = learn_thresholds([(image, places)], Ellipse(1, 1), 0.2, pass_share=1.0)
    assert forming.size < size
    assert len(prescreen_clusters(image, limits, Ellipse(1, 1), 0.4)) == 2
