"""Stages: what each kind of them must be able to do.

A stage is a class of one of four kinds. Its ``Settings`` are the entries of its table in a recipe.
Stages come with the package or from another distribution; :mod:`flgpr.stages.named` finds them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flgpr.detect.scorers.checks import Checked
from flgpr.model.bounds import Entries
from flgpr.model.bounds import Positive as Positive
from flgpr.types import AnyArray, Arrays, ComplexArray, Float32Array, FloatArray, floats

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from flgpr.engine import Accumulator, PlannedPass
    from flgpr.imaging import ScanImager
    from flgpr.model import Grid, Lane
    from flgpr.stages.sums import AlarmGatherer


def scan_bytes(sizes: Mapping[str, int]) -> float:
    """Return the bytes of the data of a scan of a run, by the lengths of the run's dimensions."""
    return 8.0 * sizes["polarization"] * sizes["pair"] * sizes["frequency"]


class Table(Entries):
    """A table of a recipe: it refuses unknown entries, and its numbers have bounds."""


@dataclass(frozen=True)
class Setup:
    """What a stage knows about the chain it belongs to."""

    #: the run; live, where none is stored, one scan without an echo at the lane's origin
    run: xr.Dataset
    #: runs that were taken together with it, such as a second band, by the names in recipes
    others: Mapping[str, xr.Dataset]
    lane: Lane  #: the lane
    #: makes images and operators of the run; ``imager.scans`` are the numbers of its complete
    #: scans, in whose order indices count
    imager: ScanImager
    images: Grid  #: pixels of the scan images that count, in the scan frame
    view: Grid  #: pixels of the run-view, in the lane frame
    imaged: list[int]  #: numbers of the polarizations that are imaged
    summed: int  #: number of scans that an image is the coherent sum of
    results: MutableMapping[str, Any]  #: results of earlier passes, arrays by name

    def pose(self, index: int) -> FloatArray:
        """Return the pose (6,) of the scan at an index among the complete ones."""
        return floats(self.run["pose"].values[self.imager.scans[index]])


def scan_number(setup: Setup, index: int) -> int:
    """Return the number in the run of the scan at an index among the complete ones."""
    return int(setup.imager.scans[index])


def measured(setup: Setup, index: int) -> ComplexArray:
    """Return the measured data of the scan at an index."""
    return setup.imager.signal(scan_number(setup, index))


def imaged_labels(setup: Setup) -> list[str]:
    """Return the labels of the polarizations that are imaged."""
    labels = setup.run["polarization"].values
    return [str(labels[number]) for number in setup.imaged]


def channel_of(stage: str, settings: Any, setup: Setup) -> tuple[int, int]:
    """Return the indices of the polarization and the sub-band that a stage's settings name.

    By default each is the first.

    Raises
    ------
    ValueError
        If images have no such channel.
    """
    known = {"polarization": imaged_labels(setup), "subband": list(setup.imager.subbands)}
    indices = []
    for axis, labels in known.items():
        label = getattr(settings, axis)
        if label is not None and label not in labels:
            raise ValueError(f"{stage}.{axis} must be one of {', '.join(labels)}, got {label!r}")
        indices.append(0 if label is None else labels.index(label))
    return indices[0], indices[1]


