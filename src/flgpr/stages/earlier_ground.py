"""Ground fitted to the data of one drive, and what a scan of another drive sees of it.

A scan of another drive was taken a little before or behind, and the array sees the ground from
there in another way: side lobes and grating lobes lie elsewhere. So the ground's reflectivity is
fitted to its data by the forward model A, on ground wide enough to hold what the array sees beside
the image, and A at the scan's own place says what this one would see of it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from flgpr.clutter import fit_by_model, offset_between, standing_field, subtract_standing
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, lane_to_scan, scan_to_lane
from flgpr.stages.standing import StandingSettings, spread_scans
from flgpr.types import Arrays, ComplexArray, FloatArray, floats

_PARTS = 8  # of the band, in each of which what a model says of a scan has a gain of its own
_MOST_PIXELS = 10_000_000  # of fitted ground
_SPACING = 0.4  # of fitted ground, wavelengths of the highest tone
_APART = 0.5  # m, least distance of the scan whose ground is taken out of another one


class GroundModel:
    """Fits ground to the data of scans, and says what other scans receive from it.

    Parameters
    ----------
    image : Grid
        Pixels of the images, in the scan frame.
    margin : float
        Ground on both sides of the image, half of it before and behind, m.
    subbands : mapping of str to (lo, hi)
        Sub-bands of the images, Hz; the ground is fitted over all that they span.
    iterations : int
        Of the fit.
    """

    def __init__(
        self,
        image: Grid,
        margin: float,
        subbands: Mapping[str, tuple[float, float]],
        iterations: int,
    ) -> None:
        edges = np.array(list(subbands.values()))
        self._band = {"whole": (float(edges[:, 0].min()), float(edges[:, 1].max()))}
        self._iterations = iterations
        near, far = float(image.y[0]), float(image.y[-1])
        ground = Grid.spanning(
            (float(image.x[0]) - margin, float(image.x[-1]) + margin),
            (max(near - margin / 2, near / 5), far + margin / 2),
            _SPACING * SPEED_OF_LIGHT / self._band["whole"][1],
        )
        if ground.nx * ground.ny > _MOST_PIXELS:
            raise ValueError(
                f"margin of the stage earlier must leave at most {_MOST_PIXELS:,} pixels of fitted "
                f"ground, got {margin:g} m, {ground.nx * ground.ny:,} pixels; by default it is the "
                "height of the array of the earlier runs, which must be over the ground"
            )
        self._ground = ground.points()

    def fit(self, imager: ScanImager, pose: FloatArray, data: ComplexArray) -> ComplexArray:
        """Return the ground (polarization, 1, y, x) that explains the data of a scan at a pose."""
        operator = imager.operator_at(pose, self._ground, self._band)
        return fit_by_model(data, operator, self._iterations)

    def echo(
        self,
        imager: ScanImager,
        pose: FloatArray,
        fitted: ComplexArray,
        then: FloatArray,
        offset: FloatArray,
    ) -> ComplexArray:
        """Return what a scan at a pose receives from ground fitted to a scan at another one.

        The ground is moved by an offset (3,), m.
        """
        ground = lane_to_scan(scan_to_lane(self._ground, then), pose) + offset
        return imager.operator_at(pose, ground, self._band).forward(fitted)


class ModelledLook:
    """What the image of a scan shows of ground fitted to a scan of another drive.

    Parameters
    ----------
    echo_at : callable
        Returns the echo in the scan's data of ground moved by an offset (3,), m.
    operator : ImagingOperator
        Images the scan.

    Attributes
    ----------
    echo : (polarization, pair, frequency) ndarray of complex
        What the last image was made of.
    """

    def __init__(
        self, echo_at: Callable[[FloatArray], ComplexArray], operator: ImagingOperator
    ) -> None:
        self._echo_at = echo_at
        self._operator = operator

    def image(self, offset: FloatArray) -> ComplexArray:
        """Return the image (channel, y, x) of ground moved by an offset (3,), m."""
        self.echo = self._echo_at(offset)
        return as_channels(self._operator.adjoint(self.echo))


class ImagedLook:
    """The image of a scan of another drive on a scan's pixels, without a model.

    Parameters
    ----------
    imager : ScanImager
        Of the other drive, with the pixels that are imaged.
    points : (y, x, 3) ndarray
        These pixels in the scan's frame, m.
    pose, then : (6,) ndarray
        Poses of the scan and of the other drive's.
    data : (polarization, pair, frequency) ndarray of complex
        Data of the other drive's scan.
    """

    echo = None

    def __init__(
        self,
        imager: ScanImager,
        points: FloatArray,
        pose: FloatArray,
        then: FloatArray,
        data: ComplexArray,
    ) -> None:
        self._imager = imager
        self._points = points
        self._poses = pose, then
        self._data = data

    def image(self, offset: FloatArray) -> ComplexArray:
        """Return the image (channel, y, x) of ground moved by an offset (3,), m."""
        pose, then = self._poses
        there = lane_to_scan(scan_to_lane(self._points - offset, pose), then)
        imager = self._imager
        operator = imager.operator_at(then, there, imager.subbands, imager.window)
        return as_channels(operator.adjoint(self._data))


Look = ModelledLook | ImagedLook


def moved_onto(
    values: ComplexArray, look: Look, grid: Grid, search: float
) -> tuple[ComplexArray, FloatArray]:
    """Move a look of another drive onto an image (channel, y, x).

    Parameters
    ----------
    values : (channel, y, x) ndarray of complex
        The image.
    look : ModelledLook or ImagedLook
        What the other drive says of it.
    grid : Grid
        Its pixels.
    search : float
        Largest offset that is looked for along an axis, m.

    Returns
    -------
    image : (channel, y, x) ndarray of complex
        The look where it fits best.
    offset : (3,) ndarray of float
        What it was moved by, m.
    """
    most = (round(search / grid.dy), round(search / grid.dx))
    image = look.image(np.zeros(3))
    rows, columns = offset_between(values, image, most)
    offset = np.array([columns * grid.dx, rows * grid.dy, 0.0])
    return look.image(offset) if offset.any() else image, offset


def explained(data: ComplexArray, echo: ComplexArray) -> ComplexArray:
    """Return the part of a scan's data (polarization, pair, frequency) that an echo explains.

    In each part of the band the echo has the gain that fits, for gain and phase drift from day to
    day.
    """
    parts = zip(
        np.array_split(data, _PARTS, axis=-1), np.array_split(echo, _PARTS, axis=-1), strict=True
    )
    left = [subtract_standing(of_data, of_echo) for of_data, of_echo in parts]
    return data - np.concatenate(left, axis=-1)


class FittedGround:
    """The ground fitted to scans of earlier drives that was wanted last, for threads to share.

    Neighbouring scans and later passes want the same ones.
    """

    def __init__(self, most_bytes: float) -> None:
        self._most_bytes = most_bytes
        self._kept: dict[object, ComplexArray] = {}
        self._lock = threading.Lock()

    def of(self, key: object, fit: Callable[[], ComplexArray]) -> ComplexArray:
        """Return the ground of a key; it is fitted where it is not kept."""
        with self._lock:
            fitted = self._kept.pop(key, None)
        if fitted is None:
            fitted = fit()
        with self._lock:
            while self._kept and (len(self._kept) + 1) * fitted.nbytes > self._most_bytes:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = fitted
        return fitted


class EarlierDrive:
    """An earlier drive over the road.

    Parameters
    ----------
    name : str
        Name of its run.
    imager : ScanImager
        Images its scans on today's pixels.
    model : GroundModel
        Fits ground to its scans.
    kept : FittedGround
        Keeps ground that was fitted.
    results : mapping of str to Arrays
        Results of passes; :attr:`result` among them, once it is there, has the ``field`` that stood
        still at this drive.
    """

    def __init__(
        self,
        name: str,
        imager: ScanImager,
        model: GroundModel,
        kept: FittedGround,
        results: Mapping[str, Arrays],
    ) -> None:
        self.imager = imager
        self.result = f"earlier.then.{name}"
        self._results = results
        self._model = model
        self._kept = kept
        self._places = floats(imager.run["pose"].values[imager.scans])[:, :2]

    def pose(self, scan: int) -> FloatArray:
        """Return the pose (6,) of a scan."""
        return floats(self.imager.run["pose"].values[scan])

    def nearest(self, pose: FloatArray, looks: int, within: float) -> list[int]:
        """Return the scans that lie nearest to a pose, so many at most and none farther away."""
        away = np.hypot(*(self._places - pose[:2]).T)
        nearest = np.argsort(away, kind="stable")[:looks]
        return [int(self.imager.scans[one]) for one in nearest if away[one] <= within]

    def cleaned(self, scan: int) -> ComplexArray:
        """Return the data (polarization, pair, frequency) of a scan without what stood still."""
        return subtract_standing(self.imager.signal(scan), self.standing)

    def ground(self, scan: int) -> ComplexArray:
        """Return the ground (polarization, 1, y, x) that explains the data of a scan."""
        key = self.result, scan, self.result in self._results
        return self._kept.of(
            key, lambda: self._model.fit(self.imager, self.pose(scan), self.cleaned(scan))
        )

    @property
    def standing(self) -> ComplexArray:
        """What stood still on the vehicle, as a pass tells; the median of the data until then."""
        known: ComplexArray | None = self._results.get(self.result, {}).get("field")
        return self.median if known is None else known

    @cached_property
    def median(self) -> ComplexArray:
        """The median of its data, which is about what stood still on the vehicle."""
        chosen = self.imager.scans[spread_scans(len(self.imager), StandingSettings().most)]
        return standing_field(np.stack([self.imager.signal(int(scan)) for scan in chosen]))

    def standing_alone(self, most: int) -> ComplexArray:
        """Estimate what stood still on the vehicle (polarization, pair, frequency), by this drive alone.

        The median of so few scans still holds a part of the ground, about one in their number. So
        the ground that the scan beside it shows is taken out of each before their median is taken.

        Parameters
        ----------
        most : int
            Number of scans that are taken at most.
        """
        imager = self.imager
        left = []
        for scan in imager.scans[spread_scans(len(imager), most)]:
            signal, pose = imager.signal(int(scan)), self.pose(int(scan))
            beside = self._beside(pose)
            if beside is not None:
                ground, there = self.ground(beside), self.pose(beside)
                echo = self._model.echo(imager, pose, ground, there, np.zeros(3))
                signal = signal - explained(self.cleaned(int(scan)), echo)
            left.append(signal)
        return standing_field(np.stack(left))

    def _beside(self, pose: FloatArray) -> int | None:
        """Return the nearest scan from where ground looks otherwise than what stands still does."""
        away = np.hypot(*(self._places - pose[:2]).T)
        away[away < _APART] = np.inf
        nearest = int(np.argmin(away))
        return int(self.imager.scans[nearest]) if np.isfinite(away[nearest]) else None


def as_channels(image: ComplexArray) -> ComplexArray:
    """Return an image (polarization, subband, y, x) as (channel, y, x)."""
    return image.reshape(-1, *image.shape[-2:])
