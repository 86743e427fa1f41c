"""Suppression of what lies under masks, with calibrated thresholds (Fuse et al. 2018), as a stage of any chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, model_validator

from flgpr.chain.engine import (
    BLOCK,
    Accumulator,
    Arrays,
    PlannedPass,
    append_accumulator,
    block_name,
    blocks_of,
)
from flgpr.chain.stages import ClutterStage, ComplexArray, FloatArray, Positive, Table
from flgpr.chain.stages.standing import standing_pass
from flgpr.chain.too_few import Change, Tally, TooFewExamplesError
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

OperatorOn = Callable[[FloatArray], ImagingOperator]
BLOCKS = "masks"


class MaskSettings(Table):
    """Masks and suppression; lengths in m.

    The pixels of the masks are those of ``[image]`` unless ``x``, ``y`` and ``spacing`` say
    otherwise; ``edges`` are the borders of the sub-regions in range, ``frames`` the scans that are
    summed coherently, the latest the last. A calibration target's response is what lies ``halo``
    about it, within ``response_db`` of its peak. ``second`` names the run of a second band (``flgpr
    detect RUN --with NAME=OTHER``).

    ``low_threshold`` tells where the extended mask's threshold comes from: from the "calibration" lanes, or from the
    roadside of the "frame" under test (Fuse et al. 2018, Sec. 2.4). ``method`` "iteration-per-frame" suppresses "using
    the same mask in each frame" (Sec. 2.3); "iteration" reads it as one reflectivity that all frames of the sum share;
    "least-squares" fits that; "least-squares-spared" fits the road between the roadsides, too, and subtracts only what
    lies under the mask: mines near it lose less. ``amplitude`` tells which response B of Eq. 7 is made of, see
    :func:`flgpr.clutter.iterate_suppression`; with ``fall_back`` the best iteration stands in where the average of a
    course that diverged is worse.
    """

    edges: tuple[float, ...] = (5.0, 7.5, 10.0, 12.5, 15.0)
    frames: Annotated[int, Field(ge=1, le=1000)] = 5
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    spacing: Spacing | None = None
    roadside: tuple[float, float] = ROADSIDE
    halo: Positive = 0.5
    response_db: Positive = 6.0
    intersect: Intersection = "pixel"
    low_threshold: Literal["calibration", "frame"] = "calibration"
    method: Literal["iteration", "iteration-per-frame", "least-squares", "least-squares-spared"] = (
        "iteration"
    )
    amplitude: Amplitude = "region"
    fall_back: bool = True
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 7
    combination: Annotated[int, Field(ge=0, le=6)] = 6
    second: str | None = None

    @model_validator(mode="after")
    def _whole(self) -> MaskSettings:
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

    data: ComplexArray  #: (scan, polarization, pair, frequency): received field
    operators: Sequence[
        OperatorOn
    ]  #: per scan, the maker of its operator on points of the latest scan's frame
    looks: ComplexArray  #: (scan, y, x): VV image of every scan
    #: vv, vh: (y, x) coherent sums over the scans (Fuse et al. 2018, Eq. 4)
    vv: ComplexArray
    vh: ComplexArray
    #: (y, x) second band: the mean magnitude over the scans, as its wavelength is too short for the poses
    second: NDArray[np.float32] | None

    def stack_on(self, points: FloatArray) -> FrameStack:
        """Make the operator of all scans on points of the latest scan's frame."""
        return FrameStack([make(points) for make in self.operators])


