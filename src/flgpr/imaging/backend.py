"""What computes the imaging sums, on whatever device (``cpu.py``, ``cuda.py``)."""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.types import AnyArray


class Backend:
    """Compute the adjoint and the forward sums of checked arrays, in the memory of the host."""

    method = "profile"
    width: int

    def adjoint(self, data: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone).

        ``out`` holds all pixels or the first ones.
        """
        raise NotImplementedError

    def forward(self, image: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        raise NotImplementedError

    def buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> AnyArray:
        """Allocate memory for images."""
        return np.empty(shape, dtype)

    def device_seconds(self, rows: int, subbands: int, repeats: int = 10) -> tuple[float, float]:
        """Refuse: sums on the CPU have no transfers to leave out."""
        raise ValueError(
            f"device must be 'cuda' to time {rows} rows of {subbands} sub-bands {repeats} times, "
            "got 'cpu'"
        )
