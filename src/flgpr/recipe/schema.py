"""Recipes: one TOML file per experiment, a table per stage, nothing unknown allowed."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError, model_validator

from flgpr.door import read_named
from flgpr.model import POLARIZATIONS, Grid, Lane, scan_to_lane
from flgpr.model.faults import describe_fault, listed_faults, no_preset, preset_names
from flgpr.model.motion import plausible_run
from flgpr.model.plausible import MotionLimits
from flgpr.model.vehicle import Vehicle
from flgpr.recipe.tables import (
    BackgroundTable,
    ContrastTable,
    DetectorTable,
    FeaturesTable,
    ImageTable,
    LaneTable,
    PrescreenTable,
    RunViewTable,
    ScoreTable,
)
from flgpr.stages import Table
from flgpr.stages.named import ClutterNamed, FeaturesNamed, MapNamed, Named, ScreenNamed
from flgpr.toml_text import parse_toml
from flgpr.types import FloatArray

if TYPE_CHECKING:
    import xarray as xr

_PACKAGED = resources.files("flgpr.recipe") / "packaged"
MOST_PIXELS = 50_000_000
"""Most pixels of an image."""
MOST_WINDOW = 1001
"""Most pixels across a window of the background."""
HALF_LANE = 1.5
"""Half width of the lane that a run has where none is given, m."""
LEAST_LOOKS = 2
"""Scans that must see ground that is searched without a lane: run-views compare two looks."""
RANKS = ("contrast", "magnitude")
"""Confidences that every recipe can rank alarms by."""


class Recipe(Table):
    """All that a detection run depends on beside its data.

    Where no detector was trained, ``confidence`` ranks the alarms: their local contrast, the
    magnitude, or a column of a features stage. ``motion`` are the limits of the vehicle, by which
    wrong poses are found; ``vehicle`` decides what its driver is told, and no result depends on it.
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
    vehicle: Vehicle = Vehicle()
    clutter: tuple[ClutterNamed, ...] = ()
    map: MapNamed | None = None
    screen: ScreenNamed | None = None
    features: FeaturesTable | None = None  #: the ten features of Wang et al. 2007
    columns: tuple[FeaturesNamed, ...] = ()  #: stages of the kind features, which make others
    detector: DetectorTable | None = None
    confidence: str = "contrast"

    def near_grid(self) -> Grid:
        """Return the pixels of the scan images as far ahead as counts, in the scan frame.

        They reach as far as the run-view takes looks and the patches around alarms there.
        """
        image = self.image.grid()
        half_patch = self.contrast.size * self.contrast.spacing / 2
        reach = self.run_view.y_max + half_patch + self.image.steps[1]
        rows = min(image.ny, math.ceil((reach - image.y_min) / image.dy) + 1)
        return Grid(image.x_min, image.y_min, image.nx, rows, image.dx, image.dy)

    def frame_area(self) -> Lane:
        """Return the detection area of a frame, in its scan frame.

        It is as wide as the run-view and reaches as far ahead as the run-view takes looks.
        """
        return Lane(*self.run_view.x, self.image.y[0], min(self.run_view.y_max, self.image.y[1]))

    @property
    def needs_looks(self) -> bool:
        """Whether its method is made of several looks at a place: a map, masks, or views."""
        views = self.run_view.look == "ranges"
        return self.map is not None or views or "clutter.masks" in self.named()

    @property
    def map_settings(self) -> Any:
        """Settings of its map; None without one."""
        return None if self.map is None else self.map.settings

    @property
    def view_channels(self) -> list[str]:
        """Names of the run-view's sub-bands or ranges.

        The view of a map has one channel, called "all" where there are several sub-bands.
        """
        subbands = list(self.image.subbands)
        if self.map is not None and len(subbands) > 1:
            subbands = ["all"]
        return self.run_view.channels(subbands)

    @property
    def smoothing(self) -> tuple[tuple[int, int], tuple[int, int], int]:
        """Windows (y, x) of the background's median and mean, and step of the median, in pixels."""
        median, mean = self.background.windows(*self.image.steps)
        return median, mean, self.background.median_step

    def named(self) -> dict[str, Named]:
        """Return all stages that the recipe names, by kind and name.

        They stand in the order in which they work and learn.
        """
        kinds: dict[str, tuple[Named | None, ...]] = {
            "clutter": self.clutter,
            "map": (self.map,),
            "screen": (self.screen,),
            "features": self.columns,
        }
        stages = {}
        for kind, entries in kinds.items():
            for entry in entries:
                if entry is not None:
                    stages[f"{kind}.{entry.stage}"] = entry
        return stages

    def learning(self) -> list[str]:
        """Return the names of the stages that must be trained before the recipe can be run."""
        return [name for name, entry in self.named().items() if entry.stage_class.learns]

    def not_live_because(self) -> list[str]:
        """Return why the recipe cannot run while scans come in, entry by entry; empty if it can."""
        reasons = {}
        for name, entry in self.named().items():
            reason = entry.stage_class.why_not_live(entry.settings)
            if reason:
                reasons[name] = reason
        for name, entry in self.named().items():
            kind = entry.stage_class.kind
            if kind not in ("features", "map") and name != "clutter.earlier":
                reasons.setdefault(
                    name, f"a stage of the kind {kind} is not run on scans as they come"
                )
        if self.image.frames != 1:
            reasons["image.frames"] = "several scans are summed"
        if self.run_view.look == "ranges":
            reasons["run_view.look"] = (
                f"the look {self.run_view.look!r} is complete only when a place is passed"
            )
        if self.background.self_signature != "mean":
            reasons["background.self_signature"] = (
                f'must be "mean", whose estimate grows, got "{self.background.self_signature}"'
            )
        if self.background.gain != "smooth":
            reasons["background.gain"] = f'must be "smooth", got "{self.background.gain}"'
        return [f"{name}: {reason}" for name, reason in reasons.items()]

    @model_validator(mode="before")
    @classmethod
    def _no_variants(cls, tables: Any) -> Any:
        """Refuse tables that recipes had in earlier versions, and say what replaces them."""
        former = [name for name in ("variants", "suppression") if name in dict(tables)]
        if former:
            raise ValueError(
                f"{former[0]} must be left out, got a table: what was a variant is a recipe of its "
                'own, and the roadside is subtracted by the clutter stage "roadside"'
            )
        return tables

    @model_validator(mode="after")
    def _consistent(self) -> Recipe:
        """Refuse tables that contradict one another."""
        self._check_channels()
        self._check_map_bands()
        self._check_stages()
        self._check_size()
        if self.run_view.y_max <= self.image.y[0]:
            raise ValueError(
                f"run_view.y_max must lie beyond where images begin, image.y = {self.image.y[0]:g} m, "
                f"got {self.run_view.y_max:g} m: no look would be taken"
            )
        if self.score.area == "frames":
            self._check_frames()
        self.contrast.patch()
        return self

    def _check_channels(self) -> None:
        """Refuse channels of the contrast and of the prescreener that images do not have."""
        if self.contrast.subband not in self.image.subbands:
            known = ", ".join(self.image.subbands)
            raise ValueError(
                f"contrast.subband must be one of image.subbands ({known}), "
                f"got {self.contrast.subband!r}"
            )
        views = self.view_channels
        if self.prescreen.subband not in views:
            table = "image.subbands"
            if self.run_view.look == "ranges":
                table = "the run-view's channels"
            raise ValueError(
                f"prescreen.subband must be one of {table} ({', '.join(views)}), "
                f"got {self.prescreen.subband!r}"
            )
        polarization = self.prescreen.polarization
        if self.map is not None and polarization != self.map.stage:
            raise ValueError(
                f"prescreen.polarization must be {self.map.stage!r}, the map, got {polarization!r}"
            )
        if self.map is None and polarization not in POLARIZATIONS:
            known = ", ".join(POLARIZATIONS)
            raise ValueError(f"prescreen.polarization must be one of {known}, got {polarization!r}")

    def _check_map_bands(self) -> None:
        """Refuse several sub-bands for a map that reads one."""
        if self.map is None or len(self.image.subbands) == 1:
            return
        if getattr(self.map.stage_class, "single", True):
            raise ValueError(
                f"image.subbands must be one band for the map {self.map.stage}, "
                f"got {len(self.image.subbands)}"
            )

    def _check_stages(self) -> None:
        """Refuse stages of one name, an unknown confidence, and clutter stages of an aperture."""
        names = [f"clutter {entry.stage}" for entry in self.clutter]
        names += [f"columns {entry.stage}" for entry in self.columns]
        if len(set(names)) != len(names):
            raise ValueError(f"stages of a kind must have different names, got {', '.join(names)}")
        if self.confidence not in RANKS and not self.columns:
            raise ValueError(
                f"confidence must be {' or '.join(RANKS)} without [[columns]], "
                f"got {self.confidence!r}"
            )
        cleans = bool(self.clutter) or self.background.self_signature != "none"
        if self.image.frames == "all" and cleans:
            raise ValueError(
                'image.frames = "all" makes one image, which does not tell what stands still: '
                'leave out [[clutter]], set background.self_signature = "none"; '
                "`flgpr prepare` takes out of a run what stands still"
            )

    def _check_size(self) -> None:
        """Refuse images and windows of more pixels than any image has."""
        image = self.image.grid()
        if image.nx * image.ny > MOST_PIXELS:
            raise ValueError(
                f"image.spacing must make at most {MOST_PIXELS:g} pixels of image.x and image.y, "
                f"got {image.nx} x {image.ny}"
            )
        median, mean, _ = self.smoothing
        for name, window in (("median", median), ("mean", mean)):
            if max(window) > MOST_WINDOW:
                length = getattr(self.background, name)
                raise ValueError(
                    f"background.{name} must be at most {MOST_WINDOW} pixels wide, "
                    f"got {length:g} m, {max(window)} pixels"
                )

    def _check_frames(self) -> None:
        """Refuse what cannot raise alarms frame by frame."""
        contradicting = []
        if self.run_view.look == "ranges":
            contradicting.append("run_view.look")
        if self.screen is not None:
            contradicting.append("screen")
        if self.image.frames == "all":
            contradicting.append('image.frames = "all"')
        if contradicting:
            raise ValueError(
                f'score.area must be "union" or "paper" with {" and ".join(contradicting)}, '
                'got "frames", for which the local maxima of every scan\'s image are alarms'
            )
        reach = self.image.x
        if not (reach[0] <= self.run_view.x[0] and self.run_view.x[1] <= reach[1]):
            raise ValueError(
                f"run_view.x must lie within image.x, {reach[0]:g} to {reach[1]:g} m, "
                f'with score.area = "frames", got {self.run_view.x[0]:g} to '
                f"{self.run_view.x[1]:g} m"
            )


