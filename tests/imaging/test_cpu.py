"""Images are split into groups of channels that lane rows hold."""

import numpy as np
import pytest

from flgpr.imaging.cpu import channel_groups


@pytest.mark.parametrize(("polarizations", "subbands"), [(1, 1), (4, 3), (3, 7), (2, 20), (5, 16)])
def test_channel_groups_cover_every_image_once_in_rows_that_hold_them(polarizations, subbands):
    covered = np.zeros((polarizations, subbands), int)
    for rows, bands, channels in channel_groups(polarizations, subbands):
        covered[rows, bands] += 1
        assert covered[rows, bands].size <= channels <= 16
    assert (covered == 1).all()
