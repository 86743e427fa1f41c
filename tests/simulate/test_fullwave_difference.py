"""The full-wave echoes of buried bodies, held against physics that made neither them nor the simulator."""

import numpy as np
import pytest

from flgpr.model import SPEED_OF_LIGHT
from reference.born_in_ground import born_echo, cylinder_cells
from simulate.fullwave_difference import (
    ARCHIVES,
    BANDS,
    KINDS,
    compare,
    images,
    load,
    misses,
    names,
    peaks,
    simulated,
)

VACUUM_PERMITTIVITY = 8.8541878128e-12
CASES = [load(name) for name in names()]
CO = [0, 3]  # HH, VV


def find(permittivity, body, cover):
    return next(
        case
        for case in CASES
        if case.soil["permittivity"] == permittivity
        and (case.body["name"], case.body["cover_m"]) == (body, cover)
    )


def test_there_is_an_archive_of_every_body_cover_and_soil_and_they_are_small():
    made = {(case.soil["permittivity"], case.body["name"], case.body["cover_m"]) for case in CASES}
    assert made == {
        (eps, body, d) for eps in (3.5, 5.0) for body in KINDS for d in (0.015, 0.045, 0.0975)
    }
    assert sum(path.stat().st_size for path in ARCHIVES.iterdir()) < 2e6
    for case in CASES:
        assert case.signal.shape == (len(case.polarization), len(case.rx), case.frequency.size)
        assert case.polarization == ("HH", "HV", "VH", "VV")
        assert np.isfinite(case.signal).all()


@pytest.mark.parametrize("case", CASES, ids=names())
def test_nothing_is_left_of_the_direct_wave_and_the_surface_and_nothing_rings_on(case):
    """Range profiles hold nothing before 2.5 m, where the ground below echoes, nor 3 m behind the body."""
    path = np.arange(0.0, 9.0, 0.02)
    window = np.hanning(case.frequency.size)
    wave = np.exp(2j * np.pi * np.outer(case.frequency, path) / SPEED_OF_LIGHT)
    profile = np.abs((case.signal[CO] * window) @ wave).max(axis=1)
    peak = path[profile.argmax(axis=1)]
    assert ((peak > 3.8) & (peak < 5.2)).all()
    outside = (path < 2.5) | (path > 7.5)
    assert (20 * np.log10(profile[:, outside].max(axis=1) / profile.max(axis=1)) < -45).all()


@pytest.mark.parametrize("case", CASES, ids=names())
def test_the_peak_lies_between_the_near_rim_and_the_bottom_of_the_far_one(case):
    """Under the ground all appears later: by the refracted ray's shift ``d·sqrt(ε - sin²θ)/sinθ``."""
    sine = case.body["position_m"][1] / np.hypot(case.body["position_m"][1], case.tx[0, 2])
    slope = np.sqrt(case.soil["permittivity"] - sine**2) / sine
    top, bottom = (slope * (case.body["cover_m"] + drop) for drop in (0, case.body["height_m"]))
    radius = case.body["radius_m"]
    cell = 0.10
    _, place = peaks(images(case, case.signal[CO]))
    assert (place[:, 0] > -radius + top - cell).all()
    assert (place[:, 0] < radius + bottom + cell).all()


def test_metal_outshines_a_gap_and_a_gap_a_solid_of_small_contrast():
    for cover in (0.015, 0.045, 0.0975):
        metal, gap, solid = (
            np.linalg.norm(find(3.5, body, cover).signal[CO], axis=(1, 2)) for body in KINDS
        )
        assert (20 * np.log10(metal / gap) > 6).all()
        assert (20 * np.log10(gap / solid) > 3).all()


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize("cover", [0.015, 0.045, 0.0975])
def test_a_solid_of_small_contrast_echoes_as_born_says(cover):
    """On one absolute scale, in all four polarizations: VV as strong as HH, cross-polarization from oblique pairs."""
    case = find(3.5, "solid", cover)
    body = case.body
    pairs = slice(0, None, 8)
    tones = slice(0, None, 6)
    points, volume = cylinder_cells(
        body["radius_m"], -cover, -cover - body["height_m"], *body["position_m"][:2], 0.03
    )
    got = case.signal[:, pairs, tones]
    want = np.zeros_like(got)
    along, up = np.eye(3)[[0, 2]]
    for k, f in enumerate(case.frequency[tones]):
        loss = case.soil["conductivity_s_per_m"] / (2 * np.pi * f * VACUUM_PERMITTIVITY)
        soil = case.soil["permittivity"] - 1j * loss
        for p, ends in enumerate(((along, along), (along, up), (up, along), (up, up))):
            for r, rx in enumerate(case.rx[pairs]):
                want[p, r, k] = born_echo(
                    case.tx[0], rx, ends, points, volume, body["permittivity"] - soil, f, soil
                )
    norms = [np.linalg.norm(one, axis=(1, 2)) for one in (got, want)]
    level = 20 * np.log10(norms[0] / norms[1])
    assert (np.abs(level) < 2).all()
    assert abs(level[3] - level[0]) < 1.5
    product = (got * want.conj()).sum(axis=(1, 2)) / (norms[0] * norms[1])
    assert (product.real > 0.75).all()  # of one sign, too


