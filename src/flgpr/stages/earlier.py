"""Images freed from what earlier drives over the same road have seen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field

from flgpr.clutter import moved, offset_between, predicted, subtract_standing
from flgpr.engine import Accumulator, PlannedPass, append_accumulator
from flgpr.imaging import ScanImager
from flgpr.model import Grid, lane_to_scan, scan_to_lane
from flgpr.stages import ClutterStage, Positive, Table
from flgpr.stages.standing import StandingSettings, standing_pass
from flgpr.types import Arrays, ComplexArray, FloatArray, floats

BEFORE = "before"
"""Name of an earlier run in ``others``; of several runs each has it with a number, ``before-2``."""
_MATCHED = 16  # scans, spread over the run, that tell how well the drives fit
_FITS = 2.0  # dB; independent images of the same statistics are predicted by about 1 dB
_STANDING = "earlier.standing"
_MATCH = "earlier.match"


class EarlierSettings(Table):
    """Lengths in m."""

    looks: Annotated[int, Field(ge=1, le=16)] = 3  #: nearest scans of each earlier run
    within: Positive = 3.0  #: greatest distance of their places from the scan's
    search: Positive = 0.3  #: largest offset between the tracks of two drives that is looked for
    stretch: Positive = 2.0  #: side of the ground on which gain, phase and place are matched
    reach: Annotated[int, Field(ge=0, le=4)] = 1  #: pixels by which copies are moved in the match


class EarlierRuns(ClutterStage):
    """Subtracts from every image what images of earlier drives predict (:mod:`flgpr.clutter.change`).

    What was laid or lifted since then stays, with all else that has changed. A scan that no earlier
    one lies near keeps its image.
    """

    not_live_because = "only the whole run shows what stands still"
    Settings: ClassVar[type[Table]] = EarlierSettings

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
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
        return 8.0 * image.nx * image.ny * (copies + 16 * settings.looks) + 4 * 8.0 * 64 * samples

    def passes(self) -> list[PlannedPass]:
        """Return the passes of the standing fields of all drives, and of how well the drives fit."""
        most = StandingSettings().most
        today = self.setup.imager
        planned = [
            standing_pass(_STANDING, len(today), most, lambda index: self.before(index, 1)[0])
        ]
        for name, imager in self._imagers.items():
            planned.append(self._standing_of(name, imager, most, len(today)))
        planned.append(
            PlannedPass(_MATCH, "match with earlier drives", self._match, all_scans=True)
        )
        return planned

    def _standing_of(self, name: str, imager: ScanImager, most: int, scans: int) -> PlannedPass:
        """Return the pass of an earlier run's standing field, which goes over today's scans."""
        places = np.linspace(0, len(imager) - 1, scans)

        def read(index: int) -> ComplexArray:
            return imager.signal(int(imager.scans[round(places[index])]))

        return standing_pass(f"{_STANDING}.{name}", scans, most, read)

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without what stands still on the vehicle."""
        return subtract_standing(data, self.setup.results[_STANDING]["field"])

    def of_image(self, index: int, image: xr.DataArray) -> xr.DataArray:
        """Return the image of a scan less what earlier drives predict."""
        looks = list(self._looks(index, image.sizes["y"]))
        if not looks:
            return image
        values = image.values.reshape(-1, *image.shape[-2:])
        earlier = [self._on(values, look)[0] for look in looks]
        return image.copy(data=(values - self._prediction(values, earlier)).reshape(image.shape))

    def _prediction(self, values: ComplexArray, earlier: list[ComplexArray]) -> ComplexArray:
        """Predict all channels (channel, y, x) of an image."""
        grid = self.setup.imager.grid
        stretch = (round(self.settings.stretch / grid.dy), round(self.settings.stretch / grid.dx))
        channels = []
        for number, channel in enumerate(values):
            of_channel = [look[number] for look in earlier]
            channels.append(predicted(channel, of_channel, stretch, self.settings.reach))
        return np.stack(channels)

    def _on(self, values: ComplexArray, look: ComplexArray) -> tuple[ComplexArray, FloatArray]:
        """Return an earlier look moved onto an image (channel, y, x), and by how much, m."""
        grid = self.setup.imager.grid
        most = (round(self.settings.search / grid.dy), round(self.settings.search / grid.dx))
        rows, columns = offset_between(values, look, most)
        return moved(look, rows, columns), np.hypot(rows * grid.dy, columns * grid.dx)

    def _nearest(self, imager: ScanImager, index: int) -> list[int]:
        """Return the scans of an earlier run that lie nearest to a scan of this one."""
        pose = self.setup.pose(index)
        places = floats(imager.run["pose"].values[imager.scans])[:, :2]
        away = np.hypot(*(places - pose[:2]).T)
        nearest = np.argsort(away, kind="stable")[: self.settings.looks]
        return [int(imager.scans[one]) for one in nearest if away[one] <= self.settings.within]

    def _looks(self, index: int, rows: int) -> Iterator[ComplexArray]:
        """Yield earlier images (channel, y, x) of the ground ahead of a scan."""
        points = scan_to_lane(self.setup.imager.grid.points()[:rows], self.setup.pose(index))
        for name, imager in self._imagers.items():
            field = self.setup.results[f"{_STANDING}.{name}"]["field"]
            for scan in self._nearest(imager, index):
                there = lane_to_scan(points, floats(imager.run["pose"].values[scan]))
                data = subtract_standing(imager.signal(scan), field)
                image = imager.operator_on(scan, there, imager.subbands).adjoint(data)
                yield image.reshape(-1, *image.shape[-2:])

    def _match(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what gathers how well the drives fit, on scans spread over the run."""
        scans = len(self.setup.imager)
        chosen = set(np.linspace(0, scans - 1, min(scans, _MATCHED)).round().astype(int).tolist())
        today = self._imager("itself", self.setup.run)
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            if index in chosen:
                data = self.data(index, 1)[0][self.setup.imaged]
                image = today.image(int(today.scans[index]), data).values
                values = image.reshape(-1, *image.shape[-2:])
                matched = [self._on(values, look) for look in self._looks(index, image.shape[-2])]
                if matched:
                    left = values - self._prediction(values, [look for look, _ in matched])
                    power = np.array([np.vdot(values, values).real, np.vdot(left, left).real])
                    offset = np.array([away for _, away in matched])
                    pieces.append({"power": power[None], "offset": offset})

        return append_accumulator(pieces, add)

    def notes(self) -> dict[str, Any]:
        """Return how well the drives fit, and how many scans no earlier one lies near."""
        match = self.setup.results[_MATCH]
        alone = 0
        for index in range(len(self.setup.imager)):
            alone += not any(self._nearest(imager, index) for imager in self._imagers.values())
        notes: dict[str, Any] = {"earlier_runs": len(self._imagers), "scans_without_earlier": alone}
        if "power" in match:
            before, left = match["power"].sum(axis=0)
            notes["earlier_suppression_db"] = round(float(10 * np.log10(before / left)), 1)
            notes["earlier_offset"] = round(float(np.median(match["offset"])), 3)
        return notes

    def sentences(self) -> list[str]:
        """Return how well the drives fit, and what of the run is judged without the earlier ones."""
        notes = self.notes()
        alone, scans = notes["scans_without_earlier"], len(self.setup.imager)
        if alone == scans:
            return [
                f"no scan lies within {self.settings.within:g} m of one of an earlier drive: nothing is "
                "subtracted; give runs of this road, whose poses are in the same lane frame"
            ]
        count = notes["earlier_runs"]
        drives = "an earlier drive" if count == 1 else f"{count} earlier drives"
        suppression, offset = notes["earlier_suppression_db"], 100 * notes["earlier_offset"]
        said = [
            f"what {drives} predict{'s' * (count == 1)} is subtracted, so what lay there then does "
            f"not stand out ({suppression:g} dB of the images, tracks moved by {offset:.0f} cm in the "
            "median)"
        ]
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