def recipe_names() -> list[str]:
    """Return the names of the packaged recipes."""
    return preset_names(_PACKAGED)


def recipe_text(name: str | Path) -> str:
    """Return the TOML text of a recipe.

    Parameters
    ----------
    name : str or path
        Name of a packaged recipe, or a file.

    Raises
    ------
    ValueError
        If there is no such recipe, or the file is no text.
    """
    if str(name) in recipe_names():
        return (_PACKAGED / f"{name}.toml").read_text(encoding="utf-8")
    if Path(name).is_file():
        try:
            text = read_named(name).decode("utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"recipe {name}: not valid TOML: {error}") from None
        return text.replace("\r\n", "\n").replace("\r", "\n")
    raise ValueError(no_preset("recipe", name, recipe_names()))


def load_recipe(name: str | Path) -> Recipe:
    """Load and validate a recipe.

    Parameters
    ----------
    name : str or path
        Name of a packaged recipe, or a TOML file.

    Raises
    ------
    ValueError
        If it is not there or breaks a rule; it names every entry at fault.
    """
    return parse_recipe(recipe_text(name), str(name))


def as_imaged(run: xr.Dataset, recipe: Recipe) -> xr.Dataset:
    """Return a run as a recipe images it: without scans whose poses are not plausible.

    A recipe whose ``image.frames`` is "all" takes the whole run as one scan.
    """
    from flgpr.model import aperture_run  # with xarray, which a list of recipes can do without

    plausible = plausible_run(run, recipe.motion)
    return aperture_run(plausible) if recipe.image.frames == "all" else plausible


def lane_of(run: xr.Dataset, recipe: Recipe) -> Lane:
    """Return the recipe's lane or, where it has none, the ground that the run's scans see.

    That is 3 m wide about the vehicle's mean course or, with ``run_view.search`` "view", as wide as
    the run-view, from the image's nearest row at the first scan to the farthest ground that
    ``LEAST_LOOKS`` scans use. Of a run that is taken as one scan it is what the image covers up to
    ``run_view.y_max``.
    """
    if recipe.lane is not None:
        return recipe.lane.lane()
    return seen_lane(run, recipe, LEAST_LOOKS)


def seen_lane(run: xr.Dataset, recipe: Recipe, looks: int = 1) -> Lane:
    """Return the ground that ``looks`` scans see to its end, as wide as :func:`lane_of`'s."""
    if recipe.image.frames == "all":
        from flgpr.model import aperture_pose

        pose = aperture_pose(plausible_run(run, recipe.motion))
        corners = scan_to_lane(recipe.image.grid().corners(recipe.run_view.y_max), pose)
        x_min, y_min = corners[:, :2].min(axis=0)
        x_max, y_max = corners[:, :2].max(axis=0)
        return Lane(float(x_min), float(x_max), float(y_min), float(y_max))
    from flgpr.model import complete_scans  # loads xarray, which a list of recipes does not need

    # A scan with missing sweeps, or with a pose that no vehicle reaches, has no image.
    imaged = complete_scans(plausible_run(run, recipe.motion))
    if not imaged.any():
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {imaged.size}"
        )
    poses = run["pose"].values[imaged]
    return course_lane(recipe, poses, farthest_seen(recipe, poses, looks))


