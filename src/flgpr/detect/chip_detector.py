"""A trained detector together with the image chips it looks at."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.detect.linear_quadratic import LinearQuadraticForm


@dataclass(frozen=True)
class ChipDetector:
    """Linear-quadratic forms on raw image chips, whitening included.

    Attributes
    ----------
    forms : tuple of LinearQuadraticForm
        The score is the largest of their values.
    channels : tuple of str
        Names of the image channels in the order of the features, such as ("HH", "VV").
    shape : (int, int)
        Pixels of a chip down-track and cross-track; (28, 1) is the paper's range cut.
    spacing : (float, float)
        Pixel spacing down-track and cross-track, m.
    notes : dict
        How it was trained.
    """

    forms: tuple[LinearQuadraticForm, ...]
    channels: tuple[str, ...]
    shape: tuple[int, int]
    spacing: tuple[float, float]
    notes: dict[str, Any] = field(default_factory=dict)

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
        """Score the chip around every pixel (the "likelihood map" of Cosgrove et al. 2004, Sec. IV-B).

        Parameters
        ----------
        image : (channel, y, x) ndarray
            Image; not finite where nothing was imaged.
        channels : tuple of str, optional
            Names of the image's channels, compared with the detector's when given.
        spacing : (float, float), optional
            Pixel spacing down-track and cross-track, m, compared with the detector's when given. A chip one pixel wide
            fits any cross-track spacing.

        Returns
        -------
        (y, x) ndarray of float32
            Scores; NaN where the chip leaves the image or touches a pixel that is not finite.

        Raises
        ------
        ValueError
            If the image has other channels or pixels than the detector was trained for.
        """
        if channels is not None and tuple(channels) != self.channels:
            raise ValueError(f"channels must be {self.channels}, got {tuple(channels)}")
        axes = [axis for axis in (0, 1) if self.shape[axis] > 1]
        if spacing is not None and not all(np.isclose(spacing[k], self.spacing[k], rtol=1e-3) for k in axes):
            raise ValueError(f"spacing must be {self.spacing} m, got {spacing}")
        maps = [form.likelihood(image, self.shape) for form in self.forms]
        return maps[0] if len(maps) == 1 else np.asarray(np.max(maps, axis=0))
