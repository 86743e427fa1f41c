"""Stages: what a recipe names, packaged or from another distribution, and what each kind must be able to do.

A stage is a class of one of four kinds. Its ``Settings`` are the entries of its table in a recipe.
A distribution offers stages by entry points of the group "flgpr.stages", whose names are those that
recipes use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, SerializeAsAny, ValidationError

from flgpr.detect.scorers.checks import Checked
from flgpr.model.bounds import Entries
from flgpr.model.bounds import Positive as Positive
from flgpr.model.faults import describe_fault

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from flgpr.chain.engine import Accumulator, Arrays, PlannedPass
    from flgpr.imaging import ScanImager
    from flgpr.model import Grid, Lane

GROUP = "flgpr.stages"
PACKAGED = {
    "clutter": {
        "standing": "standing:StandingField",
        "masks": "masks:MaskedSuppression",
        "low-rank": "low_rank:LowRank",
        "roadside": "roadside:RoadsideSuppression",
    },
    "map": {
        "deflection": "forms:DeflectionMap",
        "neyman-pearson": "forms:NeymanPearsonMap",
        "whitening": "forms:WhiteningMap",
        "magnitude": "forms:MagnitudeMap",
        "likelihood": "likelihood:LikelihoodMap",
    },
    "screen": {"clusters": "clusters:ClusterScreen"},
    "features": {
        "templates": "clusters:TemplateFeatures",
        "tracking": "tracking:Tracking",
        "cfar": "anomaly:Cfar",
        "rx": "anomaly:Rx",
        "matched": "anomaly:Matched",
        "network": "network:ChipNetwork",
        "roadside": "roadside:RoadsideShare",
    },
}
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex64]


class Table(Entries):
    """A table of a recipe: unknown entries are refused, values are not changed, numbers have bounds."""


@dataclass(frozen=True)
class Setup:
    """What a stage is told of the chain it belongs to."""

    run: (
        xr.Dataset
    )  #: the run; live, where none is stored, one scan without an echo at the lane's origin
    #: runs that were taken together with it, by the name that recipes give them, such as a second band
    others: Mapping[str, xr.Dataset]
    lane: Lane  #: the lane
    #: makes images and operators of the run; ``imager.scans`` are the numbers of its complete scans, in whose order
    #: indices count
    imager: ScanImager
    images: Grid  #: pixels of the scan images that count, in the scan frame
    view: Grid  #: pixels of the run-view, in the lane frame
    imaged: list[int]  #: numbers of the polarizations that are imaged
    summed: int  #: number of scans that an image is the coherent sum of
    results: Mapping[str, Any]  #: results of earlier passes, arrays by name

    def pose(self, index: int) -> FloatArray:
        """Pose (6,) of the scan at an index among the complete ones."""
        return np.asarray(self.run["pose"].values[self.imager.scans[index]], dtype=np.float64)


class Stage:
    """A step of a recipe: the entries of its table, the chain it belongs to, and what ``fit`` gave.

    Subclass one of the kinds below.
    """

    kind: ClassVar[str] = ""  #: "clutter", "map", "screen" or "features"
    learns: ClassVar[bool] = False  #: whether it must be trained: it then has ``fit``
    not_live_because: ClassVar[str] = ""  #: why it cannot work while scans come in; "" if it can
    Settings: ClassVar[type[Table]] = Table  #: the entries of its table in a recipe
    looser: ClassVar[
        Mapping[str, Any]
    ] = {}  #: entries, with values, that let more through: told who trains on few mines

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        self.settings = settings
        self.setup = setup
        self.learnt = learnt or {}

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Learn from the training lanes: arrays to work with later, and figures worth reporting.

        ``examples`` holds one thing per training lane: the result of ``examples`` for the kinds
        that look at scans, else a :class:`TrainingView`.
        """
        raise NotImplementedError(f"{cls.__name__} does not learn")

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Take the arrays that :meth:`fit` gave, by name, type and shape.

        A model may come from anybody. Whatever ``fit`` cannot have given for these settings is a
        ValueError, before anything is worked out with it. Whoever does not write this for a stage
        takes any arrays.
        """
        learnt.take_all()

    @classmethod
    def margin(cls, settings: Any) -> float:  # noqa: ARG003
        """Return how far along the lane from an alarm it depends on the run-view, m."""
        return 0.0

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Estimate the bytes that it takes for a run of these lengths of dimensions and scan images on this grid."""
        return 0.0

    def passes(self) -> list[PlannedPass]:
        """List the passes over the run that it needs before images are cleaned; their names begin with its own."""
        return []

    def notes(self) -> dict[str, Any]:
        """Return figures worth reporting of the whole run, once its passes are done."""
        return {}

    @classmethod
    def targets_used_for_training(cls, settings: Any, examples: list[Any]) -> list[Any]:  # noqa: ARG003
        """Return the rows of each training lane's truth that made it what it is.

        No detector is trained on them again.
        """
        return []


@dataclass(frozen=True)
class TrainingView:
    """Run-view (polarization, subband, y, x) of a training lane, its truth table, and its lane."""

    view: xr.DataArray
    truth: pd.DataFrame
    lane: Lane


class ClutterStage(Stage):
    """Takes clutter out of the received field: data in, data out."""

    kind = "clutter"
    before: Callable[[int, int], ComplexArray]
    """Data of the scans up to an index, as the stages before leave it: ``before(index, count)``."""

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:
        """Clean the data (polarization, pair, frequency) of the scan at an index among the complete ones."""
        raise NotImplementedError

    def data(self, index: int, count: int) -> ComplexArray:
        """Return cleaned data (scan, polarization, pair, frequency) of the last ``count`` scans up to an index."""
        first = max(index - count + 1, 0)
        return np.stack([self.clean(p, self.before(p, 1)[0]) for p in range(first, index + 1)])

    def examples(self, truth: pd.DataFrame) -> Accumulator:
        """Gather, scan by scan, what ``fit`` needs of a lane with this truth, for stages that learn."""
        raise NotImplementedError


