"""Random streams: named by purpose and place, and independent of one another."""

import numpy as np

from flgpr.simulate.scene.draw import stream


def test_a_stream_gives_the_same_numbers_whatever_was_drawn_before():
    want = stream(7, "rocks", 3, -2).random(5)
    stream(7, "bushes").random(100)
    first = stream(7, "rocks", 3, -2)
    second = stream(7, "rocks", 3, -1)
    interleaved = [(first.random(), second.random()) for _ in range(5)]
    np.testing.assert_array_equal([pair[0] for pair in interleaved], want)


def test_streams_of_other_seeds_names_and_places_are_others():
    keys = [(7, "rocks", 0, 0), (8, "rocks", 0, 0), (7, "posts", 0, 0), (7, "rocks", 1, 0)]
    keys += [(7, "rocks", 0, 1), (7, "rocks", -1, 0), (-7, "rocks", 0, 0)]
    firsts = {stream(*key).integers(1 << 60) for key in keys}
    assert len(firsts) == len(keys)


def test_neighbouring_tiles_are_uncorrelated():
    tiles = np.array([stream(1, "surface", i, 0).standard_normal(2000) for i in range(8)])
    correlation = np.corrcoef(tiles)
    np.fill_diagonal(correlation, 0)
    # 28 pairs: five standard deviations of a coefficient of 2000 samples.
    assert np.abs(correlation).max() < 5 / np.sqrt(2000)