def farthest_seen(recipe: Recipe, poses: FloatArray, looks: int) -> float:
    """Return the farthest y that so many scans use, m; all of them where there are fewer.

    A scan uses ground up to the image's last row, and no farther ahead than ``run_view.y_max``.
    """
    farthest_row = min(recipe.image.y[1], recipe.run_view.y_max)
    from_far_to_near = np.sort(poses[:, 1])[::-1]
    last_look = min(looks, len(from_far_to_near)) - 1
    return float(from_far_to_near[last_look] + farthest_row)


def course_lane(recipe: Recipe, poses: FloatArray, end: float) -> Lane:
    """Return the lane about the course of a vehicle.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    poses : (scan, 6) ndarray
        Poses in the lane frame. The lane begins at the image's nearest row of the first.
    end : float
        Where it ends, m.
    """
    nearest_row = recipe.image.y[0]
    if recipe.run_view.search == "view":
        left, right = recipe.run_view.x
    else:
        middle = float(np.median(poses[:, 0]))
        left, right = middle - HALF_LANE, middle + HALF_LANE
    first = float(poses[:, 1].min() + nearest_row)
    return Lane(left, right, first, end)


def parse_recipe(text: str, source: str = "recipe") -> Recipe:
    """Validate the TOML text of a recipe.

    Parameters
    ----------
    text : str
        The text.
    source : str
        What errors call it.

    Raises
    ------
    ValueError
        If it breaks a rule; it names every entry at fault with its line.
    """
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"recipe {source}: not valid TOML: {error}") from None
    try:
        return Recipe.model_validate(tables)
    except ValidationError as error:
        faults = listed_faults(error, lambda fault: _fault(text, fault))
        raise ValueError(f"recipe {source}: " + "; ".join(faults)) from None


