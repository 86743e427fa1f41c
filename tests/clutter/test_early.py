"""Early echoes are taken out in the whole band, and later ones stay."""

import numpy as np
import pytest

from flgpr.clutter import early_basis, subtract_early
from flgpr.model import SPEED_OF_LIGHT

TONES = 442.5e6 + 7.5e6 * np.arange(142)  # as in the packaged full-wave lane
LONGEST = 3.8  # m
CELL = SPEED_OF_LIGHT / np.ptp(TONES)  # m of path


def echo(path):
    return np.exp(-2j * np.pi * TONES * path / SPEED_OF_LIGHT)


def left_db(path):
    rest = subtract_early(echo(path), early_basis(TONES, LONGEST))
    return 20 * np.log10(np.linalg.norm(rest) / np.linalg.norm(echo(path)))


@pytest.mark.parametrize("path", [0.0, 0.3, 1.7, 3.3, LONGEST])
def test_an_early_echo_is_60_db_down(path):
    assert left_db(path) < -55


def test_a_later_echo_stays():
    assert left_db(LONGEST + CELL) < -3  # within a cell it is not told apart
    for path in LONGEST + CELL * np.array([5.0, 8.0, 40.0, 80.0]):
        assert -1.0 < left_db(path) <= 1e-6


def test_a_later_echo_stays_beneath_an_early_one_that_is_50_db_stronger():
    rest = subtract_early(echo(8.0) + 316 * echo(1.0), early_basis(TONES, LONGEST))
    assert np.linalg.norm(rest - echo(8.0)) < 0.3 * np.linalg.norm(echo(8.0))


def test_tones_need_not_be_even():
    rng = np.random.default_rng(3)
    tones = np.sort(rng.choice(TONES, 120, replace=False))
    early = np.exp(-2j * np.pi * tones * 2.0 / SPEED_OF_LIGHT)
    rest = subtract_early(early, early_basis(tones, LONGEST))
    assert np.linalg.norm(rest) < 2e-3 * np.linalg.norm(early)


def test_a_path_that_leaves_nothing_is_refused():
    with pytest.raises(ValueError, match="path must leave later echoes at 142 tones, got 45 m"):
        early_basis(TONES, 45.0)
    with pytest.raises(ValueError, match="path must be positive, got 0 m"):
        early_basis(TONES, 0.0)
