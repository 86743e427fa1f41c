"""Images freed from what earlier drives over the same road have seen.

An earlier scan was taken a little before or behind today's, and the array sees the ground from
there in another way: side lobes and grating lobes lie elsewhere. So its data are not imaged for
today's place. The ground's reflectivity is fitted to them by the forward model A, on ground wide
enough to hold what the array sees beside the image, and A of today's array says what today's scan
would see of it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field

from flgpr.clutter import (
    fit_by_model,
    offset_between,
    predicted,
    standing_field,
    subtract_standing,
)
from flgpr.engine import Accumulator, PlannedPass, append_accumulator, concatenate
from flgpr.imaging import ScanImager
from flgpr.jit.threads import blas_on_one_thread
from flgpr.model import SPEED_OF_LIGHT, Grid, lane_to_scan, scan_to_lane
from flgpr.stages import ClutterStage, Positive, Table
from flgpr.stages.standing import StandingSettings, spread_scans, standing_pass
from flgpr.types import AnyArray, Arrays, ComplexArray, FloatArray, floats

BEFORE = "before"
"""Name of an earlier run in ``others``; of several runs each has it with a number, ``before-2``."""


def before_names(count: int) -> list[str]:
    """Return the names of so many earlier runs."""
    return [BEFORE if number == 1 else f"{BEFORE}-{number}" for number in range(1, count + 1)]


_MATCHED = 16  # scans, spread over the run, that tell how well the drives fit
_FITS = 2.0  # dB; independent images of the same statistics are predicted by about 1 dB
STANDING = "earlier.standing"
"""Result that holds what stands still on the vehicle today, ``field``; live, what does so far."""
_REFINED = "earlier.refined"
"""Result that holds that field as it is without the ground that earlier drives predict."""
_THEN = "earlier.then"
"""Result that holds what stood still at each earlier drive, by its name, without today's ground."""
_MATCH = "earlier.match"
_MOST = StandingSettings().most
_REFINING = 32  # scans, spread over the run, whose ground is taken out before their median is taken
_PARTS = 8  # of the band, in each of which what a model says of a scan has a gain of its own
_SPACING = 0.4  # of fitted ground, wavelengths of the highest tone
_KEPT = 256e6  # bytes of fitted ground, and of predictions, that are kept from pass to pass


Look = Callable[[FloatArray], ComplexArray]
"""Gives what an earlier scan says of an image (channel, y, x), for ground moved by an offset (3,), m."""


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