def _fault(text: str, fault: Any) -> str:
    """Return a fault that pydantic found, with its line in the text."""
    names = [name for name in fault["loc"] if isinstance(name, str)]
    line = line_of(text, names)
    prefix = f"line {line}: " if line else ""
    return prefix + describe_fault(fault, Recipe, "recipe")


def line_of(text: str, names: Sequence[str]) -> int | None:
    """Find the line of an entry of a TOML text.

    Parameters
    ----------
    text : str
        The text.
    names : sequence of str
        Names of the entry's tables, and its own.

    Returns
    -------
    int or None
        The line, counted from 1; that of the innermost of its tables if the entry is not there, and
        None if none of them is.
    """
    table: list[str] = []
    best_depth = 0
    best_line = None
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[\[?([^\]]+)\]", line)
        entry = re.match(r"\s*(\"[^\"]+\"|[\w-]+)\s*=", line)
        if header:
            table = _names(header.group(1))
            path = table
        elif entry:
            path = [*table, *_names(entry.group(1))]
        else:
            continue
        if list(names[: len(path)]) == path and len(path) > best_depth:
            best_depth = len(path)
            best_line = number
    return best_line


def _names(dotted: str) -> list[str]:
    """Return the names of a dotted key, without their quotes."""
    return [quoted or bare for quoted, bare in re.findall(r'"([^"]+)"|([\w-]+)', dotted)]
