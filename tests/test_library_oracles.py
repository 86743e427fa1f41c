"""Closed forms and intervals against libraries that none of this project made: miepython and statsmodels."""

import miepython
import numpy as np
import pytest
from statsmodels.stats import contingency_tables, proportion, rates

from flgpr.scoring import clopper_pearson, mcnemar_test, poisson_interval
from flgpr.simulate.ground.inclusions import stone
from reference.mie import amplitudes


@pytest.mark.parametrize("size", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("index", [1.3, 2.4, 3.0 - 0.1j])
def test_the_reference_s_series_of_a_sphere_is_the_library_s(size, index):
    """The series by which the solvers of bodies are checked.

    With this norm of the library the cross section is the integral of |S|² over k².
    """
    cosine = np.cos(np.radians([0.0, 60.0, 134.0, 180.0]))
    of_library = miepython.S1_S2(index, size, cosine, norm="wiscombe")
    for number, angle in enumerate(cosine):
        ours = amplitudes(size, index, angle)
        for name, mine, theirs in zip(("S1", "S2"), ours, of_library, strict=True):
            allowed = 1e-6 * abs(of_library[0]).max()
            assert abs(mine) == pytest.approx(abs(theirs[number]), abs=allowed), name


@pytest.mark.parametrize(("body", "soil"), [(6.0, 3.0), (3.0, 9.0), (7.5, 4.0)])
def test_a_small_stone_echoes_as_a_sphere(body, soil):
    """A sphere whose circumference is a tenth of the wavelength in the soil is a dipole, to 1 %."""
    radius = 0.01
    wavenumber = 0.1 / (np.sqrt(soil) * radius)
    amplitude, _ = stone(radius, body, soil, wavenumber)
    *_, backscatter, _ = miepython.efficiencies_mx(np.sqrt(body / soil), 0.1)
    cross_section = backscatter * np.pi * radius**2
    assert float(amplitude) ** 2 == pytest.approx(cross_section, rel=0.02)


@pytest.mark.parametrize("counts", [(9, 2), (0, 5), (1, 1), (34, 19), (0, 0)])
def test_mcnemar_s_exact_test_is_the_library_s(counts):
    only_a, only_b = counts
    table = [[20, only_a], [only_b, 30]]
    theirs = contingency_tables.mcnemar(table, exact=True).pvalue if sum(counts) else 1.0
    assert mcnemar_test(only_a, only_b) == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize("level", [0.9, 0.95])
@pytest.mark.parametrize(("count", "number"), [(0, 3), (2, 3), (3, 3), (54, 224), (1, 1000)])
def test_the_interval_of_a_share_is_the_library_s(count, number, level):
    low, high = clopper_pearson(count, number, level)
    theirs = proportion.proportion_confint(count, number, 1 - level, method="beta")
    assert (float(low), float(high)) == pytest.approx(theirs, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("count", "exposure"), [(1, 300.0), (3, 300.0), (192, 9600.0)])
def test_the_interval_of_a_rate_is_the_library_s(count, exposure):
    low, high = poisson_interval(count, exposure)
    theirs = rates.confint_poisson(count, exposure, method="exact-c")
    assert (float(low), float(high)) == pytest.approx(theirs, rel=1e-6)