class Stage:
    """A step of a recipe. Subclass one of the kinds below.

    Parameters
    ----------
    settings : Table
        The entries of its table in the recipe, an instance of ``Settings``.
    setup : Setup
        The chain it belongs to.
    learnt : dict of str to ndarray, optional
        What :meth:`fit` returned.
    """

    kind: ClassVar[str] = ""  #: "clutter", "map", "screen" or "features"
    learns: ClassVar[bool] = False  #: whether it must be trained: it then has ``fit``
    not_live_because: ClassVar[str] = ""  #: why it cannot work while scans come in; "" if it can
    Settings: ClassVar[type[Table]] = Table  #: the entries of its table in a recipe
    #: entries, with values, that let more through: advice for those who train on few mines
    looser: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        self.settings = settings
        self.setup = setup
        self.learnt = learnt or {}

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Learn from the training lanes.

        Parameters
        ----------
        settings : Table
            The entries of its table.
        examples : list
            One thing per training lane: the result of ``examples`` for the kinds that look at
            scans, else a :class:`TrainingView`.

        Returns
        -------
        learnt : dict of str to ndarray
            Arrays to work with later.
        notes : dict
            Figures worth reporting.
        """
        raise NotImplementedError(f"{cls.__name__} does not learn")

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Check the name, type and shape of the arrays that :meth:`fit` returned.

        A model may come from anybody. A stage that does not override this accepts any arrays.

        Raises
        ------
        ValueError
            If ``fit`` cannot have returned an array for these settings.
        """
        learnt.take_all()

    @classmethod
    def why_not_live(cls, settings: Any) -> str:  # noqa: ARG003
        """Return why it cannot work while scans come in; "" if it can."""
        return cls.not_live_because

    @classmethod
    def margin(cls, settings: Any) -> float:  # noqa: ARG003
        """Return how far along the lane from an alarm it depends on the run-view, m."""
        return 0.0

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Estimate the bytes that it takes.

        Parameters
        ----------
        settings : Table
            The entries of its table.
        sizes : mapping of str to int
            Lengths of the run's dimensions.
        image : Grid
            Pixels of the scan images.
        """
        return 0.0

    def passes(self) -> list[PlannedPass]:
        """Return the passes over the run that it needs before images are cleaned.

        Their names begin with that of the stage.
        """
        return []

    def notes(self) -> dict[str, Any]:
        """Return figures worth reporting of the whole run, once its passes are done."""
        return {}

    def sentences(self) -> list[str]:
        """Return what the reader of a result must know of the whole run, once its passes are done."""
        return []

    @classmethod
    def targets_used_for_training(
        cls,
        settings: Any,  # noqa: ARG003
        examples: list[Any],  # noqa: ARG003
    ) -> list[Any]:
        """Return the rows of each training lane's truth that the stage has learnt from.

        No detector is trained on them again.
        """
        return []


@dataclass(frozen=True)
class TrainingView:
    """The run-view of a training lane, and what stands in the lane."""

    view: xr.DataArray  #: (polarization, subband, y, x)
    truth: pd.DataFrame  #: its targets
    lane: Lane  #: its borders


class ClutterStage(Stage):
    """Takes clutter out of the received field, data in, data out, or out of its images."""

    kind = "clutter"
    before: Callable[[int, int], ComplexArray]
    """Data of the scans up to an index, as the stages before leave it: ``before(index, count)``."""

    def _data_before(self, index: int) -> ComplexArray:
        """Return the data of the scan at an index, as the stages before leave it."""
        return self.before(index, 1)[0]

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:
        """Return the cleaned data of a scan.

        Parameters
        ----------
        index : int
            Index of the scan among the complete ones.
        data : (polarization, pair, frequency) ndarray of complex
            Its data, as the stages before leave it.
        """
        raise NotImplementedError

    def data(self, index: int, count: int) -> ComplexArray:
        """Return the cleaned data of the last scans up to an index.

        Parameters
        ----------
        index : int
            Index of the last scan among the complete ones.
        count : int
            Number of scans; there are fewer at the beginning of the run.

        Returns
        -------
        (scan, polarization, pair, frequency) ndarray of complex
            The latest scan is the last.
        """
        cleaned = []
        for scan_index in range(max(index - count + 1, 0), index + 1):
            cleaned.append(self.clean(scan_index, self._data_before(scan_index)))
        return np.stack(cleaned)

    def of_image(self, index: int, image: xr.DataArray) -> xr.DataArray:  # noqa: ARG002
        """Return the image (polarization, subband, y, x) of a scan's cleaned data, cleaned further."""
        return image

    def examples(self, truth: pd.DataFrame) -> Accumulator:
        """Return what gathers, scan by scan, the examples of ``fit`` on a lane with this truth."""
        raise NotImplementedError