def test_the_comparison_sees_level_place_and_polarization():
    case = find(3.5, "metal", 0.045)
    assert np.allclose(compare(case, case.signal).level, 0)
    moved = case.signal * np.exp(-2j * np.pi * case.frequency * 0.2 / SPEED_OF_LIGHT)
    moved[3] *= 0.5
    found = compare(case, moved)
    assert np.allclose(found.level[:, 0], [0, 6.02], atol=0.3)
    assert np.allclose(found.ratio[0], 6.02, atol=0.3)
    # 20 cm of path are 10 cm of slant range, over the sine of the incidence on the ground.
    assert np.allclose(found.apart[:, 0], -0.1 / np.sin(np.arctan2(1.8, 1.02)), atol=0.02)
    assert (found.coherence[:, 0] < 0.9).all()


@pytest.fixture(scope="module")
def comparisons():
    return {case.name: compare(case, simulated(case)) for case in CASES}


# All that is off by more than 2 dB or 5 cm: full wave less simulated, dB or m. Peaks are apart
# where two flashes are nearly alike and either may be the higher.
KNOWN = {
    ("eps3.5-gap-15mm", "apart", "VV", "high"): -0.09,
    ("eps3.5-gap-45mm", "apart", "HH", "high"): -1.11,
    ("eps3.5-gap-98mm", "apart", "VV", "high"): -0.11,
    ("eps3.5-metal-15mm", "apart", "VV", "high"): 0.15,
    ("eps3.5-metal-45mm", "apart", "HH", "high"): 0.11,
    ("eps3.5-metal-45mm", "apart", "VV", "whole"): -0.11,
    ("eps3.5-metal-98mm", "apart", "VV", "high"): 0.08,
    ("eps5-gap-15mm", "apart", "VV", "high"): -0.95,
    ("eps5-gap-45mm", "ratio", "VV/HH", "high"): -2.0,
    ("eps5-gap-98mm", "apart", "VV", "low"): -0.95,
    ("eps5-metal-45mm", "level", "HH", "high"): 2.7,
    ("eps5-metal-45mm", "apart", "VV", "high"): 0.06,
    ("eps5-metal-45mm", "ratio", "VV/HH", "high"): -3.3,
    ("eps5-metal-98mm", "apart", "VV", "high"): 0.07,
    ("eps5-metal-98mm", "ratio", "VV/HH", "low"): -2.6,
}
OTHERWISE = 2.0, 0.05  # dB, m
# Peaks that are apart although the simulated image is not within 0.5 dB of its own peak at the full
# wave's place.
ELSEWHERE = {("eps5-gap-15mm", "VV", "high"), ("eps3.5-gap-45mm", "HH", "high")}


def limit(miss):
    return (
        OTHERWISE[miss[1] == "apart"]
        if miss not in KNOWN
        else abs(KNOWN[miss]) + (0.3, 0.02)[miss[1] == "apart"]
    )


@pytest.mark.parametrize("name", names())
def test_level_place_and_polarization_are_the_full_wave_s(comparisons, name):
    """Within 2 dB and 5 cm, HH, VV and VV/HH, whole band and thirds, but for what is listed, which gets no worse."""
    found = misses(name, comparisons[name])
    worse = {miss: value for miss, value in found.items() if abs(value) > limit(miss) + 1e-3}
    assert not worse


def test_in_the_whole_band_nothing_but_one_peak_is_off():
    """Metal at 4.5 cm in VV, 11 cm apart and within 0.1 dB as high at the full wave's place."""
    assert [miss for miss in KNOWN if miss[3] == "whole"] == [
        ("eps3.5-metal-45mm", "apart", "VV", "whole")
    ]
    assert abs(KNOWN["eps3.5-metal-45mm", "apart", "VV", "whole"]) < 0.12


@pytest.mark.parametrize("name", names())
def test_where_peaks_are_apart_the_simulated_image_is_as_high_at_the_full_wave_s(comparisons, name):
    """The second criterion, kept apart from the first: within 5 cm of the full wave's peak, 0.5 dB under its own."""
    for row, line in zip(("HH", "VV"), comparisons[name].there, strict=True):
        for band, there in zip(BANDS, line, strict=True):
            assert there > -0.5 or (name, row, band) in ELSEWHERE


def test_the_comparison_lists_what_is_off():
    case = find(3.5, "metal", 0.045)
    worse = case.signal.copy()
    worse[3] *= 0.5
    assert set(misses(case.name, compare(case, worse))) == {
        (case.name, quantity, row, band)
        for quantity, row in (("level", "VV"), ("ratio", "VV/HH"))
        for band in BANDS
    }


@pytest.mark.parametrize(("permittivity", "body"), [(3.5, "gap"), (3.5, "metal"), (5.0, "solid")])
def test_cross_polarized_echoes_have_the_full_wave_s_level_and_sign(permittivity, body):
    case = find(permittivity, body, 0.045)
    for full, ours in zip(case.signal[1:3], np.asarray(simulated(case))[1:3], strict=True):
        norms = np.linalg.norm(full), np.linalg.norm(ours)
        assert abs(20 * np.log10(norms[0] / norms[1])) < 2.0
        assert (full * ours.conj()).sum().real / (norms[0] * norms[1]) > 0.75