class EarlierRuns(ClutterStage):
    """Subtracts from every image what images of earlier drives predict (:mod:`flgpr.clutter.change`).

    What was laid or lifted since then stays, with all else that has changed. A scan that no earlier
    one lies near keeps its image.
    """

    Settings: ClassVar[type[Table]] = EarlierSettings

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        self._of_thread = threading.local()  # blocks of scans go to several threads
        self._fitted: dict[tuple[str, int, bool], ComplexArray] = {}
        self._predictions: dict[tuple[int, int], tuple[ComplexArray, ComplexArray]] = {}
        self._predicted_bytes = 0
        self._fitting = threading.Lock()
        self._imagers = {
            name: self._imager(name, run)
            for name, run in setup.others.items()
            if name.partition("-")[0] == BEFORE
        }
        if not self._imagers:
            raise ValueError(
                "`before` must give an earlier run of the road for the stage earlier of the recipe, "
                "got none"
            )

    def _imager(self, name: str, run: xr.Dataset) -> ScanImager:
        """Return the imager of a run on this run's pixels."""
        own = self.setup.imager
        labels = [str(own.run["polarization"].values[number]) for number in self.setup.imaged]
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
        chosen = run.sel(polarization=labels)
        return ScanImager(chosen, own.grid, own.subbands, own.window, own.tolerance, own.device)

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:
        """Estimate the bytes of the images and of their moved copies in one channel."""
        copies = settings.looks * (2 * settings.reach + 1) ** 2
        samples = sizes["polarization"] * sizes["pair"] * sizes["frequency"]
        images = 8.0 * image.nx * image.ny * (copies + 16 * settings.looks)
        return images + 4 * 8.0 * 64 * samples + _KEPT + (2 * _KEPT if settings.iterations else 0.0)

    def passes(self) -> list[PlannedPass]:
        """Return the passes of the standing fields of all drives, and of how well the drives fit.

        A median of so many scans still holds about one in so many parts of the ground. Where ground
        is fitted it is taken out first, today's and then that of the earlier drives.
        """
        scans = len(self.setup.imager)
        own = standing_pass(STANDING, scans, _MOST, lambda index: self.before(index, 1)[0])
        match = PlannedPass(_MATCH, "match with earlier drives", self._match, all_scans=True)
        if not self.settings.iterations:
            return [own, match]
        refined = standing_pass(_REFINED, scans, _REFINING, self._without_earlier_ground)
        then = PlannedPass(_THEN, "standing fields of earlier drives", self._then, all_scans=True)
        return [own, refined, then, match]

    @cached_property
    def _medians_then(self) -> dict[str, ComplexArray]:
        """The median over each earlier drive, which is about what stood still on the vehicle."""
        fields = {}
        for name, imager in self._imagers.items():
            chosen = imager.scans[spread_scans(len(imager), _MOST)]
            fields[name] = standing_field(np.stack([imager.signal(int(scan)) for scan in chosen]))
        return fields

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without what stands still on the vehicle."""
        results = self.setup.results
        return subtract_standing(data, results.get(_REFINED, results[STANDING])["field"])

    def _without_earlier_ground(self, index: int) -> ComplexArray:
        """Return the data of a scan less what earlier drives say of its ground."""
        data = self.before(index, 1)[0].copy()
        imaged = self.setup.imaged
        cleaned = self.clean(index, data)[imaged]
        data[imaged] -= self.ground_in(cleaned, self.setup.pose(index))
        return data

    def ground_in(self, cleaned: ComplexArray, pose: FloatArray) -> ComplexArray:
        """Return what the nearest scan of the earlier drives says of the ground in a scan's data.

        Parameters
        ----------
        cleaned : (polarization, pair, frequency) ndarray of complex
            Data of the polarizations that are imaged, without what stands still.
        pose : (6,) ndarray
            The scan's pose.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex
            What the ground adds; 0 where no earlier scan lies near.
        """
        for name, imager in self._imagers.items():
            for scan in self._nearest(imager, pose)[:1]:
                then = floats(imager.run["pose"].values[scan])
                fitted = self._reflectivity(name, scan)
                return self._seen(self.setup.imager, pose, cleaned, fitted, then)
        return np.zeros_like(cleaned)

    def _seen(
        self,
        imager: ScanImager,
        pose: FloatArray,
        cleaned: ComplexArray,
        fitted: ComplexArray,
        then: FloatArray,
    ) -> ComplexArray:
        """Return the part of a scan's data that ground fitted to a scan of another drive explains.

        Both drives are moved onto each other. In each part of the band the echo has the gain that
        fits, for gain and phase drift from day to day.
        """
        operator = imager.operator_at(pose, imager.grid.points(), imager.subbands, imager.window)
        echo = partial(self._echo, imager, pose, fitted, then)
        image = _channels(operator.adjoint(cleaned))
        offset = self._on(image, lambda moved: _channels(operator.adjoint(echo(moved))))[1]
        left = [
            subtract_standing(data, of_part)
            for data, of_part in zip(
                np.array_split(cleaned, _PARTS, axis=-1),
                np.array_split(echo(offset), _PARTS, axis=-1),
                strict=True,
            )
        ]
        return cleaned - np.concatenate(left, axis=-1)

    def _echo(
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
        ground = lane_to_scan(scan_to_lane(self._ground.points(), then), pose) + offset
        return imager.operator_at(pose, ground, self._whole_band).forward(fitted)

    def _then(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what gathers the fields of earlier drives, on scans spread over the run."""
        own = self.setup.imager
        chosen = set(spread_scans(len(own), _REFINING).tolist())
        pieces: dict[str, list[Arrays]] = {name: [] for name in self._imagers}

        def add(index: int) -> None:
            if index not in chosen:
                return
            pose = self.setup.pose(index)
            near = {name: self._nearest(imager, pose)[:1] for name, imager in self._imagers.items()}
            if not any(near.values()):
                return
            fitted = self._fit(own, pose, self.data(index, 1)[0][self.setup.imaged])
            for name, scans in near.items():
                for scan in scans:
                    imager = self._imagers[name]
                    then = floats(imager.run["pose"].values[scan])
                    cleaned = self._cleaned(name, scan)
                    ground = self._seen(imager, then, cleaned, fitted, pose)
                    pieces[name].append({name: (imager.signal(scan) - ground)[None]})

        def state(_: Any) -> Arrays:
            return {
                key: data for each in pieces.values() for key, data in concatenate(each).items()
            }

        def merge(state: Mapping[str, AnyArray]) -> None:
            for name, data in state.items():
                pieces[name].append({name: data})

        def result() -> Arrays:
            return {
                name: standing_field(data) for name, data in state(None).items() if len(data) > 2
            }

        return Accumulator(add, state, merge, result)

    def of_image(self, index: int, image: xr.DataArray) -> xr.DataArray:
        """Return the image of a scan less what earlier drives predict.

        That is kept for later passes, of as many scans as there is memory for.
        """
        key = index, image.sizes["y"]
        known = self._predictions.get(key)
        if known is None:
            known = self._predict(image, range(image.sizes["subband"]), image.sizes["y"])
            with self._fitting:
                self._predicted_bytes += sum(each.nbytes for each in known)
                if self._predicted_bytes <= _KEPT:
                    self._predictions[key] = known
        prediction, earlier = known
        self._of_thread.days = {"today": _channels(image.values), "earlier": earlier}
        return image.copy(data=image.values - prediction.reshape(image.shape))

    def of_part(self, image: xr.DataArray, subbands: Sequence[int], rows: int) -> xr.DataArray:
        """Return the nearest rows of some sub-bands of an image less what earlier drives predict.

        The whole image, with its pose, tells how far the drives are moved onto each other.
        """
        part = image.isel(subband=list(subbands), y=slice(rows))
        prediction, earlier = self._predict(image, subbands, rows)
        self._of_thread.days = {"today": _channels(image.values), "earlier": earlier}
        return part.copy(data=part.values - prediction.reshape(part.shape))

    def _predict(
        self, image: xr.DataArray, subbands: Sequence[int], rows: int
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return what earlier drives predict of a part of an image, and what the nearest scan says.

        Both are (channel, y, x), 0 and NaN without an earlier scan.
        """
        looks = list(self._looks(floats(image.attrs["pose"]), image.sizes["y"]))
        values = _channels(image.values)
        channels = np.arange(len(values)).reshape(image.shape[:2])[:, subbands].ravel()
        earlier = [self._on(values, look)[0] for look in looks]
        if not earlier:
            return np.zeros_like(values[channels, :rows]), np.full_like(values, np.nan)
        of_part = [one[channels] for one in earlier]
        return self._prediction(values[channels], of_part, rows), earlier[0]

    @property
    def days(self) -> dict[str, ComplexArray]:
        """The last image (channel, y, x) that this thread cleaned: as it was ``today``, and ``earlier``.

        The latter is what the nearest earlier scan says of its ground, NaN without one.
        """
        days: dict[str, ComplexArray] = self._of_thread.days
        return days

    def _prediction(
        self, values: ComplexArray, earlier: list[ComplexArray], rows: int | None = None
    ) -> ComplexArray:
        """Predict the nearest rows of channels (channel, y, x) of an image."""
        grid = self.setup.imager.grid
        stretch = (round(self.settings.stretch / grid.dy), round(self.settings.stretch / grid.dx))
        channels = []
        with blas_on_one_thread():  # of products as small as these its threads wait for one another
            for number, channel in enumerate(values):
                of_channel = [look[number] for look in earlier]
                channels.append(predicted(channel, of_channel, stretch, self.settings.reach, rows))
        return np.stack(channels)

    def _on(self, values: ComplexArray, look: Look) -> tuple[ComplexArray, FloatArray]:
        """Return an earlier look moved onto an image (channel, y, x), and the offset (3,), m."""
        grid = self.setup.imager.grid
        most = (round(self.settings.search / grid.dy), round(self.settings.search / grid.dx))
        image = look(np.zeros(3))
        rows, columns = offset_between(values, image, most)
        offset = np.array([columns * grid.dx, rows * grid.dy, 0.0])
        return look(offset) if offset.any() else image, offset

    def is_alone(self, pose: FloatArray) -> bool:
        """Return whether no earlier scan lies near a pose (6,)."""
        return not any(self._nearest(imager, pose) for imager in self._imagers.values())

    def _nearest(self, imager: ScanImager, pose: FloatArray) -> list[int]:
        """Return the scans of an earlier run that lie nearest to a pose of this one."""
        places = floats(imager.run["pose"].values[imager.scans])[:, :2]
        away = np.hypot(*(places - pose[:2]).T)
        nearest = np.argsort(away, kind="stable")[: self.settings.looks]
        return [int(imager.scans[one]) for one in nearest if away[one] <= self.settings.within]

    def _looks(self, pose: FloatArray, rows: int) -> Iterator[Look]:
        """Yield what earlier drives say of the image (channel, y, x) of a scan at a pose."""
        own = self.setup.imager
        points = own.grid.points()[:rows]
        today = own.operator_at(pose, points, own.subbands, own.window)

        def modelled(fitted: ComplexArray, then: FloatArray, offset: FloatArray) -> ComplexArray:
            return _channels(today.adjoint(self._echo(own, pose, fitted, then, offset)))

        def imaged(
            imager: ScanImager, data: ComplexArray, then: FloatArray, offset: FloatArray
        ) -> ComplexArray:
            there = lane_to_scan(scan_to_lane(points - offset, pose), then)
            operator = imager.operator_at(then, there, imager.subbands, imager.window)
            return _channels(operator.adjoint(data))

        for name, imager in self._imagers.items():
            for scan in self._nearest(imager, pose):
                then = floats(imager.run["pose"].values[scan])
                if self.settings.iterations:
                    yield partial(modelled, self._reflectivity(name, scan), then)
                else:
                    yield partial(imaged, imager, self._cleaned(name, scan), then)

    @cached_property
    def _whole_band(self) -> dict[str, tuple[float, float]]:
        """The band that holds all sub-bands."""
        edges = np.array(list(self.setup.imager.subbands.values()))
        return {"whole": (float(edges[:, 0].min()), float(edges[:, 1].max()))}

    @cached_property
    def _ground(self) -> Grid:
        """The ground that is fitted to the data of an earlier scan, in its frame."""
        image, margin = self.setup.imager.grid, self.settings.margin
        if margin is None:
            heights = [imager.run["pose"].values[:, 2] for imager in self._imagers.values()]
            margin = max(float(np.nanmedian(np.concatenate(heights))), image.dx)
        across, ahead = image.x, image.y
        return Grid.spanning(
            (float(across[0]) - margin, float(across[-1]) + margin),
            (max(float(ahead[0]) - margin / 2, float(ahead[0]) / 5), float(ahead[-1]) + margin / 2),
            _SPACING * SPEED_OF_LIGHT / self._whole_band["whole"][1],
        )

    def _cleaned(self, name: str, scan: int) -> ComplexArray:
        """Return the data of an earlier scan without what stood still."""
        field = self.setup.results.get(_THEN, {}).get(name)
        if field is None:
            field = self._medians_then[name]
        return subtract_standing(self._imagers[name].signal(scan), field)

    def _reflectivity(self, name: str, scan: int) -> ComplexArray:
        """Return the ground (polarization, 1, y, x) that explains the data of an earlier scan.

        The latest are kept: neighbouring scans and later passes want the same ones.
        """
        key = name, scan, _THEN in self.setup.results
        with self._fitting:
            fitted = self._fitted.pop(key, None)
        if fitted is None:
            imager = self._imagers[name]
            pose = floats(imager.run["pose"].values[scan])
            fitted = self._fit(imager, pose, self._cleaned(name, scan))
        with self._fitting:
            while self._fitted and (len(self._fitted) + 1) * fitted.nbytes > _KEPT:
                del self._fitted[next(iter(self._fitted))]
            self._fitted[key] = fitted
        return fitted

    def _fit(self, imager: ScanImager, pose: FloatArray, data: ComplexArray) -> ComplexArray:
        """Fit the ground to the data of a scan."""
        operator = imager.operator_at(pose, self._ground.points(), self._whole_band)
        return fit_by_model(data, operator, self.settings.iterations)

    def _match(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what gathers how well the drives fit, on scans spread over the run."""
        scans = len(self.setup.imager)
        chosen = set(spread_scans(scans, _MATCHED).tolist())
        today = self._imager("itself", self.setup.run)
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            if index in chosen:
                data = self.data(index, 1)[0][self.setup.imaged]
                image = today.image(int(today.scans[index]), data).values
                values = image.reshape(-1, *image.shape[-2:])
                looks = self._looks(self.setup.pose(index), image.shape[-2])
                matched = [self._on(values, look) for look in looks]
                if matched:
                    left = values - self._prediction(values, [look for look, _ in matched])
                    power = np.array([np.vdot(values, values).real, np.vdot(left, left).real])
                    offset = np.array([np.hypot(*offset[:2]) for _, offset in matched])
                    pieces.append({"power": power[None], "offset": offset})

        return append_accumulator(pieces, add)

    def notes(self) -> dict[str, Any]:
        """Return how well the drives fit, and how many scans no earlier one lies near."""
        match = self.setup.results[_MATCH]
        scans = range(len(self.setup.imager))
        alone = sum(self.is_alone(self.setup.pose(index)) for index in scans)
        notes: dict[str, Any] = {"earlier_runs": len(self._imagers), "scans_without_earlier": alone}
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
        count = len(self._imagers)
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


def _channels(image: ComplexArray) -> ComplexArray:
    """Return an image (polarization, subband, y, x) as (channel, y, x)."""
    return image.reshape(-1, *image.shape[-2:])


def _suppression(power: FloatArray) -> float:
    """Return by how much subtraction lowers a power, before and after, dB."""
    before, left = power
    return round(float(10 * np.log10(before / left)), 1)
