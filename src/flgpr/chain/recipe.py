"""Recipes: one TOML file per experiment, a table per stage, nothing unknown allowed."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationError, model_validator

from flgpr.chain.estimator_classes import ALLOWED
from flgpr.chain.stages import (
    ClutterNamed,
    FeaturesNamed,
    MapNamed,
    Named,
    Positive,
    ScreenNamed,
    Table,
)
from flgpr.door import parse_toml, read_named
from flgpr.features import PatchShape
from flgpr.kernels.windows import WINDOWS, ramp
from flgpr.model import POLARIZATIONS, Grid, Lane, scan_to_lane
from flgpr.model.bounds import Largest, Spacing
from flgpr.model.faults import describe_fault, no_preset
from flgpr.model.motion import judge_run, plausible_run
from flgpr.model.plausible import MotionLimits

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]
# of an image, and across a window of the background
MOST_PIXELS = 50_000_000
MOST_WINDOW = 1001
HALF_LANE = 1.5  # half width of the lane that a run has where none is given, m


def _increasing(limits: tuple[float, float]) -> tuple[float, float]:
    if not limits[1] > limits[0]:
        raise ValueError(f"must increase, got {limits[0]:g}, {limits[1]:g}")
    return limits


def _known_window(name: str) -> str:
    if name not in (*WINDOWS, "ramp"):
        raise ValueError(f"must be one of {', '.join(WINDOWS)}, ramp, got {name!r}")
    return name


def _known_polarization(name: str) -> str:
    if name not in POLARIZATIONS:
        raise ValueError(f"must be one of {', '.join(POLARIZATIONS)}, got {name!r}")
    return name


Metre = Annotated[float, Field(ge=-100_000, le=100_000)]
Limits = Annotated[tuple[Metre, Metre], AfterValidator(_increasing)]
Band = Annotated[tuple[float, float], AfterValidator(_increasing)]
Window = Annotated[float, Field(ge=1e-3, le=100)]
Pixels = Annotated[int, Field(ge=1, le=1001)]
Polarization = Annotated[str, AfterValidator(_known_polarization)]


class ImageTable(Table):
    """Scan images: pixels in the scan frame (m), sub-bands (Hz), window, tolerance of the imaging operator.

    ``spacing`` (m) may be one length or two, cross-track and down-track. The window "ramp" is that
    of filtered backprojection. ``polarizations`` are those that are imaged, default all; an image
    is the coherent mean over the last ``frames`` scans, on the ground ahead of the latest (Fuse et
    al. 2018, Eq. 4). With "all" the whole run is one scan, see :func:`flgpr.model.aperture_run`:
    for a radar that moves past what it looks at. ``device`` is where the imaging operator computes.
    """

    x: Limits
    y: Limits
    spacing: Spacing | tuple[Spacing, Spacing]
    subbands: Annotated[dict[str, Band], Field(min_length=1), Largest(1e12)]
    window: Annotated[str, AfterValidator(_known_window)] = "boxcar"
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    polarizations: tuple[Polarization, ...] = ()
    frames: Annotated[int, Field(ge=1, le=1000)] | Literal["all"] = 1
    device: Literal["cpu", "cuda"] = "cpu"

    @property
    def summed(self) -> int:
        """How many scans an image sums, of the run as the recipe takes it."""
        return 1 if self.frames == "all" else self.frames

    @property
    def steps(self) -> tuple[float, float]:
        """Spacing cross-track and down-track, m."""
        return self.spacing if isinstance(self.spacing, tuple) else (self.spacing, self.spacing)

    def grid(self) -> Grid:
        """Grid of the scan images."""
        (dx, dy), x, y = self.steps, self.x, self.y
        if dx == dy:
            return Grid.spanning(x, y, dx)
        return Grid(
            x[0], y[0], round((x[1] - x[0]) / dx) + 1, round((y[1] - y[0]) / dy) + 1, dx, dy
        )

    def weights(self, frequency: FloatArray) -> str | FloatArray:
        """Window as the imaging operator takes it."""
        return ramp(frequency) if self.window == "ramp" else self.window


class BackgroundTable(Table):
    """Self-signature estimate and gain background.

    The gain background is "smooth", filtered by the windows ``median`` and ``mean`` (m; Wang et al.
    2007, Eq. 3 and 4), or one level for each of the "rows", the median within ``within`` metres of
    the middle (Fuse et al. 2018), or "none". ``median_step`` takes the median at every so many
    pixels, see :class:`flgpr.clutter.BackgroundEstimator`.
    """

    self_signature: Literal["none", "mean", "median"]
    gain: Literal["smooth", "rows", "none"] = "smooth"
    median: Window = 1.05
    mean: Window = 2.55
    median_step: Pixels = 1
    within: Positive | None = None

    def windows(
        self, dx: float, dy: float | None = None
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Windows (y, x) of the median and the mean in odd numbers of pixels of a spacing (m)."""
        steps = (dx if dy is None else dy, dx)
        median, mean = (
            tuple(max(2 * round((length / step - 1) / 2) + 1, 1) for step in steps)
            for length in (self.median, self.mean)
        )
        return (median[0], median[1]), (mean[0], mean[1])


