"""Likelihood maps of the linear-quadratic detector, and the relevance vector machine."""

from __future__ import annotations

import numpy as np

from flgpr.detect import (
    ChipDetector,
    RelevanceVectorClassifier,
    deflection_form,
    leave_one_out,
)

from .data import complex_noise, ripley, size

CASES = {
    "rank 1": (2, (28, 1), 1),
    "rank 3": (2, (28, 1), 3),
    "rank 6": (2, (28, 1), 6),
    "rank 3, 12 channels": (12, (28, 1), 3),
    "rank 3, chips of 28 x 13": (2, (28, 13), 3),
}
"""Channels, shape of a chip and rank of the quadratic part."""


def random_detector(channels: int, shape: tuple[int, int], rank: int) -> ChipDetector:
    """Make a detector of whitened data whose moments are drawn at random."""
    rng = np.random.default_rng(1)
    features = channels * shape[0] * shape[1]
    mean = complex_noise(rng, (features,))
    form = deflection_form(mean, np.eye(features), rank=rank)
    form = form.after(mean, np.eye(features) + 0j)
    names = tuple(f"channel {number}" for number in range(channels))
    return ChipDetector((form,), names, shape, (0.02, 0.05))


class Likelihood:
    """Likelihood map of a 12 m x 19 m image at 5 cm x 2 cm."""

    params = tuple(CASES)
    param_names = ("detector",)

    def setup(self, case: str) -> None:
        self.detector = random_detector(*CASES[case])
        rng = np.random.default_rng(2)
        shape = (len(self.detector.channels), size(951, 95), size(241, 31))
        self.image = complex_noise(rng, shape).astype(np.complex64)
        self.detector.likelihood(self.image)

    def time_map(self, case: str) -> None:
        self.detector.likelihood(self.image)


class Relevance:
    """Relevance vector machine on Ripley's two classes of two normals each."""

    def setup(self) -> None:
        self.examples, self.label = ripley(size(600, 60), 1)
        self.machine = RelevanceVectorClassifier(gamma=4.0)
        self.machine.fit(self.examples[:60], self.label[:60])

    def time_fit(self) -> None:
        self.machine.fit(self.examples, self.label)

    def time_leave_one_out(self) -> None:
        count = size(150, 20)
        leave_one_out(self.machine, self.examples[:count], self.label[:count])
