"""Template features against loops, and their invariances."""

import numpy as np
import pytest

from flgpr.features import (
    align_phases,
    clutter_tiles,
    cut_regions,
    max_correlation,
    mean_template,
    principal_templates,
    template_features,
)
from flgpr.model import Grid, Lane
from reference import flsar2004


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_correlation_by_fft_is_the_loop_over_shifts(rng):
    regions = rng.normal(size=(3, 9, 7)) + 1j * rng.normal(size=(3, 9, 7))
    template = rng.normal(size=(4, 5)) + 1j * rng.normal(size=(4, 5))
    moduli = [flsar2004.paragraph_22_correlation(abs(r), abs(template)) for r in regions]
    np.testing.assert_allclose(max_correlation(regions, template), moduli, rtol=1e-12)
    waves = [flsar2004.paragraph_22_correlation(r, template) for r in regions]
    np.testing.assert_allclose(
        max_correlation(regions, template, magnitude=False), waves, rtol=1e-12
    )


def test_a_shifted_template_in_an_empty_region_correlates_fully(rng):
    template = rng.random((4, 5))
    for dy, dx in ((0, 0), (3, 2), (8, 10)):
        region = np.zeros((12, 15))
        region[dy : dy + 4, dx : dx + 5] = 7 * template
        assert max_correlation(region, template) == pytest.approx(1)


def test_shifts_are_not_circular(rng):
    template = rng.random((6, 6))
    region = np.zeros((8, 8))
    region[:3] = np.pad(template[3:], ((0, 0), (1, 1)))
    region[-3:] = np.pad(template[:3], ((0, 0), (1, 1)))
    halves = [
        np.linalg.norm(template[part]) / np.linalg.norm(template)
        for part in (slice(0, 3), slice(3, 6))
    ]
    # A circular shift would join the two halves to a perfect match; each alone is worth its share
    # of the energy.
    assert max(halves) ** 2 <= max_correlation(region, template) + 1e-9
    assert max_correlation(region, template) < 0.97


def test_strength_and_phase_do_not_matter(rng):
    region = rng.normal(size=(9, 9)) + 1j * rng.normal(size=(9, 9))
    template = rng.normal(size=(5, 5)) + 0j
    for magnitude in (True, False):
        value = max_correlation(region, template, magnitude)
        assert max_correlation(region * 1e-6j, template * 30, magnitude) == pytest.approx(
            value, rel=1e-9
        )
        assert 0 < value < 1
    assert max_correlation(np.zeros((9, 9)), template) == 0


def test_mean_template_is_the_mean_at_unit_energy(rng):
    chips = rng.random((10, 2, 4, 5))
    template = mean_template(chips)
    np.testing.assert_allclose((template**2).sum(axis=(-2, -1)), 1)
    expected = sum(chips) / 10
    np.testing.assert_allclose(template[0], expected[0] / np.linalg.norm(expected[0]))
    chips[0] *= 1e6
    np.testing.assert_allclose(
        mean_template(chips)[0], chips[0, 0] / np.linalg.norm(chips[0, 0]), atol=1e-4
    )
    assert (
        np.abs(
            mean_template(chips, normalize_each=True)[0] - chips[0, 0] / np.linalg.norm(chips[0, 0])
        ).max()
        > 0.01
    )


def test_principal_templates_find_the_signatures(rng):
    basis = np.linalg.qr(rng.normal(size=(20, 2)))[0].T.reshape(2, 4, 5)
    weights = rng.normal(size=(200, 2)) * [1.0, 0.3]
    chips = np.einsum("nk,kyx->nyx", weights, basis)
    templates, share = principal_templates(chips, 2)
    assert share[:2].sum() == pytest.approx(1)
    assert share[0] > 0.7
    np.testing.assert_allclose(
        np.einsum("kyx,lyx->kl", templates, templates), np.eye(2), atol=1e-12
    )
    for template in templates:
        inside = sum((template * b).sum() ** 2 for b in basis)
        assert inside == pytest.approx(1)