class MaskedSuppression(ClutterStage):
    """Forms mixed masks ahead of every scan and suppresses what lies under them in the data of its aperture."""

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
        labels = [str(label) for label in setup.run["polarization"].values]
        cross = next((label for label in ("VH", "HV") if label in labels), None)
        if "VV" not in labels or cross is None:
            raise ValueError(f"masks need a run with VV and VH or HV, got {', '.join(labels)}")
        if setup.summed > settings.frames:
            raise ValueError(
                f"masks.frames must be at least image.frames, {setup.summed}, got {settings.frames}"
            )
        self._held: tuple[int, Arrays] = (-1, {})
        self._vv = labels.index("VV")
        self._vh = labels.index(cross)
        self._second = None if settings.second is None else self._other(settings.second)
        if learnt is not None and ("second" in learnt) != (self._second is not None):
            word = "was trained with" if "second" in learnt else "was trained without"
            raise ValueError(
                f"model {word} a second band: give the runs as in training (--with "
                f"{settings.second or 'NAME'}=RUN)"
            )

    @classmethod
    def check_learnt(cls, settings: Any, setup: Any, learnt: Checked) -> None:  # noqa: ARG003
        """Take a threshold for each sub-region, and how many looks at targets it comes from."""
        regions = len(settings.edges) - 1
        for name in ("vv", "vh", "low_vh"):
            learnt.array(name, (regions,), finite=False)
        learnt.array("looks", (regions,), np.int64)
        if learnt.has("second"):
            learnt.array("second", (regions,), finite=False)

    def _other(self, name: str) -> ScanImager | None:
        """Imager of the second band, where its run was given."""
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
        return ScanImager(
            run.sel(polarization=["VV"]), self.grid, {"whole": self._band(run)}, tolerance=1e-2
        )

    @staticmethod
    def _band(run: Any) -> tuple[float, float]:
        tones = run["frequency"].values
        return float(tones[0]), float(tones[-1])

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:
        """Take what is kept of a block's apertures, and the images and operators of one."""
        data = 8.0 * sizes["polarization"] * sizes["pair"] * sizes["frequency"]
        return settings.frames * (2 * BLOCK * data + 100.0 * image.nx * image.ny + 20 * data)

    def aperture(self, index: int) -> Aperture:
        """Image the aperture that ends with the scan at an index."""
        first = max(index - self.settings.frames + 1, 0)
        scans = [int(scan) for scan in self.setup.imager.scans[first : index + 1]]
        lane = scan_to_lane(self.points, self.setup.pose(index))
        data = self.before(index, len(scans))
        makes = [self._maker(scan, index) for scan in scans]
        seen = data[:, [self._vv, self._vh]]
        looks = np.stack(
            [make(self.points).adjoint(one)[:, 0] for make, one in zip(makes, seen, strict=True)]
        )
        vv, vh = looks.sum(axis=0)
        second = None
        if self._second is not None:
            field = self.setup.results[f"{BLOCKS}.second"]["field"]
            strengths = []
            for scan in scans:
                where = lane_to_scan(lane, self.setup.run["pose"].values[scan])
                signal = subtract_standing(self._second.signal(scan), field)
                strengths.append(
                    np.abs(self._second.operator_on(scan, where).adjoint(signal)[0, 0])
                )
            second = np.asarray(np.mean(strengths, axis=0), dtype=np.float32)
        return Aperture(data, makes, looks[:, 0], vv, vh, second)

    def _maker(self, scan: int, index: int) -> OperatorOn:
        latest = self.setup.pose(index)
        pose = self.setup.run["pose"].values[scan]
        return lambda points: self.setup.imager.operator_on(
            scan, lane_to_scan(scan_to_lane(points, latest), pose)
        )

    def passes(self) -> list[PlannedPass]:
        """Second band's standing field; then, once trained, the suppression itself, kept block by block."""
        passes = []
        if self._second is not None:
            imager = self._second
            scans = self.setup.imager.scans
            name = f"{BLOCKS}.second"
            passes.append(
                standing_pass(name, len(imager), 64, lambda index: imager.signal(int(scans[index])))
            )
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
        parts: list[Arrays] = []

        def add(index: int) -> None:
            cleaned, fallen = self._suppressed(self.aperture(index))
            kept = np.zeros((self._count, *cleaned.shape[1:]), np.complex64)
            kept[-min(len(cleaned), self._count) :] = cleaned[-self._count :]
            parts.append(
                {"data": kept[None], "index": np.array([index]), "fallen": np.array([fallen])}
            )

        return append_accumulator(parts, add)

    @property
    def _count(self) -> int:
        """How many of an aperture's scans the images are made of, and so kept."""
        return self.setup.summed

    def _suppressed(self, aperture: Aperture) -> tuple[ComplexArray, bool]:
        """Clean an aperture's data; tells, too, whether the best iteration had to stand in for the average."""
        mask = self.mask(aperture)
        settings = self.settings
        if settings.method.startswith("least-squares"):
            return self.least_squares(aperture, mask), False
        courses = self.courses(aperture, mask)
        fallen = settings.fall_back and any(
            fallen_back(course, settings.combination) for course in courses
        )
        return self.averaged(courses), fallen

    def courses(self, aperture: Aperture, mask: NDArray[np.bool_]) -> list[Iterated]:
        """Iterate the suppression of what lies under a mask (Fuse et al. 2018, Eq. 5-8), of what is imaged.

        There is a course for every scan with the method "iteration-per-frame", one for all of them
        otherwise.
        """
        b = aperture.data[:, self.setup.imaged]
        settings = self.settings
        rest = self.points, mask, self.region, settings.iterations, settings.amplitude
        if settings.method == "iteration-per-frame":
            return iterate_frames(b, aperture.operators, *rest)
        return [iterate_suppression(b, aperture.stack_on, *rest)]

    def averaged(self, courses: Sequence[Iterated]) -> ComplexArray:
        """Average courses as the settings say (Table II): cleaned data (scan, polarization, pair, frequency)."""
        settings = self.settings
        if settings.method == "iteration-per-frame":
            return averaged_frames(courses, settings.combination, settings.fall_back)
        return averaged(courses[0], settings.combination, settings.fall_back)

    def least_squares(self, aperture: Aperture, mask: NDArray[np.bool_]) -> ComplexArray:
        """Fit what lies under a mask by least squares, at the cost of the iterations, and subtract it."""
        settings = self.settings
        b = aperture.data[:, self.setup.imaged]
        if not mask.any():
            return b
        count = equal_cost(settings.iterations, mask, self.region)
        fitted = mask | (
            (np.abs(self.across) < settings.roadside[0])
            & (settings.method == "least-squares-spared")
        )
        return suppress_by_model(
            b, aperture.stack_on(self.points[fitted]), count, spared=~mask[fitted]
        ).data

    def notes(self) -> dict[str, Any]:
        """Return in how many apertures the best iteration stood in for the average; nothing if in none."""
        numbers = range(len(list(blocks_of(len(self.setup.imager)))))
        fallen = sum(
            int(self.setup.results[block_name(BLOCKS, number)]["fallen"].sum())
            for number in numbers
        )
        return {"suppressions_fallen_back": fallen} if fallen else {}

    @property
    def limits(self) -> Thresholds:
        """Thresholds that were learnt."""
        return Thresholds(**{name: self.learnt[name] for name in self.learnt if name != "looks"})

    def mask(self, aperture: Aperture) -> NDArray[np.bool_]:
        """Mixed mask of an aperture (Fuse et al. 2018, Fig. 6)."""
        limits = self.limits_for(aperture)
        settings = self.settings
        return mixed_mask(
            aperture.vv, aperture.vh, limits, self.region, self.across, aperture.second, settings.intersect,
            settings.roadside,
        )  # fmt: skip

    def limits_for(self, aperture: Aperture) -> Thresholds:
        """Thresholds for an aperture: those that were learnt, but for that of its own roadside where it is wanted."""
        if self.settings.low_threshold == "calibration":
            return self.limits
        level = roadside_level(aperture.vh, self.region, self.beside, len(self.settings.edges) - 1)
        return replace(self.limits, low_vh=np.nan_to_num(level, nan=np.inf))

    @property
    def beside(self) -> NDArray[np.bool_]:
        """Pixels of the roadside."""
        away = np.abs(self.across)
        return np.asarray((away >= self.settings.roadside[0]) & (away <= self.settings.roadside[1]))

    def data(self, index: int, count: int) -> ComplexArray:
        """Return the last scans' data up to an index, cleaned together, but not before the first aperture is whole."""
        kept = self._block(index)
        row = int(np.flatnonzero(kept["index"] == index)[0])
        full = self.before(index, count).copy()
        full[:, self.setup.imaged] = kept["data"][row][-len(full) :]
        return full

    def _block(self, index: int) -> Arrays:
        """Return what was kept of the block that holds an index; the one asked for last is held."""
        number = next(
            k for k, block in enumerate(blocks_of(len(self.setup.imager))) if index in block
        )
        if self._held[0] != number:
            kept = self.setup.results[block_name(BLOCKS, number)]
            self._held = number, {name: kept[name] for name in ("index", "data")}
        return self._held[1]

    def examples(self, truth: pd.DataFrame) -> Accumulator:
        """Follow the responses of the calibration targets, and the level at the roadside."""
        learnt = self.calibration(self.settings)
        targets = ground_points(truth)

        def add(index: int) -> None:
            if index + 1 >= min(self.settings.frames, len(self.setup.imager)):
                # a sum of fewer scans is weaker, and would lower the thresholds of all
                self.learn_from(
                    self.aperture(index), lane_to_scan(targets, self.setup.pose(index)), learnt
                )

        return Accumulator(add, lambda _: learnt.state(), learnt.merge, learnt.state)

    def learn_from(
        self, aperture: Aperture, targets: FloatArray, learnt: ThresholdCalibration
    ) -> None:
        """Add an aperture's responses to targets, at places (n, 3) of its latest scan's frame, and its roadside."""
        settings = self.settings
        x_min, x_max, y_min, y_max = self.grid.extent()
        inside = (targets[:, 0] >= x_min + settings.halo) & (targets[:, 0] <= x_max - settings.halo)
        inside &= (targets[:, 1] >= y_min + settings.halo) & (
            targets[:, 1] <= y_max - settings.halo
        )
        halos = [
            np.hypot(self.grid.x - x, self.grid.y[:, None] - y) <= settings.halo
            for x, y, _ in targets[inside]
        ]
        learnt.add(aperture.vv, aperture.vh, self.region, halos, self.beside, aperture.second)

    @staticmethod
    def calibration(settings: Any) -> ThresholdCalibration:
        """Begin a calibration of as many sub-regions."""
        return ThresholdCalibration(len(settings.edges) - 1, settings.response_db)

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Set the thresholds "as low as possible without compromising the target signal response" (Sec. 2.4)."""
        learnt = cls.calibration(settings)
        for one in examples:
            learnt.merge(one)
        cls._check(settings, learnt.targets)
        try:
            limits = learnt.result()
        except ValueError:  # a sub-region without roadside, as all have shown a target
            near, far = settings.roadside
            nearer = Change("roadside", [near / 2, far], [near, far])
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
    def _check(cls, settings: Any, looks: NDArray[np.int64]) -> None:
        """Refuse sub-regions in range that no look has shown a target in."""
        if (looks > 0).all():
            return
        edges = settings.edges
        counts = [
            Tally(int(number), f"looks at targets from {near:g} to {far:g} m ahead")
            for number, near, far in zip(looks, edges[:-1], edges[1:], strict=True)
        ]
        # A border goes if one of the two sub-regions that it parts has no look.
        between = [
            edge
            for edge, near, far in zip(edges[1:-1], looks[:-1], looks[1:], strict=True)
            if near and far
        ]
        merged = (
            [Change("edges", [edges[0], *between, edges[-1]], list(edges))] if looks.any() else []
        )
        raise TooFewExamplesError(
            f"a look at a target in each of {len(looks)} sub-regions", counts, merged
        )