class RunViewTable(Table):
    """Run-view: pixels in the lane frame (m) and the farthest distance ahead of the array (m).

    Without ``y`` it is as long as the lane. Where no lane is given, ``search`` tells what is
    searched: a "lane" 3 m wide about the vehicle's course, or all of the "view" across. ``look``
    tells what becomes of the scans that see a pixel: the "second-largest" magnitude stands (Wang et
    al. 2007), or the "mean", in which a look weighs as its distance to the power -``falloff``, or
    one view is made for each of the ``ranges`` ahead of the array (m), of the scan that sees the
    pixel nearest to it, at most ``within`` off (flsar2004).
    """

    x: Limits
    y: Limits | None = None
    spacing: Spacing
    y_max: Annotated[float, Field(gt=0, le=1000)]
    search: Literal["lane", "view"] = "lane"
    look: Literal["second-largest", "mean", "ranges"] = "second-largest"
    falloff: Annotated[float, Field(ge=0, le=10)] = 0.0
    ranges: tuple[Positive, ...] = ()
    within: Positive = 2.5

    @model_validator(mode="after")
    def _ranged(self) -> RunViewTable:
        if (self.look == "ranges") != bool(self.ranges):
            raise ValueError(
                f'ranges must be given with the look "ranges" and only then, got {self.ranges}'
            )
        if self.falloff and self.look != "mean":
            raise ValueError(
                f'falloff must be left out unless the look is "mean", got {self.falloff:g}'
            )
        return self

    def grid(self, lane: Lane) -> Grid:
        """Grid of the run-view of a lane."""
        return Grid.spanning(self.x, self.y or (lane.y_min, lane.y_max), self.spacing)

    def channels(self, subbands: Sequence[str]) -> list[str]:
        """Names of the run-view's channels beside the polarizations: sub-bands, or ranges of each."""
        if self.look != "ranges":
            return list(subbands)
        return [
            f"{band} {one:g} m" if len(subbands) > 1 else f"{one:g} m"
            for band in subbands
            for one in self.ranges
        ]


class PrescreenTable(Table):
    """Prescreener: channel, alarm radius (m), density, and where the density rule counts."""

    polarization: str
    subband: str
    radius: Window
    density: Annotated[float, Field(gt=0, le=10_000)]
    count: Literal["lane", "view"] = "lane"


class ContrastTable(Table):
    """Local contrast as confidence: channel and patch (pixels; spacing in m)."""

    polarization: Polarization
    subband: str
    size: Pixels = 25
    spacing: Spacing = 0.1
    inner: tuple[Pixels, Pixels] = (5, 3)
    guard: tuple[Pixels, Pixels] = (9, 7)

    def patch(self) -> PatchShape:
        """Patch of the contrast feature."""
        return PatchShape(self.size, self.spacing, self.inner, self.guard)


