"""The permittivity at which an image is sharpest."""

import numpy as np
import pytest

from flgpr.calibrate.permittivity import estimate_permittivity
from flgpr.progress import silent

TRIALS = (3.0, 4.0, 5.0, 6.5, 8.0, 10.0)


def image_of(best, width=0.15):
    """Make a pixel that spreads over more and more pixels away from the best permittivity."""

    def image(permittivity):
        offset = np.log(permittivity / best)
        spread = 0.5 * np.sqrt(1 + (offset / width) ** 2)
        x = np.linspace(-20, 20, 401)
        return np.exp(-((x / spread) ** 2) / 2).astype(np.complex64)[None] / np.sqrt(spread)

    return image


def test_it_is_found_between_the_trials():
    fit = estimate_permittivity(image_of(5.6), TRIALS, silent)
    assert fit.permittivity == pytest.approx(5.6, rel=0.06)
    assert fit.trials["permittivity"].tolist() == list(TRIALS)
    sharpest = fit.trials["sharpness"].max()
    assert fit.contrast == pytest.approx(sharpest / fit.trials["sharpness"].median())


def test_progress_goes_over_the_trials():
    asked = []

    def track(items, label, total):
        asked.append((label, total))
        return items

    estimate_permittivity(image_of(5.0), TRIALS, track)
    assert asked == [("permittivities tried", 6)]


@pytest.mark.parametrize("best", [1.0, 30.0])
def test_the_edge_of_the_trials_is_refused(best):
    with pytest.raises(ValueError, match="beyond the edge of what was tried, 3 to 10"):
        estimate_permittivity(image_of(best), TRIALS, silent)


def test_a_sharpness_that_does_not_stand_out_is_refused():
    with pytest.raises(ValueError, match=r"no permittivity stands out: .*, 1\.3 are needed"):
        estimate_permittivity(image_of(5.6, width=3.0), TRIALS, silent)


@pytest.mark.parametrize("trials", [(4.0, 5.0), (4.0, 5.0, 5.0), (6.0, 5.0, 4.0)])
def test_trials_must_be_three_that_increase(trials):
    with pytest.raises(ValueError, match="trials must be three or more that increase, got"):
        estimate_permittivity(image_of(5.0), trials, silent)
