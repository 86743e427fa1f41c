"""The regions of a patch are those of the paper, and impossible ones are refused."""

import numpy as np
import pytest

from flgpr.features import PatchShape


def test_inner_region_is_five_across_and_three_along():
    shape = PatchShape()
    mask = shape.region(shape.inner)
    assert mask.sum() == 15
    assert mask.any(axis=0).sum() == 5
    assert mask.any(axis=1).sum() == 3


def test_offsets_are_pixel_centres_about_the_middle():
    offsets = PatchShape(5, 0.1, (1, 1), (3, 3)).offsets()
    assert offsets.shape == (5, 5, 2)
    np.testing.assert_allclose(offsets[2, 2], 0.0)
    np.testing.assert_allclose(offsets[0, 4], [0.2, -0.2])


@pytest.mark.parametrize(
    "bad", [{"size": 24}, {"inner": (11, 3)}, {"guard": (25, 7)}, {"spacing": 0.0}]
)
def test_bad_patches(bad):
    with pytest.raises(ValueError, match="patch"):
        PatchShape(**bad)