class FeaturesTable(Table):
    """The ten features of every sub-band, and the streaming chain that computes them; patches as for ``contrast``.

    ``inner`` is the part of the coherent patch that is averaged (pixels, cross-track x down-track),
    ``psi`` how angles are, and ``gain`` what the polarimetric features' images are divided by: one
    gain and background that the polarizations share, which keeps their ratios, or each
    polarization's own, as the paper has it. With ``variants`` they are computed twice more: with
    cross-track and down-track exchanged in all regions, and the polarimetric ones with the other
    ``gain`` and the mean of ψ that goes with it.
    """

    inner: tuple[Pixels, Pixels] = (5, 3)
    psi: Literal["circular", "linear"] = "circular"
    gain: Literal["shared", "own"] = "shared"
    variants: bool = False


class DetectorTable(Table):
    """What is trained on the features of alarms: an estimator, the features it reads, and how.

    ``estimator`` is "fisher" (Wang et al. 2007: histogram normaliser, duplication of hits, Fisher
    discriminant), or one that ``ALLOWED`` in ``chain/estimator_classes.py`` names, with its
    ``options``; ``scale`` "standard" brings every feature to zero mean and unit deviation before.
    With ``on`` "mines" it is shown the mines alone, with "clutter" all but these, and what is
    unlike that scores high. ``features`` are columns; names may end in ``*``.
    """

    estimator: str = "fisher"
    features: tuple[str, ...] = ()
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    scale: Literal["standard", "none"] = "standard"
    on: Literal["all", "mines", "clutter"] = "all"

    @model_validator(mode="after")
    def _known(self) -> DetectorTable:
        if self.estimator not in ("fisher", *ALLOWED):
            raise ValueError(
                f"estimator must be one of fisher, {', '.join(ALLOWED)}, got {self.estimator!r}"
            )
        return self


