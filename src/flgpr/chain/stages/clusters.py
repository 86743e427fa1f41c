"""flsar2004's three prescreeners over ranges and polarizations, and correlation with templates of mines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from flgpr.chain.engine import Arrays
from flgpr.chain.stages import (
    FeatureStage,
    FloatArray,
    Positive,
    ScreenStage,
    Setup,
    Table,
    TrainingView,
)
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

_ELLIPSE = ("half_x", "half_y", "offset_x", "offset_y")
_THRESHOLDS = ("amplitude", "size", "std", "energy_ratio")


def subset(
    lanes: list[TrainingView], share: float, kinds: tuple[str, ...] = ()
) -> list[pd.DataFrame]:
    """Choose the mines that make templates and thresholds: the same ones for every stage, evenly spread over the lanes.

    Of the targets, sorted by place, every so-manieth is taken, at least four in all. With a
    ``share`` of at most half, no two neighbours are taken, as a detector learns from the others. Of
    ``kinds`` only where given, as long as there are any.
    """
    total = sum(len(lane.truth) for lane in lanes)
    step = max(total // max(round(share * total), min(4, total), 1), 1 if share > 0.5 else 2)
    chosen = []
    begun = 0
    for lane in lanes:
        table = lane.truth.sort_values(["y", "x"], kind="stable")
        chosen.append(table[(begun + np.arange(len(table))) % step == 0])
        begun += len(table)
    wanted = [one[one["kind"].isin(kinds)] if kinds else one for one in chosen]
    return wanted if any(len(one) for one in wanted) else chosen


class TemplateSettings(Table):
    """Sizes of templates and regions, x and y in m, and the share of the training mines that makes templates."""

    region: tuple[Positive, Positive] = (1.36, 1.47)
    template: tuple[Positive, Positive] = (1.04, 0.80)
    share: Annotated[float, Field(gt=0, lt=1)] = 0.1


class ClusterSettings(TemplateSettings):
    """Radius of a cluster (m), share of mines that passes each prescreener, how far a peak may lie from its mine (m).

    ``rule`` says in which images a region must be seen (par. 18 and 44), ``polarizations`` in those
    of which it may be.
    """

    radius: Positive = 0.2
    pass_share: Annotated[float, Field(gt=0, le=1)] = 1.0
    reach: Positive = 0.5
    kinds: tuple[str, ...] = ("metal",)
    polarizations: tuple[str, ...] = ()
    rule: Rule = "and-or"


def templates_of(lanes: list[TrainingView], settings: TemplateSettings) -> NDArray[Any]:
    """Mean signatures (polarization, range, y, x) of unit energy of the subset's mines (par. 19)."""
    chips = [
        cut_regions(lane.view.values, grid_of(lane.view), mines[["x", "y"]], settings.template)
        for lane, mines in zip(lanes, subset(lanes, settings.share), strict=True)
    ]
    return mean_template(np.concatenate(chips))


def check_channels(learnt: NDArray[Any], view: xr.DataArray) -> None:
    """Refuse what was learnt of other images (polarization, range) than a run-view has."""
    if learnt.shape[:2] != view.shape[:2]:
        raise ValueError(
            f"model must have been trained on {view.shape[0]} polarizations of {view.shape[1]} "
            "ranges, as the "
            f"run-view has them, got {learnt.shape[0]} of {learnt.shape[1]}"
        )


