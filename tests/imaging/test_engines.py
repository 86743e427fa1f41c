"""Images are split into passes that lane rows hold, and the engine follows from what is asked."""

import numpy as np
import pytest

from flgpr.imaging import ImagingOperator
from flgpr.imaging.engines import DirectEngine, PreciseEngine, ProfileEngine, passes


@pytest.mark.parametrize(("polarizations", "subbands"), [(1, 1), (4, 3), (3, 7), (2, 20), (5, 16)])
def test_passes_cover_every_image_once_in_rows_that_hold_them(polarizations, subbands):
    covered = np.zeros((polarizations, subbands), int)
    for rows, bands, channels in passes(polarizations, subbands):
        covered[rows, bands] += 1
        assert covered[rows, bands].size <= channels <= 16
    assert (covered == 1).all()


def test_the_engine_follows_from_tolerance_and_work():
    frequency = 1e9 + 5e6 * np.arange(64)
    antennas = np.array([[0.0, 0.0, 1.5]])
    x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(3, 5, 20))
    pixels = np.stack([x, y, 0 * x], axis=-1)

    def engine(points=pixels, **options):
        return type(ImagingOperator(frequency, antennas, antennas, points, **options).engine)

    assert engine() is ProfileEngine
    assert engine(tolerance=1e-8) is PreciseEngine
    assert engine(method="direct") is DirectEngine
    assert engine(pixels[:1, :1]) is DirectEngine
    with pytest.raises(ValueError, match="method must be"):
        engine(method="fast")
    with pytest.raises(ValueError, match="device must be 'cpu' or 'cuda'"):
        engine(device="tpu")