class LaneTable(Table):
    """The lane: borders in the lane frame (m)."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @model_validator(mode="after")
    def _not_empty(self) -> LaneTable:
        self.lane()
        return self

    def lane(self) -> Lane:
        """Make the lane."""
        return Lane(self.x_min, self.x_max, self.y_min, self.y_max)


class ScoreTable(Table):
    """Scoring: halo radius (m), and the area that false alarms are counted on.

    It is the lane's less the "union" of the halos, or as the "paper" of Wang et al. 2007 takes it;
    or that of all "frames", each of which counts its detection area and raises alarms of its own
    (Fuse et al. 2018, Sec. 4).
    """

    halo: Window
    area: Literal["union", "paper", "frames"] = "union"


RANKS = ("contrast", "magnitude")  # what every recipe can rank alarms by


class Recipe(Table):
    """All that a detection run depends on beside its data.

    Where nothing was trained on the alarms, ``confidence`` ranks them: their local contrast, the
    magnitude, or a column of a features stage. ``motion`` are the limits of the vehicle, which tell
    a pose that is wrong.
    """

    name: str
    description: str
    image: ImageTable
    background: BackgroundTable
    run_view: RunViewTable
    prescreen: PrescreenTable
    contrast: ContrastTable
    score: ScoreTable
    lane: LaneTable | None = None
    motion: MotionLimits = MotionLimits()
    clutter: tuple[ClutterNamed, ...] = ()
    map: MapNamed | None = None
    screen: ScreenNamed | None = None
    features: FeaturesTable | None = None
    columns: tuple[FeaturesNamed, ...] = ()
    detector: DetectorTable | None = None
    confidence: str = "contrast"

    def _check_size(self) -> None:
        """Refuse images and windows of more pixels than any image has."""
        image = self.image.grid()
        if image.nx * image.ny > MOST_PIXELS:
            got = f"{image.nx} x {image.ny}"
            raise ValueError(
                f"image.spacing must make at most {MOST_PIXELS:g} pixels of image.x and image.y, "
                f"got {got}"
            )
        for name, window in zip(("median", "mean"), self.smoothing[:2], strict=True):
            if max(window) > MOST_WINDOW:
                got = f"{getattr(self.background, name):g} m, {max(window)} pixels"
                raise ValueError(
                    f"background.{name} must be at most {MOST_WINDOW} pixels wide, got {got}"
                )

    def near_grid(self) -> Grid:
        """Pixels of the scan images as far ahead as counts: what the run-view takes and patches around alarms reach."""
        whole = self.image.grid()
        reach = (
            self.run_view.y_max
            + self.contrast.size * self.contrast.spacing / 2
            + self.image.steps[1]
        )
        rows = min(whole.ny, math.ceil((reach - whole.y_min) / whole.dy) + 1)
        return Grid(whole.x_min, whole.y_min, whole.nx, rows, whole.dx, whole.dy)

    def frame_area(self) -> Lane:
        """Return the detection area of a frame, in its scan frame: as wide and as far as the run-view."""
        return Lane(*self.run_view.x, self.image.y[0], min(self.run_view.y_max, self.image.y[1]))

    def _check_frames(self) -> None:
        """Refuse what cannot raise alarms frame by frame."""
        against = {
            "run_view.look": self.run_view.look == "ranges",
            "screen": self.screen is not None,
            'image.frames = "all"': self.image.frames == "all",
        }
        wrong = [name for name, is_there in against.items() if is_there]
        if wrong:
            raise ValueError(
                f'score.area must be "union" or "paper" with {" and ".join(wrong)}, got "frames", '
                "for which the local "
                "maxima of every scan's image are alarms"
            )
        reach = self.image.x
        if not (reach[0] <= self.run_view.x[0] and self.run_view.x[1] <= reach[1]):
            raise ValueError(
                f"run_view.x must lie within image.x, {reach[0]:g} to {reach[1]:g} m, with "
                'score.area = "frames", got '
                f"{self.run_view.x[0]:g} to {self.run_view.x[1]:g} m"
            )

    @property
    def view_channels(self) -> list[str]:
        """Names of the run-view's channels beside the polarizations; a map has one, "all" where sub-bands are many."""
        several = self.map is not None and len(self.image.subbands) > 1
        return self.run_view.channels(["all"] if several else list(self.image.subbands))

    @property
    def smoothing(self) -> tuple[tuple[int, int], tuple[int, int], int]:
        """Windows (y, x) of the gain background's median and mean, pixels, and the step of the median."""
        return *self.background.windows(*self.image.steps), self.background.median_step

    def named(self) -> dict[str, Named]:
        """All stages that the recipe names, by kind and name, in the order in which they work and learn."""
        kinds = {
            "clutter": self.clutter,
            "map": (self.map,),
            "screen": (self.screen,),
            "features": self.columns,
        }
        return {
            f"{kind}.{one.stage}": one
            for kind, some in kinds.items()
            for one in some
            if one is not None
        }

    def learning(self) -> list[str]:
        """Names of the stages that must be trained before the recipe can be run."""
        return [name for name, one in self.named().items() if one.stage_class.learns]

    def not_live_because(self) -> list[str]:
        """Return why it cannot run while scans come in, entry by entry; empty if it can."""
        why = {
            name: one.stage_class.not_live_because
            for name, one in self.named().items()
            if one.stage_class.not_live_because
        }
        for name, one in self.named().items():
            if one.stage_class.kind not in ("features", "map"):
                why.setdefault(
                    name,
                    f"a stage of the kind {one.stage_class.kind} is not run on scans as they come",
                )
        if self.image.frames != 1:
            why["image.frames"] = "several scans are summed"
        if self.run_view.look == "ranges":
            why["run_view.look"] = (
                f"the look {self.run_view.look!r} is complete only when a place is passed"
            )
        if self.background.self_signature != "mean":
            why["background.self_signature"] = (
                f'must be "mean", whose estimate grows, got "{self.background.self_signature}"'
            )
        if self.background.gain != "smooth":
            why["background.gain"] = f'must be "smooth", got "{self.background.gain}"'
        return [f"{name}: {reason}" for name, reason in why.items()]

    @model_validator(mode="before")
    @classmethod
    def _no_variants(cls, tables: Any) -> Any:
        """Say what became of tables that recipes had once."""
        former = [name for name in ("variants", "suppression") if name in dict(tables)]
        if former:
            raise ValueError(
                f"{former[0]} must be left out, got a table: what was a variant is a recipe of its "
                "own, "
                'and the roadside is subtracted by the clutter stage "roadside"'
            )
        return tables

    @model_validator(mode="after")
    def _consistent(self) -> Recipe:
        if self.contrast.subband not in self.image.subbands:
            known = ", ".join(self.image.subbands)
            raise ValueError(
                f"contrast.subband must be one of image.subbands ({known}), got "
                f"{self.contrast.subband!r}"
            )
        views = self.view_channels
        if self.prescreen.subband not in views:
            where = (
                "image.subbands" if self.run_view.look != "ranges" else "the run-view's channels"
            )
            raise ValueError(
                f"prescreen.subband must be one of {where} ({', '.join(views)}), got "
                f"{self.prescreen.subband!r}"
            )
        if self.map is not None and self.prescreen.polarization != self.map.stage:
            raise ValueError(
                f"prescreen.polarization must be {self.map.stage!r}, the map, got "
                f"{self.prescreen.polarization!r}"
            )
        if self.map is None and self.prescreen.polarization not in POLARIZATIONS:
            known = ", ".join(POLARIZATIONS)
            raise ValueError(
                f"prescreen.polarization must be one of {known}, got "
                f"{self.prescreen.polarization!r}"
            )
        if (
            self.map is not None
            and getattr(self.map.stage_class, "single", True)
            and len(self.image.subbands) > 1
        ):
            raise ValueError(
                f"image.subbands must be one band for the map {self.map.stage}, got "
                f"{len(self.image.subbands)}"
            )
        kinds = [f"clutter {one.stage}" for one in self.clutter] + [
            f"columns {one.stage}" for one in self.columns
        ]
        if len(set(kinds)) != len(kinds):
            raise ValueError(f"stages of a kind must have different names, got {', '.join(kinds)}")
        if self.confidence not in RANKS and not self.columns:
            raise ValueError(
                f"confidence must be {' or '.join(RANKS)} without [[columns]], got "
                f"{self.confidence!r}"
            )
        if self.image.frames == "all" and (
            self.clutter or self.background.self_signature != "none"
        ):
            raise ValueError(
                'image.frames = "all" makes one image, which does not tell what stands still: '
                "leave out [[clutter]], "
                'set background.self_signature = "none"; `flgpr prepare` takes out of a run what '
                "stands still"
            )
        self._check_size()
        if self.score.area == "frames":
            self._check_frames()
        self.contrast.patch()
        return self


