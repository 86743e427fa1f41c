"""Suppression of what lies under masks, with calibrated thresholds (Fuse et al. 2018)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from flgpr.clutter import (
    ROADSIDE,
    Amplitude,
    FrameStack,
    Intersection,
    Iterated,
    ThresholdCalibration,
    Thresholds,
    averaged,
    averaged_frames,
    equal_cost,
    fallen_back,
    iterate_frames,
    iterate_suppression,
    mixed_mask,
    roadside_level,
    subregions,
    subtract_standing,
    suppress_by_model,
)
from flgpr.detect.scorers.checks import Checked
from flgpr.engine import BLOCK, Accumulator, PlannedPass, append_accumulator, block_name, blocks_of
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.model import (
    Grid,
    check_shared_poses,
    complete_scans,
    ground_points,
    lane_to_scan,
    scan_to_lane,
)
from flgpr.model.bounds import Spacing
from flgpr.model.run import polarizations_of
from flgpr.stages import ClutterStage, Positive, Table, scan_bytes
from flgpr.stages.standing import StandingSettings, standing_pass
from flgpr.stages.too_few import Change, Tally, TooFewExamplesError
from flgpr.types import Arrays, BoolArray, ComplexArray, Entries, Float32Array, FloatArray, IntArray

OperatorOn = Callable[[FloatArray], ImagingOperator]
"""Returns the imaging operator of a scan on points."""
BLOCKS = "masks"
"""Name of the pass that keeps the cleaned data of blocks."""
_COARSE = 1e-2  # tolerance of the second band's images, of which only the magnitude counts


class MaskSettings(Table):
    """Masks and suppression; lengths in m.

    ``method`` is one of

    - "iteration-per-frame": suppress "using the same mask in each frame" (Fuse et al. 2018,
      Sec. 2.3),
    - "iteration": the same of one reflectivity that all frames of the sum share,
    - "least-squares": fit that reflectivity by least squares,
    - "least-squares-spared": fit the road between the roadsides, too, and subtract only what lies
      under the mask: mines near it lose less.
    """

    edges: tuple[float, ...] = (5.0, 7.5, 10.0, 12.5, 15.0)  #: of the sub-regions in range
    frames: Annotated[int, Field(ge=1, le=1000)] = 5  #: scans that are summed, the latest the last
    #: pixels of the masks; by default those of ``[image]``
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    spacing: Spacing | None = None
    roadside: tuple[float, float] = ROADSIDE  #: distances from the middle that it lies between
    halo: Positive = 0.5  #: radius about a calibration target that its response lies in
    response_db: Positive = 6.0  #: range of levels below the peak that a response consists of, dB
    intersect: Intersection = "pixel"
    #: source of the extended mask's threshold: the calibration lanes, or the roadside of the frame
    #: under test (Fuse et al. 2018, Sec. 2.4)
    low_threshold: Literal["calibration", "frame"] = "calibration"
    method: Literal["iteration", "iteration-per-frame", "least-squares", "least-squares-spared"] = (
        "iteration"
    )
    #: response that B of Eq. 7 is made of, see :func:`flgpr.clutter.iterate_suppression`
    amplitude: Amplitude = "region"
    fall_back: bool = True  #: whether the best iteration replaces an average that is worse
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 7
    combination: Annotated[int, Field(ge=0, le=6)] = 6  #: of iterations, in Table II
    #: name of the run of a second band (``flgpr detect RUN --with NAME=OTHER``)
    second: str | None = None

    @model_validator(mode="after")
    def _consistent(self) -> MaskSettings:
        """Refuse entries that contradict one another."""
        subregions(np.zeros(0), self.edges)
        if self.combination >= self.iterations:
            raise ValueError(
                f"combination {self.combination} needs {self.combination + 1} iterations, got "
                f"{self.iterations}"
            )
        if not 0 <= self.roadside[0] < self.roadside[1]:
            raise ValueError(f"roadside must rise from 0 or more, got {self.roadside}")
        return self


@dataclass(frozen=True)
class Aperture:
    """Consecutive scans that are summed coherently, on pixels ahead of the latest."""

    data: ComplexArray  #: (scan, polarization, pair, frequency) received field
    operators: Sequence[OperatorOn]  #: per scan, makes its operator on points of the latest's frame
    vv: ComplexArray  #: (y, x) coherent sum over the scans (Fuse et al. 2018, Eq. 4)
    vh: ComplexArray  #: (y, x) the same of the cross-polarized channel
    #: (y, x) second band: the mean magnitude over the scans, as its wavelength is too short for the
    #: poses
    second: Float32Array | None

    def stack_on(self, points: FloatArray) -> FrameStack:
        """Return the operator of all scans on points of the latest scan's frame."""
        return FrameStack([make(points) for make in self.operators])


