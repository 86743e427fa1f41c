"""Positions of targets: the refraction shift against its limits, and the survey error by simulation."""

import math

import numpy as np
import pandas as pd
import pytest

from flgpr.scoring import Refraction, jitter, refraction_shift, survey_share


def test_without_refraction_the_shift_is_that_of_a_straight_ray():
    # With ε = 1 the ray reaches the surface d·cot(θ) before the object.
    assert refraction_shift(0.1, 1.0, 5.0, 12.0) == pytest.approx(0.1 * 5.0 / 12.0)


def test_at_grazing_incidence_the_delay_is_that_of_the_transmitted_ray():
    assert refraction_shift(0.1, 4.0, 1e-9, 1.0) == pytest.approx(0.1 * math.sqrt(3.0))


def test_objects_on_the_surface_stay_and_unknown_depths_stay_unknown():
    assert refraction_shift([0.0, -0.5], 4.0, 5.0, 12.0).tolist() == [0.0, 0.0]
    assert np.isnan(refraction_shift(np.nan, 4.0, 5.0, 12.0))


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ((0.1, 0.9, 5.0, 12.0), "permittivity must be at least 1, got 0.9"),
        ((0.1, 4.0, 0.0, 12.0), "height and distance must be positive"),
        ((0.1, 4.0, 5.0, [12.0, 0.0]), "height and distance must be positive"),
    ],
)
def test_values_that_make_no_sense_are_refused(arguments, rule):
    with pytest.raises(ValueError, match=rule):
        refraction_shift(*arguments)


def test_targets_move_along_the_line_from_the_radar():
    truth = pd.DataFrame({"x": [3.0, 3.0], "y": [10.0, 10.0], "depth": [0.1, np.nan]})
    moved = Refraction(4.0, height=5.0, distance=4.0, radar_x=0.0).move(truth)
    shift = refraction_shift(0.1, 4.0, 5.0, 5.0)
    assert moved["x"].tolist() == pytest.approx([3.0 + 0.6 * shift, 3.0])
    assert moved["y"].tolist() == pytest.approx([10.0 + 0.8 * shift, 10.0])


def test_the_share_of_a_survey_error_agrees_with_drawn_surveys():
    sigma = 0.3
    halo = 0.7
    share = survey_share(sigma, halo)
    truth = pd.DataFrame({"x": np.zeros(20_000), "y": np.zeros(20_000)})
    moved = jitter(truth, sigma, seed=1)
    distance = np.hypot(moved["x"], moved["y"])
    # Three standard deviations of a binomial share.
    tolerance = 3 * math.sqrt(share.lost * (1 - share.lost) / len(truth))
    assert (distance > halo).mean() == pytest.approx(share.lost, abs=tolerance)
    assert (distance <= share.radius_95).mean() == pytest.approx(0.95, abs=0.005)
    assert share.share == pytest.approx(sigma / halo)


def test_an_exact_survey_takes_nothing():
    share = survey_share(0.0, 0.5)
    assert (share.share, share.radius_95, share.lost) == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="survey_error must not be negative"):
        survey_share(-0.1)