def test_phases_are_aligned_and_nothing_else_changes(rng):
    signature = rng.normal(size=(4, 5)) + 1j * rng.normal(size=(4, 5))
    chips = signature * np.exp(2j * np.pi * rng.random((12, 1, 1))) * rng.uniform(1, 3, (12, 1, 1))
    aligned = align_phases(chips)
    np.testing.assert_allclose(np.abs(aligned), np.abs(chips))
    np.testing.assert_allclose(np.abs(aligned.sum(axis=0)), np.abs(chips).sum(axis=0))
    assert np.abs(chips.sum(axis=0)).max() < 0.9 * np.abs(chips).sum(axis=0).max()


def test_orthonormal_templates_add_in_power(rng):
    basis = np.linalg.qr(rng.normal(size=(20, 2)))[0].T.reshape(2, 4, 5)
    region = np.zeros((9, 9))
    region[2:6, 3:8] = 0.6 * basis[0] + 0.8 * basis[1]
    assert max_correlation(region, basis, magnitude=False) == pytest.approx(1)
    assert max_correlation(region, basis[0], magnitude=False) < 0.9


def test_feature_vector_has_one_entry_per_polarization_and_range(rng):
    regions = rng.random((4, 2, 3, 9, 8))
    templates = rng.random((2, 3, 5, 5))
    features = template_features(regions, templates)
    assert features.shape == (4, 6)
    for n, p, r in ((0, 0, 0), (3, 1, 2), (2, 0, 1)):
        expected = flsar2004.paragraph_22_correlation(regions[n, p, r], templates[p, r])
        assert features[n, 3 * p + r] == pytest.approx(expected)
    with pytest.raises(ValueError, match="must agree"):
        template_features(regions, templates[:, :2])


def test_regions_are_where_they_are_asked_for():
    grid = Grid(-2.0, 0.0, 41, 101, 0.1, 0.05)
    x, y = np.meshgrid(grid.x, grid.y)
    plane = np.stack([2 * x + 3 * y, x - y])
    regions = cut_regions(plane, grid, [(0.53, 2.21), (-1.9, 0.0)], (0.6, 0.4))
    assert regions.shape == (2, 2, 9, 7)
    u, v = np.meshgrid(np.arange(-3, 4) * 0.1, np.arange(-4, 5) * 0.05)
    np.testing.assert_allclose(regions[0, 0], 2 * (0.53 + u) + 3 * (2.21 + v), atol=1e-6)
    np.testing.assert_allclose(regions[0, 1], 0.53 + u - 2.21 - v, atol=1e-6)
    assert (regions[1][:, :4] == 0).all()  # beyond the image


def test_tiles_neither_overlap_nor_touch_mines():
    lane = Lane(-1.5, 1.5, 0, 30)
    mines = np.array([[0.2, 4.4], [-1.2, 12.0], [1.0, 25.1]])
    tiles = clutter_tiles(lane, (1.5, 1.5), mines, 0.4).to_numpy()
    gap = np.abs(tiles[:, None] - tiles[None])
    assert ((gap >= 1.5 - 1e-9).any(axis=2) | np.eye(len(tiles), dtype=bool)).all()
    for mine in mines:
        outside = np.hypot(*np.maximum(np.abs(tiles - mine) - 0.75, 0).T)
        assert outside.min() >= 0.4
    everything = clutter_tiles(lane, (1.5, 1.5), np.zeros((0, 2)), 0.4)
    assert len(everything) == 40
    # A tile is missing only if some mine is near it.
    lost = [c for c in everything.to_numpy() if not (np.abs(tiles - c).max(axis=1) < 1e-9).any()]
    assert 3 <= len(lost) <= 12
    with pytest.raises(ValueError, match="size must fit"):
        clutter_tiles(lane, (4.0, 1.0), mines, 0.4)