class MaskedSuppression(ClutterStage):
    """Forms mixed masks ahead of every scan and suppresses what lies under them.

    What is suppressed is taken out of the data of the scan's aperture.
    """

    learns = True
    not_live_because = "it keeps the cleaned data of blocks of scans"
    Settings: ClassVar[type[Table]] = MaskSettings

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        image = setup.imager.grid
        x = settings.x or (image.x_min, image.x[-1])
        y = settings.y or (image.y_min, image.y[-1])
        self.grid = Grid.spanning(x, y, settings.spacing or image.dy)
        self.points = self.grid.points()
        self.region = subregions(
            np.broadcast_to(self.grid.y[:, None], self.grid.shape), settings.edges
        )
        self.across = np.broadcast_to(self.grid.x, self.grid.shape)
        labels = polarizations_of(setup.run)
        cross = next((label for label in ("VH", "HV") if label in labels), None)
        if "VV" not in labels or cross is None:
            raise ValueError(f"masks need a run with VV and VH or HV, got {', '.join(labels)}")
        if setup.summed > settings.frames:
            raise ValueError(
                f"masks.frames must be at least image.frames, {setup.summed}, got {settings.frames}"
            )
        self._latest_block: tuple[int, Arrays] = (-1, {})
        self._vv = labels.index("VV")
        self._vh = labels.index(cross)
        self._second = None if settings.second is None else self._other(settings.second)
        if learnt is not None and ("second" in learnt) != (self._second is not None):
            word = "was trained with" if "second" in learnt else "was trained without"
            raise ValueError(
                f"model {word} a second band: give the runs as in training (`others`, "
                f"{settings.second or 'NAME'}=RUN)"
            )

    @classmethod
    def check_learnt(cls, settings: Any, setup: Any, learnt: Checked) -> None:  # noqa: ARG003
        """Check the thresholds of the sub-regions, and how many looks at targets they come from."""
        regions = len(settings.edges) - 1
        for name in ("vv", "vh", "low_vh"):
            learnt.array(name, (regions,), finite=False)
        learnt.array("looks", (regions,), np.int64)
        if learnt.has("second"):
            learnt.array("second", (regions,), finite=False)

    def _other(self, name: str) -> ScanImager | None:
        """Return the imager of the second band; None where its run was not given."""
        run = self.setup.others.get(name)
        if run is None:
            return None
        check_shared_poses({"run": self.setup.run, name: run})
        if "VV" not in run["polarization"].values:
            raise ValueError(f"run {name} must have the polarization VV")
        good = complete_scans(run)[self.setup.imager.scans]
        if not good.all():
            raise ValueError(
                f"run {name} must be complete where the other is, got {int((~good).sum())} scans "
                "with missing sweeps"
            )
        tones = run["frequency"].values
        band = (float(tones[0]), float(tones[-1]))
        vv = run.sel(polarization=["VV"])
        return ScanImager(vv, self.grid, {"whole": band}, tolerance=_COARSE)

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:
        """Estimate the bytes of a block's cleaned data, and of the images of one aperture."""
        data = scan_bytes(sizes)
        return settings.frames * (2 * BLOCK * data + 100.0 * image.nx * image.ny + 20 * data)

    def aperture(self, index: int) -> Aperture:
        """Image the aperture that ends with the scan at an index (Fuse et al. 2018, Eq. 4)."""
        first = max(index - self.settings.frames + 1, 0)
        scans = [int(scan) for scan in self.setup.imager.scans[first : index + 1]]
        data = self.before(index, len(scans))
        operators = [self._operator_of(scan, index) for scan in scans]
        images = []
        for operator_on, signal in zip(operators, data[:, [self._vv, self._vh]], strict=True):
            images.append(operator_on(self.points).adjoint(signal)[:, 0])
        vv, vh = np.stack(images).sum(axis=0)
        second = None if self._second is None else self._second_band(self._second, scans, index)
        return Aperture(data, operators, vv, vh, second)

    def _second_band(self, imager: ScanImager, scans: Sequence[int], index: int) -> Float32Array:
        """Return the mean magnitude (y, x) of the second band over the scans of an aperture."""
        ground = scan_to_lane(self.points, self.setup.pose(index))
        field = self.setup.results[f"{BLOCKS}.second"]["field"]
        magnitudes = []
        for scan in scans:
            points = lane_to_scan(ground, self.setup.run["pose"].values[scan])
            signal = subtract_standing(imager.signal(scan), field)
            magnitudes.append(np.abs(imager.operator_on(scan, points).adjoint(signal)[0, 0]))
        return np.asarray(np.mean(magnitudes, axis=0), dtype=np.float32)

    def _operator_of(self, scan: int, index: int) -> OperatorOn:
        """Return what makes a scan's operator on points of the frame of the scan at an index."""
        latest = self.setup.pose(index)
        pose = self.setup.run["pose"].values[scan]

        def operator_on(points: FloatArray) -> ImagingOperator:
            """Return the scan's operator on points of the latest scan's frame."""
            in_lane = scan_to_lane(points, latest)
            return self.setup.imager.operator_on(scan, lane_to_scan(in_lane, pose))

        return operator_on

    def passes(self) -> list[PlannedPass]:
        """Return the passes of the second band's standing field and of the suppression itself.

        The latter exists once the stage has learnt. Its states are kept block by block.
        """
        passes = []
        if self._second is not None:
            imager = self._second
            scans = self.setup.imager.scans

            def read_second(index: int) -> ComplexArray:
                return imager.signal(int(scans[index]))

            most = StandingSettings().most
            passes.append(standing_pass(f"{BLOCKS}.second", len(imager), most, read_second))
        if self.learnt:
            passes.append(
                PlannedPass(
                    BLOCKS,
                    "suppression under masks",
                    self._suppression,
                    all_scans=True,
                    keep_blocks=True,
                )
            )
        return passes

    def _suppression(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what gathers the cleaned data of apertures."""
        count = self.setup.summed  # of an aperture's scans images are made of the last ones alone
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            cleaned, has_fallen_back = self._suppressed(self.aperture(index))
            data = np.zeros((count, *cleaned.shape[1:]), np.complex64)
            data[-min(len(cleaned), count) :] = cleaned[-count:]
            pieces.append(
                {
                    "data": data[None],
                    "index": np.array([index]),
                    "fallen": np.array([has_fallen_back]),
                }
            )

        return append_accumulator(pieces, add)

    def _suppressed(self, aperture: Aperture) -> tuple[ComplexArray, bool]:
        """Return an aperture's cleaned data, and whether the iteration fell back."""
        mask = self.mask(aperture)
        settings = self.settings
        if settings.method.startswith("least-squares"):
            return self.least_squares(aperture, mask), False
        courses = self.courses(aperture, mask)
        has_fallen_back = False
        if settings.fall_back:
            has_fallen_back = any(
                fallen_back(iterated, settings.combination) for iterated in courses
            )
        return self.averaged(courses), has_fallen_back

    def courses(self, aperture: Aperture, mask: BoolArray) -> list[Iterated]:
        """Iterate the suppression of what lies under a mask (Fuse et al. 2018, Eq. 5 to 8).

        Parameters
        ----------
        aperture : Aperture
            The aperture; of its data only the polarizations that are imaged are cleaned.
        mask : (y, x) ndarray of bool
            The mask.

        Returns
        -------
        list of Iterated
            One for every scan with the method "iteration-per-frame", otherwise one for all of them.
        """
        b = aperture.data[:, self.setup.imaged]
        settings = self.settings
        model = (self.points, mask, self.region, settings.iterations, settings.amplitude)
        if settings.method == "iteration-per-frame":
            return iterate_frames(b, aperture.operators, *model)
        return [iterate_suppression(b, aperture.stack_on, *model)]

    def averaged(self, courses: Sequence[Iterated]) -> ComplexArray:
        """Average iterations as the settings say (Fuse et al. 2018, Table II).

        Returns
        -------
        (scan, polarization, pair, frequency) ndarray of complex
            The cleaned data.
        """
        settings = self.settings
        if settings.method == "iteration-per-frame":
            return averaged_frames(courses, settings.combination, settings.fall_back)
        return averaged(courses[0], settings.combination, settings.fall_back)

    def least_squares(self, aperture: Aperture, mask: BoolArray) -> ComplexArray:
        """Fit what lies under a mask by least squares and subtract it.

        The fit takes as long as the iterations of the other methods.
        """
        settings = self.settings
        b = aperture.data[:, self.setup.imaged]
        if not mask.any():
            return b
        count = equal_cost(settings.iterations, mask, self.region)
        fitted = mask
        if settings.method == "least-squares-spared":
            fitted = mask | (np.abs(self.across) < settings.roadside[0])
        operator = aperture.stack_on(self.points[fitted])
        return suppress_by_model(b, operator, count, spared=~mask[fitted]).data

    def notes(self) -> Entries:
        """Return in how many apertures the best iteration replaces the average, if in any."""
        count = 0
        for number in range(len(blocks_of(len(self.setup.imager)))):
            block = self.setup.results[block_name(BLOCKS, number)]
            count += int(block["fallen"].sum())
        return {"suppressions_fallen_back": count} if count else {}

    @property
    def limits(self) -> Thresholds:
        """Thresholds that were learnt."""
        thresholds = {}
        for name in self.learnt:
            if name != "looks":
                thresholds[name] = self.learnt[name]
        return Thresholds(**thresholds)

    def mask(self, aperture: Aperture) -> BoolArray:
        """Return the mixed mask (y, x) of an aperture (Fuse et al. 2018, Fig. 6)."""
        return mixed_mask(
            aperture.vv,
            aperture.vh,
            self.limits_for(aperture),
            self.region,
            self.across,
            aperture.second,
            self.settings.intersect,
            self.settings.roadside,
        )

    def limits_for(self, aperture: Aperture) -> Thresholds:
        """Return the thresholds for an aperture (Fuse et al. 2018, Sec. 2.4).

        They are those that were learnt, with that of the aperture's own roadside where the settings
        ask for it.
        """
        if self.settings.low_threshold == "calibration":
            return self.limits
        regions = len(self.settings.edges) - 1
        level = roadside_level(aperture.vh, self.region, self.is_roadside, regions)
        return replace(self.limits, low_vh=np.nan_to_num(level, nan=np.inf))

    @property
    def is_roadside(self) -> BoolArray:
        """Whether each pixel (y, x) belongs to the roadside."""
        inner, outer = self.settings.roadside
        off_middle = np.abs(self.across)
        return np.asarray((off_middle >= inner) & (off_middle <= outer))

    def data(self, index: int, count: int) -> ComplexArray:
        """Return the cleaned data of the last scans up to an index, which were cleaned together."""
        block = self._block(index)
        row = int(np.flatnonzero(block["index"] == index)[0])
        data = self.before(index, count).copy()
        data[:, self.setup.imaged] = block["data"][row][-len(data) :]
        return data

    def _block(self, index: int) -> Arrays:
        """Return the cleaned data of the block that holds an index."""
        blocks = blocks_of(len(self.setup.imager))
        number = next(number for number, block in enumerate(blocks) if index in block)
        # Scans are asked for one after the other, so that the latest block is nearly always it.
        if self._latest_block[0] != number:
            stored = self.setup.results[block_name(BLOCKS, number)]
            self._latest_block = (number, {name: stored[name] for name in ("index", "data")})
        return self._latest_block[1]

    def examples(self, truth: pd.DataFrame) -> Accumulator:
        """Return what gathers the responses of the targets and the level at the roadside."""
        learnt = self.calibration(self.settings)
        targets = ground_points(truth)

        def add(index: int) -> None:
            # A sum of fewer scans is weaker, and would lower the thresholds of all.
            if index + 1 >= min(self.settings.frames, len(self.setup.imager)):
                positions = lane_to_scan(targets, self.setup.pose(index))
                self.learn_from(self.aperture(index), positions, learnt)

        return Accumulator(add, lambda _: learnt.state(), learnt.merge, learnt.state)

    def learn_from(
        self, aperture: Aperture, targets: FloatArray, learnt: ThresholdCalibration
    ) -> None:
        """Add an aperture's responses to targets, and its roadside, to a calibration.

        Parameters
        ----------
        aperture : Aperture
            The aperture.
        targets : (target, 3) ndarray
            Their positions in the frame of its latest scan, m.
        learnt : ThresholdCalibration
            The calibration, changed in place.
        """
        halo = self.settings.halo
        x_min, x_max, y_min, y_max = self.grid.extent()
        inside_x = (targets[:, 0] >= x_min + halo) & (targets[:, 0] <= x_max - halo)
        inside_y = (targets[:, 1] >= y_min + halo) & (targets[:, 1] <= y_max - halo)
        halos = []
        for x, y, _ in targets[inside_x & inside_y]:
            halos.append(np.hypot(self.grid.x - x, self.grid.y[:, None] - y) <= halo)
        learnt.add(aperture.vv, aperture.vh, self.region, halos, self.is_roadside, aperture.second)

    @staticmethod
    def calibration(settings: Any) -> ThresholdCalibration:
        """Return an empty calibration of the sub-regions in range."""
        return ThresholdCalibration(len(settings.edges) - 1, settings.response_db)

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, Entries]:
        """Set the thresholds of all sub-regions (Fuse et al. 2018, Sec. 2.4).

        They are "as low as possible without compromising the target signal response".
        """
        learnt = cls.calibration(settings)
        for of_lane in examples:
            learnt.merge(of_lane)
        cls._check(settings, learnt.targets)
        try:
            limits = learnt.result()
        except ValueError:
            # All sub-regions have shown a target, so one of them has no roadside.
            inner, outer = settings.roadside
            nearer = Change("roadside", [inner / 2, outer], [inner, outer])
            raise TooFewExamplesError(
                "pixels beside the lane in every sub-region", changes=[nearer]
            ) from None
        arrays = {
            "vv": limits.vv,
            "vh": limits.vh,
            "low_vh": limits.low_vh,
            "looks": learnt.targets,
        }
        if limits.second is not None:
            arrays["second"] = limits.second
        return arrays, {"looks_at_targets": learnt.targets.tolist()}

    @classmethod
    def _check(cls, settings: Any, looks: IntArray) -> None:
        """Refuse sub-regions in range in which no look has shown a target."""
        if (looks > 0).all():
            return
        edges = list(settings.edges)
        counts = []
        for number, first, last in zip(looks, edges[:-1], edges[1:], strict=True):
            counts.append(
                Tally(int(number), f"looks at targets from {first:g} to {last:g} m ahead")
            )
        changes = []
        if looks.any():
            # A border goes if one of the two sub-regions that it separates has no look.
            merged = [edges[0]]
            for edge, before, beyond in zip(edges[1:-1], looks[:-1], looks[1:], strict=True):
                if before and beyond:
                    merged.append(edge)
            merged.append(edges[-1])
            changes = [Change("edges", merged, edges)]
        raise TooFewExamplesError(
            f"a look at a target in each of {len(looks)} sub-regions", counts, changes
        )
