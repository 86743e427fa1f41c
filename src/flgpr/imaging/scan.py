"""Imaging a run scan by scan, in the scan frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.imaging.looks import count_looks
from flgpr.imaging.operator import ImagingOperator
from flgpr.model import Grid, check_run, complete_scans, vehicle_to_scan


class ScanImager:
    """Make the images of a run, one scan at a time.

    A scan image is the coherent sum over the array's pairs (Wang et al. 2007, Sec. II), on a grid
    that moves with the vehicle: the scan frame of ``model.frames``. While height and attitude stay
    the same, so does the operator. A run that is not valid or has no complete scan, or a sub-band
    without a tone, is a ValueError.

    Parameters
    ----------
    run, grid : xarray.Dataset, Grid
        A run, and the pixels in the scan frame.
    subbands : mapping of str to (lo, hi)
        Names and edges in Hz.
    window, tolerance, device
        As in :class:`ImagingOperator`.

    Examples
    --------
    >>> from flgpr.imaging import ScanImager
    >>> from flgpr.io import open_run, sample_lane
    >>> from flgpr.model import Grid
    >>> run = open_run(sample_lane() / "run.zarr")
    >>> grid = Grid.spanning((-1.0, 1.0), (2.0, 5.0), 0.05)
    >>> imager = ScanImager(run, grid, {"all": (0.45e9, 1.5e9), "low": (0.45e9, 0.8e9)}, window="hann")
    >>> dict(imager.image(0).sizes)
    {'polarization': 4, 'subband': 2, 'y': 61, 'x': 41}
    >>> sum(1 for scan in imager)  # an iteration makes all scans, one at a time
    3
    """

    def __init__(
        self, run: xr.Dataset, grid: Grid, subbands: Mapping[str, tuple[float, float]],
        window: str | ArrayLike | None = None, tolerance: float = 1e-3, device: str = "cpu",
    ) -> None:  # fmt: skip
        self.run = check_run(run)
        self.grid = grid
        if not subbands:
            raise ValueError("subbands must name at least one band, got none")
        self.subbands = dict(subbands)
        self.window = window
        self.tolerance = tolerance
        self.device = device
        complete = complete_scans(run)
        self.scans = np.flatnonzero(complete)
        self.masked_scans = np.flatnonzero(~complete)
        if not self.scans.size:
            raise ValueError(
                f"run must have a scan without missing sweeps, got none among {complete.size}"
            )
        self._poses = np.asarray(run["pose"].values, dtype=np.float64)
        self._held: tuple[tuple[float, ...], ImagingOperator] | None = None
        self._blanks: dict[int, xr.DataArray] = {}

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[xr.DataArray]:
        for scan in self.scans:
            yield self.image(int(scan))

    def operator(self, scan: int) -> ImagingOperator:
        """Imaging operator of a scan on the grid."""
        pose = self._poses[scan]
        key = tuple(pose[[2, 4, 5]])
        held = self._held  # read and set in one step: several threads may ask
        if held is None or held[0] != key:
            held = self._held = key, self.operator_on(scan, self.grid.points(), self.subbands)
        return held[1]

    def operator_on(
        self,
        scan: int,
        points: NDArray[np.float64],
        subbands: Mapping[str, tuple[float, float]] | None = None,
    ) -> ImagingOperator:
        """Imaging operator of a scan on other points (..., 3) of the scan frame, by default over the whole band."""
        pose = self._poses[scan]
        return ImagingOperator(
            self.run["frequency"].values,
            vehicle_to_scan(self.run["tx_position"].values, pose),
            vehicle_to_scan(self.run["rx_position"].values, pose),
            points,
            subbands=None if subbands is None else list(subbands.values()),
            window=self.window if subbands is not None else None,
            tolerance=self.tolerance,
            device=self.device,
        )

    def signal(self, scan: int) -> NDArray[np.complex64]:
        """Read the data (polarization, pair, frequency) of a scan."""
        return np.asarray(self.run.variables["signal"].isel(scan=scan).values, dtype=np.complex64)

    def image(
        self, scan: int, signal: ArrayLike | None = None, rows: int | None = None
    ) -> xr.DataArray:
        """Image one scan, or other data of it such as cleaned ones: complex64 (polarization, subband, y, x).

        Its attributes ``scan`` and ``pose`` tell where it was taken. ``rows`` are those nearest, by default all.
        """
        data = self.signal(scan) if signal is None else signal
        return self.labelled(scan, self.operator(scan).adjoint(data, rows=rows))

    def labelled(self, scan: int, values: NDArray[np.complex64]) -> xr.DataArray:
        """Attach to values (polarization, subband, y, x) the names, axes and pose of a scan's image."""
        rows = values.shape[-2]
        blank = self._blanks.get(rows)
        if blank is None:
            axes = (
                self.run["polarization"].values,
                list(self.subbands),
                self.grid.y[:rows],
                self.grid.x,
            )
            blank = self._blanks[rows] = blank_image(*axes)
        image = blank.copy(deep=False, data=values)
        image.attrs = {"scan": scan, "pose": self._poses[scan].tolist()}
        return image

    def looks(self, points: ArrayLike) -> NDArray[np.int64]:
        """Count the complete scans whose grid holds each point (..., 3) of the lane frame."""
        return count_looks(self._poses[self.scans], self.grid, points)


def blank_image(
    polarization: ArrayLike, subband: ArrayLike, y: ArrayLike, x: ArrayLike
) -> xr.DataArray:
    """Make names and axes of images, with no pixels in memory: to copy them takes a tenth of the time of new ones."""
    axes = {"polarization": polarization, "subband": subband, "y": y, "x": x}
    pixels = np.broadcast_to(np.complex64(0), tuple(map(np.size, axes.values())))
    return xr.DataArray(pixels, dims=tuple(axes), coords=axes, name="image")