def recipe_names() -> list[str]:
    """Names of the packaged recipes."""
    folder = resources.files("flgpr.chain") / "recipes"
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    )


def recipe_text(name: str | Path) -> str:
    """TOML text of a recipe: the name of a packaged one, or a file."""
    if str(name) in recipe_names():
        return (resources.files("flgpr.chain") / "recipes" / f"{name}.toml").read_text(
            encoding="utf-8"
        )
    if Path(name).is_file():
        try:
            return read_named(name).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
        except UnicodeDecodeError as error:
            raise ValueError(f"recipe {name}: not valid TOML: {error}") from None
    raise ValueError(no_preset("recipe", name, recipe_names()))


def load_recipe(name: str | Path) -> Recipe:
    """Load and validate a recipe: the name of a packaged one, or the path of a TOML file.

    The ValueError of one that is not there or breaks a rule names every entry at fault.
    """
    return parse_recipe(recipe_text(name), str(name))


def as_imaged(run: xr.Dataset, recipe: Recipe) -> xr.Dataset:
    """Take a run as a recipe does: without scans whose poses are not plausible, scan by scan, or all of it as one."""
    from flgpr.model import aperture_run  # with xarray, which a list of recipes can do without

    used = plausible_run(run, recipe.motion)
    return aperture_run(used) if recipe.image.frames == "all" else used


