"""Imaging a run scan by scan, in the scan frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from flgpr.imaging.looks import count_looks
from flgpr.imaging.operator import ImagingOperator
from flgpr.model import Grid, check_run, complete_scans, vehicle_to_scan
from flgpr.model.constants import IMAGE_ATTRS
from flgpr.model.run import described
from flgpr.types import ArrayLike, ComplexArray, FloatArray, IntArray, floats


class ScanImager:
    """Compute the images of a run, one scan at a time.

    A scan image is the coherent sum over the array's pairs (Wang et al. 2007, Sec. II), on a grid
    that moves with the vehicle: the scan frame of ``model.frames``. The operator is used again
    while height and attitude stay the same.

    Parameters
    ----------
    run, grid : xarray.Dataset, Grid
        A run, and the pixels in the scan frame.
    subbands : mapping of str to (lo, hi)
        Names and edges in Hz.
    window, tolerance, device
        As in :class:`ImagingOperator`.

    Raises
    ------
    ValueError
        If the run is not valid or has no complete scan, or a sub-band has no tone.

    Examples
    --------
    >>> from flgpr.imaging import ScanImager
    >>> from flgpr.store import open_run, sample_lane
    >>> from flgpr.model import Grid
    >>> run = open_run(sample_lane() / "run.zarr")
    >>> grid = Grid.spanning((-1.0, 1.0), (2.0, 5.0), 0.05)
    >>> subbands = {"all": (0.45e9, 1.5e9), "low": (0.45e9, 0.8e9)}
    >>> imager = ScanImager(run, grid, subbands, window="hann")
    >>> dict(imager.image(0).sizes)
    {'polarization': 4, 'subband': 2, 'y': 61, 'x': 41}
    >>> sum(1 for image in imager)  # iterating images all scans, one at a time
    3
    """

    def __init__(
        self,
        run: xr.Dataset,
        grid: Grid,
        subbands: Mapping[str, tuple[float, float]],
        window: str | ArrayLike | None = None,
        tolerance: float = 1e-3,
        device: str = "cpu",
    ) -> None:
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
        self._poses = floats(run["pose"].values)
        # The last operator with the height, pitch and roll for which it holds.
        self._last_operator: tuple[tuple[float, ...], ImagingOperator] | None = None
        self._blanks: dict[int, xr.DataArray] = {}  # by number of rows

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[xr.DataArray]:
        for scan in self.scans:
            yield self.image(int(scan))

    def operator(self, scan: int) -> ImagingOperator:
        """Return the imaging operator of a scan on the grid."""
        pose = self._poses[scan]
        attitude = tuple(pose[[2, 4, 5]])
        last = self._last_operator  # read and set in one step each: several threads may ask
        if last is None or last[0] != attitude:
            last = (attitude, self.operator_on(scan, self.grid.points(), self.subbands))
            self._last_operator = last
        return last[1]

    def operator_on(
        self,
        scan: int,
        points: FloatArray,
        subbands: Mapping[str, tuple[float, float]] | None = None,
    ) -> ImagingOperator:
        """Return the imaging operator of a scan on other points.

        Parameters
        ----------
        scan : int
            Number of the scan.
        points : (..., 3) ndarray
            Points of the scan frame, m.
        subbands : mapping of str to (lo, hi), optional
            Names and edges in Hz; by default the whole band without a window.

        Returns
        -------
        ImagingOperator
            The operator.
        """
        window = self.window if subbands is not None else None
        return self.operator_at(self._poses[scan], points, subbands, window)

    def operator_at(
        self,
        pose: FloatArray,
        points: FloatArray,
        subbands: Mapping[str, tuple[float, float]] | None = None,
        window: str | ArrayLike | None = None,
    ) -> ImagingOperator:
        """Return the operator of the run's array at a pose (6,) on points of its scan frame."""
        return ImagingOperator(
            self.run["frequency"].values,
            vehicle_to_scan(self.run["tx_position"].values, pose),
            vehicle_to_scan(self.run["rx_position"].values, pose),
            points,
            subbands=None if subbands is None else list(subbands.values()),
            window=window,
            tolerance=self.tolerance,
            device=self.device,
        )

    def signal(self, scan: int) -> ComplexArray:
        """Read the data (polarization, pair, frequency) of a scan."""
        return np.asarray(self.run.variables["signal"].isel(scan=scan).values, dtype=np.complex64)

    def image(
        self, scan: int, signal: ArrayLike | None = None, rows: int | None = None
    ) -> xr.DataArray:
        """Return the image of one scan.

        Parameters
        ----------
        scan : int
            Number of the scan.
        signal : (polarization, pair, frequency) array_like, optional
            Data instead of those of the run, such as cleaned ones.
        rows : int, optional
            Nearest rows to image, by default all.

        Returns
        -------
        (polarization, subband, y, x) xarray.DataArray of complex64
            Image in the scan frame, with the attributes ``scan`` and ``pose``.
        """
        data = self.signal(scan) if signal is None else signal
        return self.labelled(scan, self.operator(scan).adjoint(data, rows=rows))

    def labelled(self, scan: int, values: ComplexArray) -> xr.DataArray:
        """Return values (polarization, subband, y, x) with the names, axes and pose of a scan."""
        rows = values.shape[-2]
        if rows not in self._blanks:
            self._blanks[rows] = blank_image(
                self.run["polarization"].values,
                list(self.subbands),
                self.grid.y[:rows],
                self.grid.x,
            )
        image = self._blanks[rows].copy(deep=False, data=values)
        image.attrs |= {"scan": scan, "pose": self._poses[scan].tolist()}
        return image

    def looks(self, points: ArrayLike) -> IntArray:
        """Count the complete scans whose grid holds each point (..., 3) of the lane frame."""
        return count_looks(self._poses[self.scans], self.grid, points)


def blank_image(
    polarization: ArrayLike, subband: ArrayLike, y: ArrayLike, x: ArrayLike
) -> xr.DataArray:
    """Return an image with names and axes but no pixels in memory.

    To copy it takes a tenth of the time of a new one.

    Parameters
    ----------
    polarization, subband : array_like of str
        Labels of the channels.
    y, x : array_like
        Pixel centres, m.

    Returns
    -------
    (polarization, subband, y, x) xarray.DataArray of complex64
        Image of zeros.
    """
    axes = {"polarization": polarization, "subband": subband, "y": y, "x": x}
    pixels = np.broadcast_to(np.complex64(0), tuple(map(np.size, axes.values())))
    image = xr.DataArray(pixels, dims=tuple(axes), coords=axes, name="image")
    return described(image, IMAGE_ATTRS)
