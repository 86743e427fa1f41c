"""Scoring by frames: every frame counts its area, alarms and looks at targets (Fuse et al. 2018, Sec. 4)."""

import numpy as np
import pandas as pd
import pytest
from slow_scoring import frame_counts

from flgpr.model import Lane
from flgpr.scoring import Rules, score_frames, unroll_frames

AREA = Lane(-7.0, 7.0, 5.0, 10.0)


def drive(seed, frames=12):
    """Frames 1 m apart with a wandering course, alarms in each, targets in and beside what they see."""
    rng = np.random.default_rng(seed)
    poses = {}
    for frame in range(0, 2 * frames, 2):
        poses[frame] = np.array(
            [rng.normal(0, 0.3), 1.0 * frame, 3.0, rng.normal(0, 0.05), 0.0, 0.0]
        )
    number = 30 * frames
    alarms = pd.DataFrame(
        {"frame": rng.choice(list(poses), number), "confidence": rng.integers(1, 40, number)}
    )
    alarms = alarms.assign(across=rng.uniform(-7, 7, number), ahead=rng.uniform(5, 10, number))
    truth = pd.DataFrame(
        {"x": rng.uniform(-7.4, 7.4, 15), "y": rng.uniform(0, 2 * frames + 10, 15)}
    )
    truth = truth.assign(target_id=[f"T{k}" for k in range(15)], kind="metal", depth=0.05)
    return alarms.astype({"confidence": float}), poses, truth


@pytest.mark.parametrize("seed", range(5))
def test_counts_are_those_of_the_slow_twin(seed):
    alarms, poses, truth = drive(seed)
    scored = score_frames(alarms, poses, truth, AREA, Rules(halo=0.5, draws=100, shifts=20))
    assert scored.curve.attrs["convention"] == "frames"
    assert scored.curve["area"].iloc[0] == len(poses) * 70.0
    for row in scored.curve.iloc[1::7].to_dict("records"):
        looks, n_false = frame_counts(alarms, poses, truth, AREA, 0.5, row["threshold"])
        assert (row["n_targets"], row["n_detected"], row["n_false"]) == (
            len(looks),
            sum(looks),
            n_false,
        )
        assert row["far"] == pytest.approx(n_false / (len(poses) * 70.0))


def test_a_diameter_is_half_the_radius():
    alarms, poses, truth = drive(1)
    radius, diameter = (
        score_frames(alarms, poses, truth, AREA, Rules(draws=100, shifts=20, **halo)).curve
        for halo in ({"halo": 0.5}, {"halo": 1.0, "halo_as": "diameter"})
    )
    pd.testing.assert_frame_equal(radius, diameter)


def test_an_alarm_beside_a_target_outside_the_area_is_neither():
    truth = pd.DataFrame(
        {"target_id": ["a"], "x": [7.2], "y": [8.0], "kind": "metal", "depth": 0.05}
    )
    poses = {0: np.zeros(6)}
    alarms = pd.DataFrame(
        {"frame": [0, 0], "across": [6.9, 0.0], "ahead": [8.0, 8.0], "confidence": [2.0, 1.0]}
    )
    scored = score_frames(alarms, poses, truth, AREA, Rules(halo=0.5, draws=100))
    last = scored.curve.iloc[-1]
    assert (last["n_targets"], last["n_detected"], last["n_false"]) == (0, 0, 1)


def test_looks_at_one_target_are_drawn_together():
    """Twelve looks at one mine are all found, those at another all missed: Pd is known as badly as of two mines."""
    poses = {frame: np.array([0.0, 0.2 * frame, 0.0, 0.0, 0.0, 0.0]) for frame in range(12)}
    truth = pd.DataFrame(
        {"target_id": ["a", "b"], "x": [-2.0, 2.0], "y": [8.0, 8.0], "kind": "metal", "depth": 0.05}
    )
    alarms = pd.DataFrame({"frame": list(poses), "across": -2.0, "confidence": 2.0})
    alarms = alarms.assign(ahead=8.0 - 0.2 * alarms["frame"])
    strewn = alarms.assign(across=5.0, confidence=1.0)
    scored = score_frames(
        pd.concat([alarms, strewn]), poses, truth, AREA, Rules(halo=0.5, draws=300, shifts=20)
    )
    assert scored.curve["pd"].iloc[-1] == 0.5
    assert scored.pd_mean["low"] == 0.0
    assert scored.pd_mean["high"] == 1.0


def test_no_halo_reaches_from_one_frame_into_the_next():
    alarms, poses, truth = drive(4)
    unrolled = unroll_frames(alarms, poses, truth, AREA, 2.5)
    gaps = unrolled.looks["y"].to_numpy() % unrolled.slot
    assert ((gaps <= 5.0 + 2.5) | (gaps >= unrolled.slot - 2.5)).all()
    with pytest.raises(
        ValueError,
        match=r"halo must be positive and at most 2\.5 m to be scored by frames, got 2\.6",
    ):
        unroll_frames(alarms, poses, truth, AREA, 2.6)
    with pytest.raises(ValueError, match="at least one frame"):
        unroll_frames(alarms.iloc[:0], {}, truth, AREA, 0.5)
    with pytest.raises(
        ValueError, match=r"frame must be one of those that were searched, got alarms of \[99\]"
    ):
        unroll_frames(alarms.assign(frame=99), poses, truth, AREA, 0.5)
