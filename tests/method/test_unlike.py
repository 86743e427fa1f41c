"""Whether ground is unlike the training: the figures, their limits, and what is said of them."""

import numpy as np
import pytest
from pydantic import ValidationError

from flgpr.method.unlike import (
    LEAST_LANES,
    MOST_SCANS,
    SIZES,
    Comparison,
    Figure,
    OfSize,
    TrainingGround,
    Trust,
    chosen_scans,
    compare_clutter,
    compare_level,
    departures,
    learn_clutter,
    learn_levels,
    level_profile,
    limit_of,
    share_beyond,
    size_number,
    tail_of,
    why_not,
)
from flgpr.model import Grid
from flgpr.stages.textured_clutter import SHAPES, shape_counts

SIZE = 6
METRES = 4


def chips(rng, count, mixing=None):
    """White chips of unit power, or mixed ones."""
    values = (rng.normal(size=(count, SIZE)) + 1j * rng.normal(size=(count, SIZE))) / np.sqrt(2)
    if mixing is not None:
        values = values @ mixing.T
    return values / np.sqrt((np.abs(values) ** 2).mean(axis=1, keepdims=True))


def sums(rng, count=400, mixing=None):
    """Sums of a lane whose clutter is alike at all metres."""
    covariance = np.zeros((METRES, SIZE, SIZE), complex)
    shape = np.zeros((METRES, len(SHAPES) + 1))
    for metre in range(METRES):
        some = chips(rng, count, mixing)
        covariance[metre] = some.T @ some.conj()
        shape[metre] = shape_counts(some, np.eye(SIZE), 0.05)
    return {"covariance": covariance, "count": np.full(METRES, float(count)), "shape": shape}


WHITE = np.tile(np.eye(SIZE, dtype=np.complex64), (METRES, 1, 1))
MIXING = np.linalg.cholesky(0.3 * np.eye(SIZE) + 0.7)


def test_the_divergence_is_the_stein_loss_of_the_covariance():
    rng = np.random.default_rng(1)
    divergence, eigenvalue = departures(*_of(sums(rng, 20_000, MIXING)), WHITE)
    values = np.linalg.eigvalsh(_normalised(MIXING))
    np.testing.assert_allclose(divergence, np.mean(values - np.log(values) - 1), rtol=0.03)
    np.testing.assert_allclose(eigenvalue, values[-1], rtol=0.03)
    like, none = departures(*_of(sums(rng, 20_000)), WHITE)
    assert (like < 0.002).all()
    assert (none < 1.1).all()


def _of(of_lane):
    return of_lane["covariance"], of_lane["count"]


def _normalised(mixing):
    """Covariance of mixed chips, each over its own power, by many of them."""
    some = chips(np.random.default_rng(9), 200_000, mixing)
    return some.T @ some.conj() / len(some)


def test_what_whitens_the_mixed_clutter_finds_it_white():
    rng = np.random.default_rng(2)
    whitener = np.linalg.inv(np.linalg.cholesky(_normalised(MIXING)))
    divergence, _ = departures(
        *_of(sums(rng, 20_000, MIXING)), np.tile(whitener.astype(np.complex64), (METRES, 1, 1))
    )
    assert (divergence < 0.002).all()


def test_few_chips_do_not_seem_far_off():
    empty = {"covariance": np.zeros((METRES, SIZE, SIZE), complex), "count": np.zeros(METRES)}
    divergence, eigenvalue = departures(*_of(empty), WHITE)
    assert (divergence == 0).all()
    assert (eigenvalue == 1).all()


def test_one_more_lane_passes_a_limit_as_rarely_as_is_said():
    rng = np.random.default_rng(3)
    chance = 0.05
    trials = 4000
    beyond = 0
    for _ in range(trials):
        figures = np.exp(rng.normal(-1.0, 0.3, 8))
        beyond += np.exp(rng.normal(-1.0, 0.3)) > limit_of("divergence", figures, chance)
    error = np.sqrt(chance * (1 - chance) / trials)
    assert abs(beyond / trials - chance) < 4 * error


def test_a_thousandth_of_the_training_chips_lies_beyond_the_tail():
    rng = np.random.default_rng(4)
    whitener = np.linalg.inv(MIXING)
    shape = np.array([shape_counts(chips(rng, 40_000), whitener, 0.05)] * METRES)
    tail = tail_of(shape)
    assert share_beyond(shape, tail) <= 0.001
    border_before = SHAPES[np.searchsorted(SHAPES, tail[0]) - 1]
    assert share_beyond(shape, [border_before] * METRES) > 0.001
    other = chips(rng, 1000) @ np.diag([3.0, *[0.2] * (SIZE - 1)])
    beyond = np.array([shape_counts(other, 2 * whitener, 0.05)] * METRES)
    assert share_beyond(beyond, tail) > 0.5


def test_scans_are_looked_at_at_even_distances_and_counted_by_size():
    assert chosen_scans(5).tolist() == [0, 1, 2, 3, 4]
    some = chosen_scans(100)
    assert len(some) == MOST_SCANS
    assert (some[0], some[-1]) == (0, 99)
    assert set(np.diff(some)) <= {14, 15}
    numbers = [size_number(place) for place in range(MOST_SCANS)]
    for number, size in enumerate(SIZES):
        assert sum(one <= number for one in numbers) == size


