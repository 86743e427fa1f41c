"""Coherent sums over frames (Fuse et al. 2018, Eq. 4): one reflectivity or many, and what poses cost."""

import numpy as np
import pytest

from clutter.masked_scene import FREQUENCY, PIXELS, REGION, data, disc, noise, operator_on
from flgpr.clutter import (
    FrameStack,
    accuracy_needed,
    averaged,
    averaged_frames,
    coherent_loss_db,
    iterate_frames,
    iterate_suppression,
)
from flgpr.model import SPEED_OF_LIGHT


@pytest.mark.parametrize("seed", range(4))
def test_the_operators_are_exact_adjoints_of_one_another(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-2, 2.5, 0), (2, 6, 0.001), (40, 3))
    stack = FrameStack([operator_on(points, behind) for behind in (0.0, 0.7, 1.5)])
    x = rng.normal(size=(2, 1, 40)) + 1j * rng.normal(size=(2, 1, 40))
    b = rng.normal(size=(3, 2, 16, 99)) + 1j * rng.normal(size=(3, 2, 16, 99))
    left = np.vdot(b, stack.forward(x))
    right = np.vdot(stack.adjoint(b), x)
    assert abs(left - right) < 1e-5 * np.linalg.norm(b) * np.linalg.norm(stack.forward(x))


def test_frames_share_one_reflectivity_or_have_their_own():
    """Where a scatterer changes its phase from frame to frame, only a reflectivity per frame can take it out."""
    behind = (0.0, 0.6, 1.2)
    makes = [lambda points, d=d: operator_on(points, d) for d in behind]
    mask = disc(-1.0, 5.0)
    steady = np.stack([data(-1.0, 5.0, behind=d) for d in behind])
    turning = steady * np.exp(2j * np.pi / 3 * np.arange(3))[:, None, None, None].astype(
        np.complex64
    )

    def stack_on(points):
        return FrameStack([make(points) for make in makes])

    def left(cleaned):
        return np.linalg.norm(cleaned) / np.linalg.norm(steady)

    shared = iterate_suppression(steady, stack_on, PIXELS, mask, REGION)
    assert left(averaged(shared, 6)) < 0.15
    assert left(averaged(iterate_suppression(turning, stack_on, PIXELS, mask, REGION), 6)) > 0.5
    own = iterate_frames(turning, makes, PIXELS, mask, REGION)
    assert len(own) == 3
    assert left(averaged_frames(own, 6)) < 0.2


def test_frame_stacks_refuse_what_does_not_fit():
    with pytest.raises(ValueError, match="at least one frame"):
        FrameStack([])
    with pytest.raises(ValueError, match="1 frames"):
        FrameStack([operator_on(PIXELS[:2, :2])]).adjoint(noise(2, 1, 16, 99))


def test_the_loss_of_a_coherent_sum_is_the_one_predicted():
    error = 0.008
    shift = np.random.default_rng(8).normal(0, error, 4000)
    field = np.exp(-4j * np.pi / SPEED_OF_LIGHT * np.multiply.outer(shift, FREQUENCY))
    measured = -20 * np.log10(np.abs(field.mean(axis=(0, 1))))
    assert measured == pytest.approx(coherent_loss_db(error, FREQUENCY), abs=0.3)
    assert coherent_loss_db(0.0, FREQUENCY) == 0
    need = accuracy_needed(FREQUENCY, 1.0)
    assert coherent_loss_db(need, FREQUENCY) == pytest.approx(1.0, abs=1e-6)
    # One tone: 4.34 (4πfσ/c)² dB.
    assert accuracy_needed([2e9], 1.0) == pytest.approx(
        np.sqrt(1 / 4.3429) * SPEED_OF_LIGHT / (8e9 * np.pi), rel=1e-4
    )
    with pytest.raises(ValueError, match="loss_db"):
        accuracy_needed(FREQUENCY, 0.0)
