"""A trained detector together with the image chips it looks at."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.detect.linear_quadratic import LinearQuadraticForm


@dataclass(frozen=True)
class ChipDetector:
    """Linear-quadratic forms on raw image chips, whitening included; the score is the largest of their values."""

    forms: tuple[LinearQuadraticForm, ...]
    channels: tuple[str, ...]  #: names of the image channels in the order of the features, such as ("HH", "VV")
    shape: tuple[int, int]  #: pixels of a chip down-track and cross-track; (28, 1) is the paper's range cut
    spacing: tuple[float, float]  #: pixel spacing down-track and cross-track, m
    notes: dict[str, Any] = field(default_factory=dict)  #: how it was trained

    def __post_init__(self) -> None:
        if not self.forms:
            raise ValueError("forms must hold at least one form, got none")
        features = len(self.channels) * self.shape[0] * self.shape[1]
        if any(form.linear.size != features for form in self.forms):
            sizes = [form.linear.size for form in self.forms]
            raise ValueError(f"forms must have {features} features for these channels and chips, got {sizes}")
        if not all(step > 0 for step in self.spacing):
            raise ValueError(f"spacing must be positive, got {self.spacing}")

    def likelihood(
        self, image: NDArray[Any], channels: tuple[str, ...] | None = None, spacing: tuple[float, float] | None = None
    ) -> NDArray[np.float32]:
        """Score the chip around every pixel of an image (channel, y, x) (Cosgrove et al. 2004, Sec. IV-B).

        The image's channels and pixel spacing (down-track and cross-track, m) are compared with the detector's when
        given; others are a ValueError. A chip one pixel wide fits any cross-track spacing. Scores (y, x) are NaN where
        the chip leaves the image or touches a pixel that is not finite.
        """
        if channels is not None and tuple(channels) != self.channels:
            raise ValueError(f"channels must be {self.channels}, got {tuple(channels)}")
        axes = [axis for axis in (0, 1) if self.shape[axis] > 1]
        if spacing is not None and not all(np.isclose(spacing[k], self.spacing[k], rtol=1e-3) for k in axes):
            raise ValueError(f"spacing must be {self.spacing} m, got {spacing}")
        maps = [form.likelihood(image, self.shape) for form in self.forms]
        return maps[0] if len(maps) == 1 else np.asarray(np.max(maps, axis=0))
