"""The three prescreeners of flsar2004 over ranges and polarizations, and templates of mines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field

from flgpr.detect.scorers.checks import Checked
from flgpr.features import cut_regions, mean_template, template_features
from flgpr.screen import (
    ClusterThresholds,
    Ellipse,
    fit_ellipse,
    fuse_clusters,
    learn_thresholds,
    prescreen_clusters,
)
from flgpr.screen.clusters import Rule
from flgpr.screen.views import grid_of
from flgpr.stages import FeatureStage, Positive, ScreenStage, Setup, Table, TrainingView
from flgpr.stages.too_few import HALF
from flgpr.types import AnyArray, Arrays, Entries, FloatArray

_ELLIPSE = ("half_x", "half_y", "offset_x", "offset_y")
_THRESHOLDS = ("amplitude", "size", "std", "energy_ratio")


def subset(
    lanes: list[TrainingView], share: float, kinds: tuple[str, ...] = ()
) -> list[pd.DataFrame]:
    """Choose the mines that make templates and thresholds, evenly spread over the lanes.

    They are the same for every stage. Of the targets, sorted by position, every n-th is taken.

    Parameters
    ----------
    lanes : list of TrainingView
        The training lanes.
    share : float
        Share of the targets that is taken, but at least four targets. With at most half, no two
        neighbours are taken, as a detector learns from the others.
    kinds : tuple of str
        Kinds of targets to take; by default all, and all where none of these kinds was chosen.

    Returns
    -------
    list of DataFrame
        Of each lane the rows of its truth.
    """
    total = sum(len(lane.truth) for lane in lanes)
    wanted_count = max(round(share * total), min(4, total), 1)
    shortest_step = 1 if share > HALF else 2
    step = max(total // wanted_count, shortest_step)
    chosen = []
    targets_before = 0
    for lane in lanes:
        table = lane.truth.sort_values(["y", "x"], kind="stable")
        numbers = targets_before + np.arange(len(table))
        chosen.append(table[numbers % step == 0])
        targets_before += len(table)
    if not kinds:
        return chosen
    of_kinds = [targets[targets["kind"].isin(kinds)] for targets in chosen]
    return of_kinds if any(len(targets) for targets in of_kinds) else chosen


class TemplateSettings(Table):
    """Sizes of templates and regions, x and y in m."""

    region: tuple[Positive, Positive] = (1.36, 1.47)  #: in which a template is moved
    template: tuple[Positive, Positive] = (1.04, 0.80)
    share: Annotated[float, Field(gt=0, lt=1)] = 0.1  #: of the training mines that makes templates


class ClusterSettings(TemplateSettings):
    """Prescreeners; lengths in m."""

    radius: Positive = 0.2  #: the paper's 20 cm
    #: what the radius is (par. 15): that within which marked pixels form a cluster, or that of the
    #: least cluster that is large enough, of pixels within twice as much
    radius_is: Literal["forming", "size"] = "forming"
    pass_share: Annotated[float, Field(gt=0, le=1)] = 1.0  #: of the mines, by each prescreener
    reach: Positive = 0.5  #: how far a peak may lie from its mine
    kinds: tuple[str, ...] = ("metal",)  #: kinds of targets that are mines
    polarizations: tuple[str, ...] = ()  #: whose images count; by default all
    rule: Rule = "and-or"  #: in which images a region must be seen (par. 18 and 44)

    @property
    def forming(self) -> float:
        """Radius within which marked pixels form a cluster, m.

        About every pixel of a disc of the radius, twice as much holds all of the disc.
        """
        return self.radius if self.radius_is == "forming" else 2 * self.radius

    @property
    def least_size(self) -> float | None:
        """Least marked area of a cluster, m²; None where it is learnt."""
        return None if self.radius_is == "forming" else math.pi * self.radius**2


def templates_of(lanes: list[TrainingView], settings: TemplateSettings) -> AnyArray:
    """Return the mean signatures of the subset's mines (par. 19).

    Returns
    -------
    (polarization, range, y, x) ndarray
        Of unit energy.
    """
    chips = []
    for lane, mines in zip(lanes, subset(lanes, settings.share), strict=True):
        grid = grid_of(lane.view)
        chips.append(cut_regions(lane.view.values, grid, mines[["x", "y"]], settings.template))
    return mean_template(np.concatenate(chips))


def check_learnt_channels(learnt: AnyArray, view: xr.DataArray) -> None:
    """Refuse what was learnt of other images (polarization, range) than a run-view has."""
    if learnt.shape[:2] != view.shape[:2]:
        raise ValueError(
            f"model must have been trained on {view.shape[0]} polarizations of {view.shape[1]} "
            "ranges, as the "
            f"run-view has them, got {learnt.shape[0]} of {learnt.shape[1]}"
        )


class ClusterScreen(ScreenStage):
    """The prescreeners of Sec. 3.1: amplitude with clustering, deviation, energy in an ellipse."""

    learns = True
    not_live_because = "a region is looked at from all ranges before it is judged"
    looser: ClassVar[Mapping[str, Any]] = {"rule": "or", "pass_share": 1.0}
    Settings: ClassVar[type[Table]] = ClusterSettings

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far regions and what decides on them reach at most, m."""
        # An ellipse is no larger than a template, its rectangle twice as large, and it lies off by
        # less than a template.
        return 3 * max(*settings.region, *settings.template) + 10 * settings.radius

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Check that every image has an ellipse about the size of a template, and thresholds."""
        channels: tuple[int | None, ...] = (None, None)
        most = 2 * max(settings.template)
        for name in _ELLIPSE:
            values = learnt.array(name, channels)
            channels = values.shape
            least = 0.0 if name.startswith("half") else -most
            if values.size and not (least <= values.min() and values.max() <= most):
                raise ValueError(
                    f"array {name!r} must lie between {least:g} and {most:g} m, got "
                    f"{values.min():g} to "
                    f"{values.max():g}"
                )
        for name in _THRESHOLDS:
            learnt.array(name, channels, finite=False)

    def alarms(self, view: xr.DataArray) -> pd.DataFrame:
        """Return the regions that pass all prescreeners.

        Their magnitude is that of the peak over the amplitude threshold of its image.
        """
        check_learnt_channels(self.learnt["amplitude"], view)
        tables = {}
        thresholds = {}
        for channel, (ellipse, limits) in self.channels(view):
            key = str(channel["polarization"].item()), str(channel["subband"].item())
            tables[key] = prescreen_clusters(channel, limits, ellipse, self.settings.forming)
            thresholds[key] = limits.amplitude
        regions = fuse_clusters(tables, 2 * self.settings.radius, self.settings.rule, thresholds)
        return regions.rename(columns={"strength": "magnitude"})[["x", "y", "magnitude", "images"]]

    def channels(
        self, view: xr.DataArray
    ) -> list[tuple[xr.DataArray, tuple[Ellipse, ClusterThresholds]]]:
        """Return the images of a run-view that count, with their ellipses and thresholds.

        Parameters
        ----------
        view : (polarization, subband, y, x) DataArray
            Run-view.

        Returns
        -------
        list of tuple
            Image (y, x), and its ellipse with its thresholds.
        """
        labels = view["polarization"].values
        polarizations = self.settings.polarizations or tuple(labels)
        channels = []
        for p, r in np.ndindex(view.sizes["polarization"], view.sizes["subband"]):
            if labels[p] in polarizations:
                channels.append((view.isel(polarization=p, subband=r), self._limits(p, r)))
        return channels

    def _limits(self, p: int, r: int) -> tuple[Ellipse, ClusterThresholds]:
        """Return the ellipse and the thresholds of an image by polarization and range."""
        ellipse = Ellipse(*(float(self.learnt[name][p, r]) for name in _ELLIPSE))
        return ellipse, ClusterThresholds(*(float(self.learnt[name][p, r]) for name in _THRESHOLDS))

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, Entries]:
        """Set ellipse and thresholds of every channel by the subset's mines."""
        templates = templates_of(examples, settings)
        mines = subset(examples, settings.share, settings.kinds)
        learnt = {name: np.zeros(templates.shape[:2]) for name in (*_ELLIPSE, *_THRESHOLDS)}
        first = grid_of(examples[0].view)
        for p, r in np.ndindex(*templates.shape[:2]):
            ellipse = fit_ellipse(templates[p, r], (first.dx, first.dy))
            views = []
            for lane, of_lane in zip(examples, mines, strict=True):
                views.append((lane.view[p, r], of_lane[["x", "y"]].to_numpy()))
            limits = learn_thresholds(
                views,
                ellipse,
                settings.forming,
                settings.reach,
                settings.pass_share,
                settings.least_size,
            )
            for name in _ELLIPSE:
                learnt[name][p, r] = getattr(ellipse, name)
            for name in _THRESHOLDS:
                learnt[name][p, r] = getattr(limits, name)
        return learnt, {"mines_for_thresholds": sum(len(of_lane) for of_lane in mines)}

    @classmethod
    def targets_used_for_training(
        cls, settings: Any, examples: list[TrainingView]
    ) -> list[pd.DataFrame]:
        """Return the subset's mines."""
        return subset(examples, settings.share)


