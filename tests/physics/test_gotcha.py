"""Measured X-band phase history (AFRL Gotcha, pass 1, HH): point targets at their published places and widths."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from flgpr.imaging import ImagingOperator

TARGETS = [(-15.63, 21.59), (-27.80, 38.80)]
WIDTH_RANGE = 0.505
WIDTH_CROSS = 0.467


@pytest.fixture(scope="module")
def gotcha():
    folder = Path(os.environ.get("FLGPR_MEASURED_DATA", "")) / "gotcha"
    if not os.environ.get("FLGPR_MEASURED_DATA") or not folder.is_dir():
        pytest.skip("FLGPR_MEASURED_DATA has no gotcha folder")
    parts = [loadmat(path)["data"][0, 0] for path in sorted(folder.glob("*.mat"))]
    position = np.concatenate([np.stack([p[n].ravel() for n in "xyz"], 1) for p in parts])
    phase = np.concatenate([p["fp"].T for p in parts])
    return (
        parts[0]["freq"].ravel(),
        position,
        phase,
        np.concatenate([p["r0"].ravel() for p in parts]),
    )


def hann(count):
    return np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2


def width_at_half_power(profile, step):
    level = np.abs(profile) / np.abs(profile).max() - np.sqrt(0.5)
    top = int(np.argmax(level))
    left = max(i for i in range(top) if level[i] < 0)
    right = min(i for i in range(top, len(level)) if level[i] < 0)
    first = left + level[left] / (level[left] - level[left + 1])
    last = right - level[right] / (level[right] - level[right - 1])
    return (last - first) * step


@pytest.mark.parametrize("target", TARGETS)
def test_point_targets_stand_where_they_should_and_are_as_wide(gotcha, target):
    frequency, position, phase, reference = gotcha
    data = (phase * hann(len(phase))[:, None])[None]
    centre = np.append(target, 0.0)
    look = position.mean(axis=0) - centre
    along = np.append(look[:2] / np.hypot(*look[:2]), 0.0)
    across = np.array([-along[1], along[0], 0.0])

    def image(points):
        operator = ImagingOperator(
            frequency,
            position,
            position,
            points,
            window=hann(len(frequency)),
            path_offset=2 * reference,
            tolerance=1e-3,
        )
        return operator.adjoint(data)[0, 0]

    offsets = np.arange(-0.6, 0.6001, 0.05)
    points = centre + offsets[:, None, None] * along + offsets[None, :, None] * across
    row, column = np.unravel_index(np.abs(image(points)).argmax(), (len(offsets),) * 2)
    assert max(abs(offsets[row]), abs(offsets[column])) <= 0.1
    peak = centre + offsets[row] * along + offsets[column] * across
    step = 0.02
    line = np.arange(-0.8, 0.8, step)[:, None]
    assert width_at_half_power(image(peak + line * along), step) == pytest.approx(
        WIDTH_RANGE, rel=0.05
    )
    assert width_at_half_power(image(peak + line * across), step) == pytest.approx(
        WIDTH_CROSS, rel=0.05
    )
