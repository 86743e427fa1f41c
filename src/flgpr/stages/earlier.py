"""Images freed from what earlier drives over the same road have seen.

What an earlier scan says of today's image is modelled from the ground that is fitted to its data
(``earlier_ground.py``), and predicts the image by :mod:`flgpr.clutter.change`.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field

from flgpr.clutter import predicted, subtract_standing
from flgpr.engine import Accumulator, PlannedPass, append_accumulator
from flgpr.imaging import ScanImager
from flgpr.jit.threads import blas_on_one_thread
from flgpr.model import Grid, complete_scans
from flgpr.stages import ClutterStage, Positive, Table, imaged_labels, scan_bytes
from flgpr.stages.earlier_ground import (
    EarlierDrive,
    FittedGround,
    GroundModel,
    ImagedLook,
    Look,
    ModelledLook,
    as_channels,
    explained,
    moved_onto,
)
from flgpr.stages.standing import StandingSettings, spread_scans, standing_pass
from flgpr.types import Arrays, ComplexArray, Entries, FloatArray, floats

BEFORE = "before"
"""Name of an earlier run in ``others``; of several runs each has it with a number, ``before-2``."""


LEAST_SCANS = 3
"""Complete scans of an earlier drive: the median of fewer holds as much ground as vehicle."""


def check_earlier(run: xr.Dataset, what: object) -> None:
    """Refuse an earlier run, called ``what``, with too few scans to tell what stood still."""
    complete = int(complete_scans(run).sum())
    if complete < LEAST_SCANS:
        raise ValueError(
            f"{what}: an earlier run must have {LEAST_SCANS} complete scans or more, got {complete}"
        )


def before_names(count: int) -> list[str]:
    """Return the names of so many earlier runs."""
    return [BEFORE if number == 1 else f"{BEFORE}-{number}" for number in range(1, count + 1)]


def is_before(name: str) -> bool:
    """Return whether a name among ``others`` is that of an earlier run."""
    return name.partition("-")[0] == BEFORE


_MATCHED = 16  # scans, spread over the run, that tell how well the drives fit
_FITS = 2.0  # dB; independent images of the same statistics are predicted by about 1 dB
STANDING = "earlier.standing"
"""Result that holds what stands still on the vehicle today, ``field``; live, what does so far."""
_REFINED = "earlier.refined"
"""Result that holds that field as it is without the ground that earlier drives predict."""
_MATCH = "earlier.match"
_MOST = StandingSettings().most
_REFINING = 32  # scans, spread over the run, whose ground is taken out before their median is taken
_SAME_PLACE = 1e-3  # m, by which antennas of two drives lie apart at most where they are the same
_KEPT = 256e6  # bytes of fitted ground, and of predictions, that are kept from pass to pass


class EarlierSettings(Table):
    """Lengths in m."""

    looks: Annotated[int, Field(ge=1, le=16)] = 3  #: nearest scans of each earlier run
    within: Positive = 3.0  #: greatest distance of their places from the scan's
    search: Positive = 0.3  #: largest offset between the tracks of two drives that is looked for
    stretch: Positive = 2.0  #: side of the ground on which gain, phase and place are matched
    reach: Annotated[int, Field(ge=0, le=4)] = 1  #: pixels by which copies are moved in the match
    #: of the fit of earlier data by the forward model; 0 images them as they are, in less time
    iterations: Annotated[int, Field(ge=0, le=50)] = 8
    #: ground that is fitted on both sides of the image, half of it before and behind; None takes
    #: the height of the array: what lies there shows in the image by side lobes and grating lobes
    margin: Positive | None = None


@dataclass(frozen=True)
class Prediction:
    """What earlier drives say of a scan's image."""

    image: ComplexArray  #: (channel, y, x) predicted part that is wanted; 0 without earlier scans
    nearest: ComplexArray  #: (channel, y, x) what the nearest one says of all of it; NaN without
    offsets: list[FloatArray]  #: (3,) by which each earlier scan was moved, m
    #: (polarization, pair, frequency) of the ground fitted to the nearest one; None without
    echo: ComplexArray | None