class MapStage(Stage):
    """Turns every cleaned scan image into a map of how much each pixel is like a mine."""

    kind = "map"
    single: ClassVar[bool] = True  #: whether it reads images of one sub-band alone

    def map(self, image: xr.DataArray) -> NDArray[np.float32]:
        """Map (y, x) of a cleaned complex scan image (polarization, subband, y, x); NaN where it says nothing."""
        raise NotImplementedError

    def parts(
        self,
        image: xr.DataArray,  # noqa: ARG002
    ) -> tuple[Mapping[str, NDArray[Any]], Mapping[str, NDArray[Any]]]:
        """Return by name the maps (y, x) that add up to the map but for a constant, and others that explain it."""
        return {}, {}

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Gather what ``fit`` needs of a lane; ``image`` gives the cleaned image of the scan at an index."""
        raise NotImplementedError


class ScreenStage(Stage):
    """Raises alarms on the run-view, in place of its local maxima."""

    kind = "screen"

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far beyond a section's border alarms depend on the run-view, m."""
        raise NotImplementedError

    def alarms(self, view: xr.DataArray) -> pd.DataFrame:
        """Alarms on a run-view (polarization, subband, y, x): x, y (m, lane frame) and magnitude, strong to weak."""
        raise NotImplementedError


class FeatureStage(Stage):
    """Adds columns to the features of alarms: give one of the two methods, or both.

    Of what ``of_image`` gives, the mean over all scans that see an alarm is taken, live over those
    so far; the chain does the gathering. With ``of_view`` a stage waits for the whole run.
    """

    kind = "features"
    columns: tuple[str, ...] = ()
    """Columns of ``of_image``; "" for none."""
    alarm_columns: ClassVar[tuple[str, ...]] = ()
    """Columns that the alarm table shows, too."""

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if cls.of_view is not FeatureStage.of_view and not cls.not_live_because:
            cls.not_live_because = (
                "columns of the run-view are complete only when a place is passed"
            )

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Features of one scan: a column (alarm,) each; NaN where the scan does not see the alarm.

        The image is cleaned, complex (polarization, subband, y, x), in units of the background;
        ``points`` (alarm, 2) are x and y of the alarms in the scan frame, m.
        """
        raise NotImplementedError

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:  # noqa: ARG002
        """Features of the run-view (polarization, subband, y, x) at points (alarm, 2) in the lane frame, m.

        Asked without points, of a bit of a run-view that says nothing, it tells the names of its
        columns.
        """
        return {}


class Named(BaseModel):
    """A stage that a recipe names, with its entries."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)
    stage: str
    settings: SerializeAsAny[Table]
    stage_class: type[Stage] = Field(exclude=True)


def _named(kind: str) -> Callable[[Any], Any]:
    def read(table: Any) -> Any:
        if isinstance(table, Named):
            return table
        if not isinstance(table, dict) or not isinstance(table.get("stage"), str):
            raise ValueError(f'must be a table with the entry stage = "...", got {table!r}')
        stage_class = find_stage(kind, table["stage"])
        entries = {name: value for name, value in table.items() if name != "stage"}
        try:
            settings = stage_class.Settings.model_validate(entries)
        except ValidationError as error:
            raise ValueError(
                "; ".join(
                    describe_fault(one, stage_class.Settings, table["stage"])
                    for one in error.errors()
                )
            ) from None
        return Named(stage=table["stage"], settings=settings, stage_class=stage_class)

    return read


def make_stage(name: str, named: Named, setup: Setup, learnt: Arrays | None) -> Any:
    """Make a stage that a recipe names, with what a model holds for it.

    Arrays that its ``fit`` cannot have given are a ValueError that names the stage and the array.
    """
    if learnt is not None:
        checked = Checked({}, learnt)
        try:
            named.stage_class.check_learnt(named.settings, setup, checked)
            checked.done()
        except ValueError as error:
            raise ValueError(f"model's stage {name} does not fit this recipe: {error}") from None
    return named.stage_class(named.settings, setup, learnt)


ClutterNamed = Annotated[Named, BeforeValidator(_named("clutter"))]
MapNamed = Annotated[Named, BeforeValidator(_named("map"))]
ScreenNamed = Annotated[Named, BeforeValidator(_named("screen"))]
FeaturesNamed = Annotated[Named, BeforeValidator(_named("features"))]


def find_stage(kind: str, name: str) -> type[Stage]:
    """Find a stage of a kind by its name: a packaged one, or an entry point of the group "flgpr.stages"."""
    if name in PACKAGED[kind]:
        module, _, which = PACKAGED[kind][name].partition(":")
        packaged: type[Stage] = getattr(import_module(f"flgpr.chain.stages.{module}"), which)
        return packaged
    offered = {one.name: one for one in entry_points(group=GROUP)}
    if name not in offered:
        known = ", ".join([*PACKAGED[kind], *offered])
        raise ValueError(f"stage must be one of {known}, got {name!r}")
    loaded = offered[name].load()
    if not (isinstance(loaded, type) and issubclass(loaded, Stage) and loaded.kind == kind):
        raise ValueError(
            f"stage {name!r} of {offered[name].value} must be a class of the kind {kind}, got "
            f"{loaded!r}"
        )
    return loaded