class ClusterScreen(ScreenStage):
    """Amplitude with clustering, standard deviation and energy in an ellipse, one after the other (Sec. 3.1)."""

    learns = True
    not_live_because = "a region is looked at from all ranges before it is judged"
    looser: ClassVar[Mapping[str, Any]] = {"rule": "or", "pass_share": 1.0}
    Settings: ClassVar[type[Table]] = ClusterSettings

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far regions and what decides on them reach, at most.

        An ellipse is no larger than a template, its rectangle twice as large, and it lies off by
        less than a template.
        """
        return 3 * max(*settings.region, *settings.template) + 10 * settings.radius

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Take an ellipse about the size of a template, and thresholds, for every image."""
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
        """Regions that pass; their magnitude is the peak over the amplitude threshold of its image."""
        check_channels(self.learnt["amplitude"], view)
        tables = {}
        levels = {}
        for channel, (ellipse, limits) in self.channels(view):
            key = str(channel["polarization"].item()), str(channel["subband"].item())
            tables[key] = prescreen_clusters(channel, limits, ellipse, self.settings.radius)
            levels[key] = limits.amplitude
        regions = fuse_clusters(tables, 2 * self.settings.radius, self.settings.rule, levels)
        return regions.rename(columns={"strength": "magnitude"})[["x", "y", "magnitude", "images"]]

    def channels(
        self, view: xr.DataArray
    ) -> list[tuple[xr.DataArray, tuple[Ellipse, ClusterThresholds]]]:
        """Return every image (y, x) of the polarizations that are asked for, with its ellipse and thresholds."""
        wanted = self.settings.polarizations or tuple(view["polarization"].values)
        return [
            (view.isel(polarization=p, subband=r), self._limits(p, r))
            for p, r in np.ndindex(view.sizes["polarization"], view.sizes["subband"])
            if view["polarization"].values[p] in wanted
        ]

    def _limits(self, p: int, r: int) -> tuple[Ellipse, ClusterThresholds]:
        ellipse = Ellipse(*(float(self.learnt[name][p, r]) for name in _ELLIPSE))
        return ellipse, ClusterThresholds(*(float(self.learnt[name][p, r]) for name in _THRESHOLDS))

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, dict[str, Any]]:
        """Set ellipse and thresholds of every channel by the subset's mines."""
        templates = templates_of(examples, settings)
        mines = subset(examples, settings.share, settings.kinds)
        learnt = {name: np.zeros(templates.shape[:2]) for name in (*_ELLIPSE, *_THRESHOLDS)}
        first = grid_of(examples[0].view)
        for p, r in np.ndindex(*templates.shape[:2]):
            ellipse = fit_ellipse(templates[p, r], (first.dx, first.dy))
            views = [
                (lane.view[p, r], some[["x", "y"]].to_numpy())
                for lane, some in zip(examples, mines, strict=True)
            ]
            limits = learn_thresholds(
                views, ellipse, settings.radius, settings.reach, settings.pass_share
            )
            for name in _ELLIPSE:
                learnt[name][p, r] = getattr(ellipse, name)
            for name in _THRESHOLDS:
                learnt[name][p, r] = getattr(limits, name)
        return learnt, {"mines_for_thresholds": sum(len(one) for one in mines)}

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
        """Take a template of the size that the recipe asks for, for every image."""
        width, length = (
            2 * (round(size / spacing) // 2) + 1
            for size, spacing in zip(settings.template, (setup.view.dx, setup.view.dy), strict=True)
        )
        shape = (None, None, length, width)
        learnt.array("templates", shape, np.float64, np.float32, np.complex128, np.complex64)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Correlations, named T_POLARIZATION_RANGE."""
        regions = cut_regions(view.values, grid_of(view), points, self.settings.region)
        check_channels(self.learnt["templates"], view)
        values = (
            template_features(regions, self.learnt["templates"])
            if len(points)
            else np.zeros((0, regions.shape[1] * regions.shape[2]))
        )
        names = [f"T_{p}_{s}" for p in view["polarization"].values for s in view["subband"].values]
        return dict(zip((name.replace(" ", "") for name in names), values.T, strict=True))

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, dict[str, Any]]:
        """Average the subset's signatures."""
        templates = templates_of(examples, settings)
        return {"templates": templates}, {
            "mines_for_templates": sum(map(len, subset(examples, settings.share)))
        }

    @classmethod
    def targets_used_for_training(
        cls, settings: Any, examples: list[TrainingView]
    ) -> list[pd.DataFrame]:
        """Return the subset's mines."""
        return subset(examples, settings.share)