class MapStage(Stage):
    """Turns every cleaned scan image into a map of how much each pixel is like a mine."""

    kind = "map"
    single: ClassVar[bool] = True  #: whether it reads images of one sub-band alone
    #: whether it learns clutter, and measures that of a lane for comparison: it then has
    #: ``clutter_of``, ``map_as_learnt`` and ``without_lane``
    measures_clutter: ClassVar[bool] = False
    #: returns what stands in for what was learnt, where a lane's clutter is unlike it: "own" for
    #: the lane's own, or "" for nothing
    substitute: Callable[[], str] = staticmethod(lambda: "")

    def map(self, image: xr.DataArray) -> Float32Array:
        """Return the map of a scan image.

        Parameters
        ----------
        image : (polarization, subband, y, x) DataArray of complex
            Cleaned scan image.

        Returns
        -------
        (y, x) ndarray
            NaN where it says nothing.
        """
        raise NotImplementedError

    @property
    def surveys(self) -> bool:
        """Whether it goes through all scans of a lane before its first map."""
        return False

    def survey(self, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what gathers, scan by scan, what maps need to know of the whole lane.

        Its result is that of the pass "survey". ``image`` returns the cleaned image of the scan at
        an index.
        """
        raise NotImplementedError

    def clutter_of(self, image: xr.DataArray) -> Arrays:
        """Return sums of the clutter of a cleaned scan image, which add up over scans.

        They hold ``covariance`` (metre, value, value), ``count`` (metre) and ``shape`` (metre,
        class).
        """
        raise NotImplementedError

    def map_as_learnt(self, image: xr.DataArray) -> Float32Array:
        """Return the map of a scan image as it is where nothing stands in for what was learnt."""
        raise NotImplementedError

    @classmethod
    def without_lane(
        cls, settings: Any, learnt: Arrays, examples: list[Any], number: int
    ) -> Arrays:
        """Return what it would have learnt of clutter without one of the training lanes."""
        raise NotImplementedError

    def parts(
        self,
        image: xr.DataArray,  # noqa: ARG002
    ) -> tuple[Mapping[str, AnyArray], Mapping[str, AnyArray]]:
        """Return what explains the map of a scan image, as maps (y, x) by name.

        Returns
        -------
        adding : mapping of str to ndarray
            Maps that add up to the map but for a constant.
        others : mapping of str to ndarray
            Maps that explain it without adding up.
        """
        return {}, {}

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what gathers, scan by scan, the examples of ``fit`` on a lane with this truth.

        ``image`` returns the cleaned image of the scan at an index.
        """
        raise NotImplementedError


class ScreenStage(Stage):
    """Raises alarms on the run-view, in place of its local maxima."""

    kind = "screen"

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far beyond a section's border alarms depend on the run-view, m."""
        raise NotImplementedError

    def alarms(self, view: xr.DataArray) -> pd.DataFrame:
        """Return the alarms on a run-view.

        Parameters
        ----------
        view : (polarization, subband, y, x) DataArray
            Run-view.

        Returns
        -------
        DataFrame
            ``x``, ``y`` (m, lane frame) and ``magnitude``, the strongest first.
        """
        raise NotImplementedError


class FeatureStage(Stage):
    """Makes features of alarms, each a column of their table, by one of the two methods or both.

    A recipe names it under ``[[columns]]``, and its features among ``features`` of a detector.
    Of the values of ``of_image`` the mean over all scans that see an alarm is taken, live over
    those so far; the chain gathers them. A stage with ``of_view`` waits for the whole run.
    """

    kind = "features"
    columns: tuple[str, ...] = ()
    """Names of the features that ``of_image`` makes; empty without that method."""
    alarm_columns: ClassVar[tuple[str, ...]] = ()
    """Features that the alarm table shows, too."""

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if cls.of_view is not FeatureStage.of_view and not cls.not_live_because:
            cls.not_live_because = (
                "columns of the run-view are complete only when a place is passed"
            )

    @classmethod
    def column_count(cls, settings: Any, polarizations: int, view: Grid) -> int:  # noqa: ARG003
        """Return how many features it makes at most, for the estimate of memory.

        Few need not be counted: what is taken for an alarm anyway covers some hundred.

        Parameters
        ----------
        settings : Table
            The entries of its table.
        polarizations : int
            Polarizations of the images.
        view : Grid
            Pixels of the run-view.
        """
        return 0

    def sums(self, alarms: pd.DataFrame) -> AlarmGatherer:
        """Return what gathers its columns at alarms: by default means of ``of_image``.

        Parameters
        ----------
        alarms : DataFrame
            ``x``, ``y`` in the lane frame, m.
        """
        from flgpr.stages.sums import StageSums  # it needs pandas, which recipes do not

        return StageSums(self, alarms)

    def of_alarms(self, alarms: pd.DataFrame) -> list[str]:  # noqa: ARG002
        """Return what the reader of a result must know of its alarms, one of whose columns is its."""
        return []

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return the features of one scan.

        Parameters
        ----------
        image : (polarization, subband, y, x) DataArray of complex
            Cleaned scan image, in units of the background.
        points : (alarm, 2) ndarray
            x and y of the alarms in the scan frame, m.

        Returns
        -------
        mapping of str to (alarm,) ndarray
            The features; NaN where the scan does not see the alarm.
        """
        raise NotImplementedError

    def of_view(
        self,
        view: xr.DataArray,  # noqa: ARG002
        points: FloatArray,  # noqa: ARG002
    ) -> Mapping[str, FloatArray]:
        """Return the features of the run-view.

        Parameters
        ----------
        view : (polarization, subband, y, x) DataArray
            Run-view.
        points : (alarm, 2) ndarray
            x and y of the alarms in the lane frame, m. There may be none: the names of the features
            are then asked for, and the run-view says nothing.

        Returns
        -------
        mapping of str to (alarm,) ndarray
            The features.
        """
        return {}
