"""The patch about an alarm and its regions (Wang et al. 2007)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flgpr.types import BoolArray, FloatArray


@dataclass(frozen=True)
class PatchShape:
    """Size and regions of an incoherent patch."""

    size: int = 25  #: pixels along a side, odd; the paper's patch has 25
    spacing: float = 0.1  #: pixel spacing, m
    inner: tuple[int, int] = (5, 3)  #: inner region, pixels cross-track x down-track
    #: inner and guard region together; what lies outside it is the outer region
    guard: tuple[int, int] = (9, 7)

    def __post_init__(self) -> None:
        sizes = (self.size, *self.inner, *self.guard)
        if any(n < 1 or n % 2 == 0 for n in sizes):
            raise ValueError(
                f"patch size, inner and guard must be odd numbers of pixels, got {sizes}"
            )
        for inner, guard in zip(self.inner, self.guard, strict=True):
            if not inner <= guard < self.size:
                raise ValueError(
                    "patch must have inner <= guard < size, "
                    f"got {self.inner}, {self.guard}, {self.size}"
                )
        if not self.spacing > 0:
            raise ValueError(f"patch spacing must be positive, got {self.spacing}")

    def offsets(self) -> FloatArray:
        """Return the pixel centres about the patch's centre, (size, size, 2): x, y in m."""
        along = (np.arange(self.size) - self.size // 2) * self.spacing
        return np.stack(np.meshgrid(along, along), axis=-1)

    def region(self, pixels: tuple[int, int]) -> BoolArray:
        """Return the mask (y, x) of the central ``pixels`` (cross-track, down-track)."""
        offset = np.abs(np.arange(self.size) - self.size // 2)
        return (offset[:, None] <= pixels[1] // 2) & (offset[None, :] <= pixels[0] // 2)