class EarlierRuns(ClutterStage):
    """Subtracts from every image what images of earlier drives predict (:mod:`flgpr.clutter.change`).

    What was laid or lifted since then stays, with all else that has changed. A scan that no earlier
    one lies near keeps its image.
    """

    Settings: ClassVar[type[Table]] = EarlierSettings

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        imagers = {
            name: self._imager(name, run) for name, run in setup.others.items() if is_before(name)
        }
        if not imagers:
            raise ValueError(
                "`before` must give an earlier run of the road for the stage earlier of the recipe, "
                "got none"
            )
        own = setup.imager
        margin = settings.margin
        if margin is None:
            heights = [imager.run["pose"].values[:, 2] for imager in imagers.values()]
            margin = max(float(np.nanmedian(np.concatenate(heights))), own.grid.dx)
        self._model = GroundModel(own.grid, margin, own.subbands, settings.iterations)
        self._fitted = FittedGround(_KEPT)
        self._drives = [
            EarlierDrive(name, imager, self._model, self._fitted, setup.results)
            for name, imager in imagers.items()
        ]
        self._of_thread = threading.local()  # blocks of scans go to several threads
        self._predictions: dict[tuple[int, int], Prediction] = {}
        self._predicted_bytes = 0
        self._predicting = threading.Lock()

    def _imager(self, name: str, run: xr.Dataset) -> ScanImager:
        """Return the imager of a run on this run's pixels."""
        own = self.setup.imager
        labels = imaged_labels(self.setup)
        lacking = [label for label in labels if label not in run["polarization"].values]
        if lacking:
            raise ValueError(
                f"run {name} must have the polarizations {', '.join(labels)}, which are imaged, got "
                f"none of {', '.join(lacking)}"
            )
        tones, own_tones = run["frequency"].values, own.run["frequency"].values
        if not np.array_equal(tones, own_tones):
            raise ValueError(
                f"run {name} must have the tones of the run, {len(own_tones)} from "
                f"{own_tones[0]:.6g} to {own_tones[-1]:.6g} Hz, got {len(tones)} from "
                f"{tones[0]:.6g} to {tones[-1]:.6g} Hz"
            )
        check_earlier(run, f"run {name}")
        chosen = run.sel(polarization=labels)
        return ScanImager(chosen, own.grid, own.subbands, own.window, own.tolerance, own.device)

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:
        """Estimate the bytes of the images and of their moved copies in one channel."""
        copies = settings.looks * (2 * settings.reach + 1) ** 2
        images = 8.0 * image.nx * image.ny * (copies + 16 * settings.looks)
        return (
            images
            + 4 * 64 * scan_bytes(sizes)
            + _KEPT
            + (2 * _KEPT if settings.iterations else 0.0)
        )

    def passes(self) -> list[PlannedPass]:
        """Return the passes of the standing fields of all drives, and of how well the drives fit.

        A median of so many scans still holds about one in so many parts of the ground. Where ground
        is fitted it is taken out first, today's and then that of the earlier drives.
        """
        scans = len(self.setup.imager)
        own = standing_pass(STANDING, scans, _MOST, self._data_before)
        match = PlannedPass(_MATCH, "match with earlier drives", self._match, all_scans=True)
        if not self.settings.iterations:
            return [own, match]
        refined = standing_pass(_REFINED, scans, _REFINING, self._without_earlier_ground)
        then = [
            standing_pass(
                drive.result,
                scans,
                _REFINING,
                partial(self._without_ground_of_today, drive),
                least=LEAST_SCANS,
            )
            for drive in self._drives
        ]
        return [own, refined, *then, match]

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without what stands still on the vehicle."""
        results = self.setup.results
        return subtract_standing(data, results.get(_REFINED, results[STANDING])["field"])

    def _without_earlier_ground(self, index: int) -> ComplexArray:
        """Return the data of a scan less what earlier drives say of its ground."""
        data = self._data_before(index).copy()
        imaged = self.setup.imaged
        cleaned = self.clean(index, data)[imaged]
        ground = self.ground_in(cleaned, self.setup.pose(index))
        if ground is not None:
            data[imaged] -= ground
        return data

    def _without_ground_of_today(self, drive: EarlierDrive, index: int) -> ComplexArray | None:
        """Return the data of the earlier scan nearest to a scan, less what this one says of them.

        There are none where no earlier scan lies near.
        """
        pose = self.setup.pose(index)
        for scan in self._nearest(drive, pose)[:1]:
            data = self._imaged_data(index)
            fit = partial(self._model.fit, self.setup.imager, pose, data)
            today = self._fitted.of(index, fit)
            cleaned = drive.cleaned(scan)
            ground = self._seen(drive.imager, drive.pose(scan), cleaned, today, pose)
            return drive.imager.signal(scan) - ground
        return None

    def _imaged_data(self, index: int) -> ComplexArray:
        """Return the cleaned data of a scan, of the polarizations that are imaged."""
        return self.data(index, 1)[0][self.setup.imaged]

    def ground_in(self, cleaned: ComplexArray, pose: FloatArray) -> ComplexArray | None:
        """Return what the nearest scan of the earlier drives says of the ground in a scan's data.

        Parameters
        ----------
        cleaned : (polarization, pair, frequency) ndarray of complex
            Data of the polarizations that are imaged, without what stands still.
        pose : (6,) ndarray
            The scan's pose.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex or None
            What the ground adds; None where no earlier scan lies near.
        """
        for drive in self._drives:
            for scan in self._nearest(drive, pose)[:1]:
                imager, ground = self.setup.imager, drive.ground(scan)
                return self._seen(imager, pose, cleaned, ground, drive.pose(scan))
        return None

    def _seen(
        self,
        imager: ScanImager,
        pose: FloatArray,
        cleaned: ComplexArray,
        fitted: ComplexArray,
        then: FloatArray,
    ) -> ComplexArray:
        """Return the part of a scan's data that ground fitted to a scan of another drive explains."""
        operator = imager.operator_at(pose, imager.grid.points(), imager.subbands, imager.window)
        look = ModelledLook(partial(self._model.echo, imager, pose, fitted, then), operator)
        moved_onto(as_channels(operator.adjoint(cleaned)), look, imager.grid, self.settings.search)
        return explained(cleaned, look.echo)

    def of_image(self, index: int, image: xr.DataArray) -> xr.DataArray:
        """Return the image of a scan less what earlier drives predict.

        That is kept for later passes, of as many scans as there is memory for.
        """
        key = index, image.sizes["y"]
        prediction = self._predictions.get(key)
        if prediction is None:
            prediction = self.predict(image.values, floats(image.attrs["pose"]))
            with self._predicting:
                self._predicted_bytes += prediction.image.nbytes + prediction.nearest.nbytes
                if self._predicted_bytes <= _KEPT:
                    self._predictions[key] = replace(prediction, echo=None)
        self._of_thread.days = {"today": as_channels(image.values), "earlier": prediction.nearest}
        return image.copy(data=image.values - prediction.image.reshape(image.shape))

    def predict(
        self,
        image: ComplexArray,
        pose: FloatArray,
        subbands: Sequence[int] | None = None,
        rows: int | None = None,
    ) -> Prediction:
        """Return what earlier drives say of the image of a scan.

        Parameters
        ----------
        image : (polarization, subband, y, x) ndarray of complex
            The image. All of it tells how far the drives are moved onto each other.
        pose : (6,) ndarray
            The scan's pose.
        subbands : sequence of int, optional
            The sub-bands whose prediction is wanted; by default all.
        rows : int, optional
            The nearest rows of which it is wanted; by default all.
        """
        grid, values = self.setup.imager.grid, as_channels(image)
        numbers = np.arange(len(values)).reshape(image.shape[:2])
        channels = (numbers if subbands is None else numbers[:, subbands]).ravel()
        looks = list(self._looks(pose, values.shape[1]))
        if not looks:
            unknown = np.full_like(values, np.nan)
            return Prediction(np.zeros_like(values[channels, :rows]), unknown, [], None)
        moved = [moved_onto(values, look, grid, self.settings.search) for look in looks]
        stretch = (round(self.settings.stretch / grid.dy), round(self.settings.stretch / grid.dx))
        with blas_on_one_thread():  # of products as small as these its threads wait for one another
            of_channels = [
                predicted(
                    values[channel],
                    [look[channel] for look, _ in moved],
                    stretch,
                    self.settings.reach,
                    rows,
                )
                for channel in channels
            ]
        offsets = [offset for _, offset in moved]
        return Prediction(np.stack(of_channels), moved[0][0], offsets, looks[0].echo)

    @property
    def days(self) -> dict[str, ComplexArray]:
        """The last image (channel, y, x) that this thread cleaned: as it was ``today``, and ``earlier``.

        The latter is what the nearest earlier scan says of its ground, NaN without one.
        """
        days: dict[str, ComplexArray] = self._of_thread.days
        return days

    def estimate_alone(self) -> None:
        """Put what stood still at each earlier drive, by that drive alone, among the results.

        Live there is nothing of today to tell it by.
        """
        drives = self._drives if self.settings.iterations else []
        for drive in drives:
            field = drive.standing_alone(_REFINING)
            self.setup.results[drive.result] = {"field": field}

    @property
    def stood_still(self) -> ComplexArray | None:
        """What stood still at the first earlier drive; None where its array was another one."""
        own, first = self.setup.imager.run, self._drives[0]
        for end in ("tx_position", "rx_position"):
            places, then = own[end].values, first.imager.run[end].values
            if places.shape != then.shape or not np.allclose(places, then, atol=_SAME_PLACE):
                return None
        return first.standing

    def is_alone(self, pose: FloatArray) -> bool:
        """Return whether no earlier scan lies near a pose (6,)."""
        return not any(self._nearest(drive, pose) for drive in self._drives)

    def _nearest(self, drive: EarlierDrive, pose: FloatArray) -> list[int]:
        """Return the scans of an earlier drive that lie near a pose, the nearest first."""
        return drive.nearest(pose, self.settings.looks, self.settings.within)

    def _looks(self, pose: FloatArray, rows: int) -> Iterator[Look]:
        """Yield what earlier drives say of the nearest rows of the image of a scan at a pose."""
        own = self.setup.imager
        points = own.grid.points()[:rows]
        today = own.operator_at(pose, points, own.subbands, own.window)
        for drive in self._drives:
            for scan in self._nearest(drive, pose):
                then = drive.pose(scan)
                if self.settings.iterations:
                    echo_at = partial(self._model.echo, own, pose, drive.ground(scan), then)
                    yield ModelledLook(echo_at, today)
                else:
                    yield ImagedLook(drive.imager, points, pose, then, drive.cleaned(scan))

    def _match(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what gathers how well the drives fit, on scans spread over the run."""
        own = self.setup.imager
        chosen = set(spread_scans(len(own), _MATCHED).tolist())
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            if index not in chosen:
                return
            data, pose = self._imaged_data(index), self.setup.pose(index)
            operator = own.operator_at(pose, own.grid.points(), own.subbands, own.window)
            image = operator.adjoint(data)
            prediction = self.predict(image, pose)
            if prediction.offsets:
                left = as_channels(image) - prediction.image
                power = np.array([np.vdot(image, image).real, np.vdot(left, left).real])
                offsets = np.hypot(*np.array(prediction.offsets)[:, :2].T)
                pieces.append({"power": power[None], "offset": offsets})

        return append_accumulator(pieces, add)

    def notes(self) -> Entries:
        """Return how well the drives fit, and how many scans no earlier one lies near."""
        match = self.setup.results[_MATCH]
        scans = range(len(self.setup.imager))
        alone = sum(self.is_alone(self.setup.pose(index)) for index in scans)
        notes: Entries = {"earlier_runs": len(self._drives), "scans_without_earlier": alone}
        if "power" in match:
            notes["earlier_suppression_db"] = _suppression(match["power"].sum(axis=0))
            notes["earlier_offset"] = round(float(np.median(match["offset"])), 3)
        return notes

    def sentences(self) -> list[str]:
        """Return how well the drives fit, and what of the run is judged without the earlier ones."""
        match, scans = self.setup.results[_MATCH], len(self.setup.imager)
        power = match["power"].sum(axis=0) if "power" in match else np.zeros(2)
        offset = float(np.median(match["offset"])) if "power" in match else None
        return self.sentences_of(self.notes()["scans_without_earlier"], scans, power, offset)

    @property
    def changes(self) -> str:
        """What alarms are, in words."""
        count = len(self._drives)
        drives = "an earlier drive predicts" if count == 1 else f"{count} earlier drives predict"
        return f"what {drives} is subtracted, so what lay there then does not stand out"

    def sentences_of(
        self, alone: int, scans: int, power: FloatArray, offset: float | None = None
    ) -> list[str]:
        """Return how well the drives fit, in words.

        Parameters
        ----------
        alone, scans : int
            Scans that no earlier one lies near, and all scans.
        power : (2,) ndarray
            Power of images of the others, before what is predicted is subtracted and after.
        offset : float, optional
            Median of what the tracks are moved by, m.
        """
        if alone == scans:
            return [
                f"no scan lies within {self.settings.within:g} m of one of an earlier drive: nothing is "
                "subtracted; give runs of this road, whose poses are in the same lane frame"
            ]
        suppression = _suppression(power)
        tracks = "" if offset is None else f", tracks moved by {100 * offset:.0f} cm in the median"
        said = [f"{self.changes} ({suppression:g} dB of the images{tracks})"]
        if suppression < _FITS:
            said.append(
                f"the drives hardly fit (less than {_FITS:g} dB): ground or radar have changed too much "
                "between them, and what stands out may be old"
            )
        if alone:
            said.append(
                f"{alone} of {scans} scans lie more than {self.settings.within:g} m from every earlier "
                "one: their images are as without earlier drives"
            )
        return said


def _suppression(power: FloatArray) -> float:
    """Return by how much subtraction lowers a power, before and after, dB."""
    before, left = power
    return round(float(10 * np.log10(before / left)), 1)