class TemplateFeatures(FeatureStage):
    """The largest correlation with the template of every polarization and range (par. 22)."""

    learns = True
    not_live_because = ClusterScreen.not_live_because
    Settings: ClassVar[type[Table]] = TemplateSettings

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:
        """Check that every image has a template of the size that the recipe asks for."""
        width_m, length_m = settings.template
        width = 2 * (round(width_m / setup.view.dx) // 2) + 1
        length = 2 * (round(length_m / setup.view.dy) // 2) + 1
        shape = (None, None, length, width)
        learnt.array("templates", shape, np.float64, np.float32, np.complex128, np.complex64)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return the correlations, named T_POLARIZATION_RANGE."""
        regions = cut_regions(view.values, grid_of(view), points, self.settings.region)
        check_learnt_channels(self.learnt["templates"], view)
        values = np.zeros((0, regions.shape[1] * regions.shape[2]))
        if len(points):
            values = template_features(regions, self.learnt["templates"])
        names = []
        for polarization in view["polarization"].values:
            for band in view["subband"].values:
                names.append(f"T_{polarization}_{band}".replace(" ", ""))
        return dict(zip(names, values.T, strict=True))

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, Entries]:
        """Average the subset's signatures."""
        templates = templates_of(examples, settings)
        count = sum(map(len, subset(examples, settings.share)))
        return {"templates": templates}, {"mines_for_templates": count}

    @classmethod
    def targets_used_for_training(
        cls, settings: Any, examples: list[TrainingView]
    ) -> list[pd.DataFrame]:
        """Return the subset's mines."""
        return subset(examples, settings.share)
