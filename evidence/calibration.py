"""How often the calibration by reflectors tells an answer, and how often a wrong one, on simulated runs.

Run ``python evidence/calibration.py [ROUNDS] [--joint]``; a round is two runs of every kind and number of reflectors.
The counts in docs/evidence/measured-data.md are of 50 rounds, and of 20 with ``--joint``, which
leaves two kinds of runs out.
"""

import sys

import numpy as np

from flgpr.calibrate import BiasFit, estimate_joint, estimate_range_bias
from flgpr.clutter import remove_standing
from flgpr.imaging import ImagingOperator
from flgpr.model import make_run
from flgpr.model.phase import path_phase
from flgpr.model.track import make_track, poses_at

FREQUENCY = np.linspace(1e9, 2.5e9, 101)
CLUTTER = 80  # points
# amplitude of clutter and of noise in a tone, reflectors' amplitude, errors of their places (m)
KINDS = {
    "weak noise": (0.0, 0.3, 1.0, 0.0),
    "clutter, -14 dB": (0.2, 0.3, 1.0, 0.0),
    "strong noise": (0.0, 6.0, 1.0, 0.0),
    "clutter, -6 dB": (0.5, 0.3, 1.0, 0.0),
    "places 5 cm off": (0.2, 0.3, 1.0, 0.05),
    "no reflector, noise": (0.0, 1.0, 0.0, 0.0),
    "no reflector, clutter": (0.5, 0.3, 0.0, 0.0),
    "wrong places": (0.2, 0.3, 1.0, np.nan),
}
NOT_JOINT = ("clutter, -6 dB", "places 5 cm off")


def gaussian(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Draw complex numbers of unit power."""
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def attempt(
    seed: int, ahead: bool, reflectors: int, kind: str, joint: bool
) -> tuple[BiasFit, bool, float]:
    """Simulate one run and calibrate it: the answer, whether it is right, its error over the deviation told."""
    rng = np.random.default_rng([seed, ahead, reflectors, joint])
    clutter, noise, amplitude, misplaced = KINDS[kind]
    stamp = np.linspace(-4, 22, 600)
    time = np.arange(17.0) if ahead else np.arange(0, 9, 0.1)
    way = (
        0.5 * stamp + 0.6 * np.sin(0.5 * stamp)
        if ahead
        else -1.5 + 3 / (1 + np.exp(-(stamp - 4.5) / 0.8))
    )
    zero = np.zeros(stamp.size)
    track = make_track(
        stamp, np.stack([zero, way, zero + 2.0] if ahead else [way, zero, zero + 1.5], axis=1)
    )
    antennas = np.linspace([-1, 0, 0], [1, 0, 0], 8) if ahead else np.zeros((1, 3))
    low, high = ([-3, 11, 0], [3, 18, 0]) if ahead else ([-2, 4.5, 0], [2, 9, 0])
    marks = rng.uniform(low, high, (reflectors, 3))
    while any(np.linalg.norm(a - b) < 1 for k, a in enumerate(marks) for b in marks[:k]):
        marks = rng.uniform(low, high, (reflectors, 3))
    points = np.concatenate([marks, rng.uniform(low, high, (CLUTTER, 3))])
    echoes = np.concatenate(
        [np.full(reflectors, amplitude, complex), clutter * gaussian(rng, CLUTTER)]
    )
    bias = rng.uniform(-2.5, 2.5)
    offset = rng.uniform(-0.8, 0.8) if joint else 0.0
    pose = poses_at(track, time, offset)
    there = pose[:, None, :3] + antennas
    signal = noise * gaussian(rng, time.size, len(antennas), FREQUENCY.size)
    for point, echo in zip(points[echoes != 0], echoes[echoes != 0], strict=True):
        signal += echo * path_phase(FREQUENCY, 2 * (np.linalg.norm(there - point, axis=-1) + bias))
    signal += 5 * path_phase(FREQUENCY, 0.6) + 3 * path_phase(
        FREQUENCY, 4.4
    )  # coupling, and the vehicle's own echo
    run = remove_standing(
        make_run(signal[:, None], FREQUENCY, ["VV"], antennas, antennas, pose, time)
    )
    away = rng.normal(size=(reflectors, 2)) * misplaced
    if np.isnan(misplaced):
        turn = rng.uniform(0, 2 * np.pi, reflectors)
        away = rng.uniform(0.5, 2, (reflectors, 1)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    marks[:, :2] += away
    if joint:
        offsets = np.arange(-1.5, 1.51, 0.1 if ahead else 0.05)
        fit = estimate_joint(run, marks, ImagingOperator, (-3, 3), track, offsets)
    else:
        fit = estimate_range_bias(run, marks, ImagingOperator, 3.0)
    founded = amplitude > 0 and not np.isnan(misplaced)
    right = founded and abs(fit.bias - bias) < 0.15 and abs((fit.offset or 0.0) - offset) < 0.2
    return fit, right, (fit.bias - bias) / fit.bias_sigma


def main() -> None:
    """Print how many answers were told, and how many of them were wrong."""
    rounds = int(next((word for word in sys.argv[1:] if word.isdigit()), "5"))
    joint = "--joint" in sys.argv
    for kind in KINDS:
        if joint and kind in NOT_JOINT:
            continue
        for reflectors in (1, 2, 3):
            runs = [
                attempt(seed, ahead, reflectors, kind, joint)
                for seed in range(rounds)
                for ahead in (False, True)
            ]
            told = [right for fit, right, _ in runs if not fit.doubt]
            size = np.sqrt(
                np.mean(
                    [error**2 for fit, right, error in runs if right and not fit.doubt] or [np.nan]
                )
            )
            counts = f"{len(runs)} runs, {len(told)} told, {told.count(False)} wrong"
            print(
                f"{kind}, {reflectors}: {counts}; errors {size:.2f} standard deviations rms",
                flush=True,
            )


if __name__ == "__main__":
    main()
