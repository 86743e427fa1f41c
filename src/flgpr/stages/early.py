"""Data freed from what arrives before the ground that is imaged."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from flgpr.clutter import early_basis, subtract_early
from flgpr.model import vehicle_to_scan
from flgpr.stages import ClutterStage, Positive, Table
from flgpr.types import Complex128Array, ComplexArray, Entries

_POSES = 16  # whose heights and attitudes are looked at
_PIXELS = 40  # rows, and columns, of the image that are looked at


class EarlyEchoesSettings(Table):
    """Echoes of paths up to ``path`` (there and back, m) are taken out.

    By default it is the shortest path by way of a pixel of the images.
    """

    path: Positive | None = None


class EarlyEchoes(ClutterStage):
    """Takes out direct wave and ground under the array, by path, in the whole band."""

    Settings: ClassVar[type[Table]] = EarlyEchoesSettings

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without early echoes."""
        return subtract_early(data, self._basis)

    def notes(self) -> Entries:
        """Return up to which path echoes are taken out, m."""
        return {"early_path": round(self._path, 3)}

    @cached_property
    def _basis(self) -> Complex128Array:
        """What spans the early echoes."""
        return early_basis(self.setup.run["frequency"].values, self._path)

    @cached_property
    def _path(self) -> float:
        """Longest path that is taken out, m."""
        if self.settings.path is not None:
            return float(self.settings.path)
        grid = self.setup.images
        rows = np.unique(np.linspace(0, grid.ny - 1, _PIXELS).astype(int))
        columns = np.unique(np.linspace(0, grid.nx - 1, _PIXELS).astype(int))
        pixels = grid.points()[rows[:, None], columns].reshape(-1, 3)
        run = self.setup.run
        scans = len(self.setup.imager)
        shortest = np.inf
        for index in np.unique(np.linspace(0, scans - 1, min(scans, _POSES)).astype(int)):
            paths = 0.0
            for end in ("tx_position", "rx_position"):
                antennas = vehicle_to_scan(run[end].values, self.setup.pose(int(index)))
                paths = paths + np.linalg.norm(antennas[:, None] - pixels, axis=-1)
            shortest = min(shortest, float(np.min(paths)))
        return shortest