def lane_of(run: xr.Dataset, recipe: Recipe) -> Lane:
    """Take the recipe's lane or, where it has none, the ground that the run's scans cover.

    That is 3 m wide about the vehicle's mean course or, with ``run_view.search`` "view", as wide as
    the run-view, from the image's nearest row at the first scan to its nearest at the last, so that
    all of it was looked at from near. Of a run that is taken as one scan it is what the image
    covers up to ``run_view.y_max``.
    """
    if recipe.lane is not None:
        return recipe.lane.lane()
    if recipe.image.frames == "all":
        from flgpr.model import aperture_pose

        pose = aperture_pose(plausible_run(run, recipe.motion))
        covered = scan_to_lane(recipe.image.grid().corners(recipe.run_view.y_max), pose)
        (x_min, y_min), (x_max, y_max) = covered[:, :2].min(axis=0), covered[:, :2].max(axis=0)
        return Lane(float(x_min), float(x_max), float(y_min), float(y_max))
    return course_lane(recipe, run["pose"].values[judge_run(run, recipe.motion).plausible])


def course_lane(recipe: Recipe, poses: FloatArray, end: float | None = None) -> Lane:
    """Lane about the course of poses (scan, 6), from the image's nearest row at the first to that at the last.

    With ``end`` it ends there, m: a vehicle that drives on has no last pose yet.
    """
    middle = float(np.median(poses[:, 0]))
    near = recipe.image.y[0]
    last = float(poses[:, 1].max() + near) if end is None else end
    left, right = middle - HALF_LANE, middle + HALF_LANE
    if recipe.run_view.search == "view":
        left, right = recipe.run_view.x
    return Lane(left, right, float(poses[:, 1].min() + near), last)


def parse_recipe(text: str, source: str = "recipe") -> Recipe:
    """Validate the TOML text of a recipe; the ValueError names every entry at fault with its line."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"recipe {source}: not valid TOML: {error}") from None
    try:
        return Recipe.model_validate(tables)
    except ValidationError as error:
        faults = [_fault(text, fault) for fault in error.errors()]
        raise ValueError(f"recipe {source}: " + "; ".join(faults)) from None


def _fault(text: str, fault: Any) -> str:
    names = [part for part in fault["loc"] if isinstance(part, str)]
    line = line_of(text, names)
    return f"{f'line {line}: ' if line else ''}{describe_fault(fault, Recipe, 'recipe')}"


def line_of(text: str, names: Sequence[str]) -> int | None:
    """Find the line, counted from 1, of an entry of a TOML text, given the names of its tables and its own.

    Else that of the innermost table that is there; None if none of them is.
    """
    table: list[str] = []
    best: tuple[int, int | None] = (0, None)
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[\[?([^\]]+)\]", line)
        entry = re.match(r"\s*(\"[^\"]+\"|[\w-]+)\s*=", line)
        if header:
            table = _names(header.group(1))
            here = table
        elif entry:
            here = [*table, *_names(entry.group(1))]
        else:
            continue
        if list(names[: len(here)]) == here and len(here) > best[0]:
            best = len(here), number
    return best[1]


def _names(dotted: str) -> list[str]:
    return [quoted or bare for quoted, bare in re.findall(r'"([^"]+)"|([\w-]+)', dotted)]
