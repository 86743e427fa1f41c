"""The grid of a full-wave model: points on its nodes, boxes, relaxing media."""

import numpy as np
import pytest

from flgpr.simulate.ground.soil import mironov
from flgpr_exchange.gprmax.grid import CellGrid, fit_relaxation, rectangles


def test_spreading_keeps_the_place_of_every_component():
    grid = CellGrid((0.1, -0.2, 0.3), 0.01, (50, 50, 50), 10)
    point = np.array([0.3312, 0.0147, 0.4981])
    points = grid.spread(point, [0.6, 0.0, 0.8])
    for axis, part in ((0, 0.6), (2, 0.8)):
        some = [p for p in points if p.component == "xyz"[axis]]
        place = (
            sum(p.weight * (np.array(p.node) + 0.5 * (np.arange(3) == axis)) for p in some) / part
        )
        np.testing.assert_allclose(place * grid.cell + grid.origin, point, atol=1e-9)
        wavenumber = 2 * np.pi / (10 * grid.cell)
        nodes = np.array([p.node for p in some]) + 0.5 * (np.arange(3) == axis)
        for direction in np.eye(3):
            wave = np.exp(1j * wavenumber * (nodes * grid.cell + grid.origin - point) @ direction)
            assert abs(np.array([p.weight for p in some]) @ wave / part - 1) < 0.006


def test_rectangles_cover_each_cell_once():
    mask = np.random.default_rng(1).random((30, 40)) < 0.6
    count = np.zeros(mask.shape, int)
    for i0, i1, j0, j1 in rectangles(mask):
        count[i0:i1, j0:j1] += 1
    np.testing.assert_array_equal(count, mask)


def test_relaxation_fits_tell_their_error():
    f = np.linspace(0.5e9, 1.5e9, 40)
    exact = fit_relaxation(f, 3.5 - 1j * 0.002 / (2 * np.pi * f * 8.8541878128e-12), 3e-11)
    assert exact.poles == ()
    assert exact.permittivity == pytest.approx(3.5)
    assert exact.conductivity == pytest.approx(0.002)
    soil = mironov(f, 10.0, 0.1)
    fit = fit_relaxation(f, soil, 3e-11)
    assert np.abs((fit(f) - soil).real / soil.real).max() == pytest.approx(fit.error_real)
    assert fit.error_real < 0.01
    assert fit.error_loss < 0.06
    assert all(tau >= 3e-11 for _, tau in fit.poles)
    with pytest.raises(ValueError, match="negative loss"):
        fit_relaxation(f, np.full(40, 3 + 0.1j), 3e-11)