def test_the_level_tells_a_step_in_range_and_no_bright_target():
    gain = np.ones((1, 2, 40, 30))
    grid, across = Grid(-1.5, 4.0, 30, 40, 0.1, 0.1), (-5.0, 5.0)
    plain = level_profile(gain, grid, across)
    assert plain.shape == (2, 4)
    bright = gain.copy()
    bright[:, :, 12:15, 10:14] = 100.0
    np.testing.assert_allclose(level_profile(bright, grid, across), plain)
    echo = gain.copy()
    echo[:, :, :10] *= 10.0  # 20 dB in the first metre
    step = level_profile(echo, grid, across) - plain
    np.testing.assert_allclose(step[:, 0] - step[:, 1], 20.0)


@pytest.fixture(scope="module")
def ground():
    """What eight lanes of one clutter leave."""
    rng = np.random.default_rng(6)
    lanes = []
    profiles = []
    for _ in range(8):
        of_lane = sums(rng)
        arrays = {
            name: np.stack([array] + [0 * array] * (len(SIZES) - 1))
            for name, array in of_lane.items()
        }
        lanes.append(arrays | {"scans": np.array(1)})
        profiles.append(rng.normal(0.0, 1.0, (2, METRES)))
    sizes, tail = learn_clutter(lanes, [WHITE] * 8)
    level, profile = learn_levels(profiles)
    return TrainingGround(lanes=8, level=level, profile=profile, sizes=sizes, tail=tail)


def test_ground_like_the_training_stays_within_all_limits_and_other_ground_passes_them(ground):
    rng = np.random.default_rng(7)
    assert ground.judges
    assert [size.scans for size in ground.sizes] == [1]
    like = compare_clutter(ground, sums(rng), 1, WHITE, 2.0)
    assert not any(figure.is_beyond for figure in like)
    other = compare_clutter(ground, sums(rng, mixing=MIXING), 1, WHITE, 2.0)
    beyond = {figure.name for figure in other if figure.is_beyond}
    assert {"divergence", "eigenvalue"} <= beyond
    words = Comparison(tuple(other)).differences()
    assert any(
        "nats per value from that of the training" in one and "m ahead" in one for one in words
    )


def test_a_level_that_departs_names_its_channel_and_range(ground):
    profile = np.array(ground.profile)
    profile[1, 2] += 30.0
    (figure,) = compare_level(ground, profile, ["HH F1", "VV F1"], 4.0)
    assert figure.is_beyond
    assert figure.value == pytest.approx(30.0, abs=0.01)
    assert "in VV F1 6.0 to 7.0 m ahead" in figure.words
    assert compare_level(ground, profile[:, :2], ["HH F1", "VV F1"], 4.0) == []


def test_fewer_scans_than_any_training_lane_had_are_not_judged(ground):
    two = ground.model_copy(update={"sizes": [ground.sizes[0].model_copy(update={"scans": 2})]})
    assert compare_clutter(two, sums(np.random.default_rng(8)), 1, WHITE, 2.0) == []
    assert len(compare_clutter(two, sums(np.random.default_rng(8)), 3, WHITE, 2.0)) == 3


def test_the_lanes_own_covariance_mends_what_is_a_little_off_and_contrast_what_is_far_off():
    def comparison(value):
        return Comparison((Figure("divergence", value, 0.4), Figure("level", 1.0, 5.0)))

    assert comparison(0.39).substitute == ""
    assert comparison(0.45).substitute == "own"
    assert comparison(0.9).substitute == "contrast"
    # Without a map that learns clutter there is no covariance to mend.
    assert Comparison((Figure("level", 9.0, 5.0),)).substitute == "contrast"


def test_a_comparison_is_said_in_plain_words():
    comparison = Comparison((Figure("divergence", 0.9, 0.4, "1.0 to 2.0 m ahead"),))
    first, second = comparison.notes("ranked by contrast instead")
    assert first == (
        "this ground is unlike the training: the confidences do not hold; ranked by contrast instead"
    )
    assert second.endswith(
        "0.9 nats per value from that of the training, most 1.0 to 2.0 m ahead (limit 0.4)"
    )
    entries = comparison.as_json("kept", ["more"])
    assert entries["unlike"] is True
    assert entries["figures"]["divergence"] == {"value": 0.9, "limit": 0.4, "beyond": True}
    assert entries["notes"][-1] == "more"
    assert Comparison((Figure("level", 1.0, 5.0),)).notes() == []


def test_a_model_that_cannot_judge_says_why():
    assert "trained before" in why_not(None)
    few = TrainingGround(lanes=LEAST_LANES - 1)
    assert f"on {LEAST_LANES - 1} of the {LEAST_LANES} lanes" in why_not(few)
    (words,) = Comparison(cannot=why_not(few)).notes()
    assert words.startswith("it cannot be judged whether this ground is like the training")


@pytest.mark.parametrize(
    "change",
    [{"lanes": -1}, {"level": [-1.0]}, {"level": [float("nan")]}, {"more": 1}, {"tail": [0.0]}],
)
def test_a_forged_ground_is_refused(change):
    with pytest.raises(ValidationError):
        TrainingGround.model_validate({"lanes": 3} | change)
    with pytest.raises(ValidationError):
        OfSize(scans=MOST_SCANS + 1, divergence=[], eigenvalue=[], beyond=[])


def test_a_choice_that_is_none_is_refused():
    with pytest.raises(ValueError, match="unlike must be one of fallback, keep, refuse, got 'no'"):
        Trust("no")
    with pytest.raises(ValueError, match="far must be above 0 and at most 10 per m², got 0"):
        Trust(far=0)
