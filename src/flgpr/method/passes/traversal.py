"""What a pass is, and how several go through the scans of a lane together.

One scan of a run, as the passes see it.

What the result of a pass depends on beside run, lane and version of the program.

Recipes that agree in it share the result. None stands for a result that no other recipe can use,
because a stage that has learnt took part in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from flgpr.engine import Accumulator, PlannedPass, bundle_groups, group_of
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.steps import CleanedImages
from flgpr.stages import FeatureStage, measured
from flgpr.stages.named import Named
from flgpr.store import sha256
from flgpr.types import AnyArray, Arrays, ComplexArray, Entries, Float32Array, FloatArray, floats


class ImagedScan:
    """One scan of a run: its images, made when a pass asks, and shared by passes that go together.

    ``index`` counts among the complete scans. What is cleaned needs the result of the pass "gain".
    """

    def __init__(self, lane: ImagedRun, index: int) -> None:
        self._lane = lane
        self.index = index

    @cached_property
    def data(self) -> ComplexArray | None:
        """The scan's data (polarization, pair, frequency), read once for several uses.

        None unless both the image and what explains alarms are made of them.
        """
        lane = self._lane
        if lane.reads_data_once:
            return measured(lane.setup, self.index)
        return None

    @cached_property
    def near_image(self) -> xr.DataArray:
        """The image before its background is removed, as far ahead as counts, with its pose."""
        lane = self._lane
        return lane.near_image(self.index, self.data if lane.reads_data else None)

    @property
    def gain(self) -> FloatArray:
        """The scan's gain (polarization, subband)."""
        return self._lane.gains[self.index]

    @property
    def number(self) -> int:
        """The scan's number in the run."""
        return int(self.near_image.attrs["scan"])

    @property
    def pose(self) -> FloatArray:
        """The scan's pose (6,) in the lane frame."""
        return floats(self.near_image.attrs["pose"])

    def magnitude(self) -> Float32Array:
        """Return the cleaned magnitude (polarization, subband, y, x), or the recipe's map of it.

        It is in units of the background (Wang et al. 2007, Eq. 5).
        """
        lane = self._lane
        if lane.mapper is None:
            return lane.background.magnitude(self.near_image.values, self.gain)
        return lane.mapper.map(self.coherent)[None, None]

    def map_as_learnt(self) -> Float32Array:
        """Return the map (1, 1, y, x) as it is where nothing stands in for what was learnt."""
        return self._lane.mapper.map_as_learnt(self.coherent)[None, None]

    @property
    def coherent(self) -> xr.DataArray:
        """The cleaned image with its phase, a gain of each polarization's own."""
        coherent = self._lane.background.own_coherent(self.near_image.values, self.gain)
        return self.near_image.copy(data=coherent)

    def of_day(self, day: str) -> Float32Array:
        """Return the magnitude (polarization, subband, y, x) before the background is removed.

        It is that of "today", from which nothing is subtracted that earlier drives predict, or that
        of the "earlier" drive on the same ground, NaN where none lies near.
        """
        image = self.near_image.values
        earlier = self._lane.earlier
        if earlier is None:
            return np.abs(image)
        of_day = earlier.days[day][:, : image.shape[-2]]
        return np.abs(of_day).reshape(image.shape)

    @cached_property
    def cleaned(self) -> CleanedImages:
        """The cleaned images, as far as features and explanations read them."""
        lane = self._lane
        return lane.steps.clean(
            self.number,
            self.pose,
            self.near_image.values,
            self.gain,
            lane.background,
            needs_own_phase=lane.explains,
        )


class Pass:
    """One pass over the scans of a lane, or over one block of them.

    A subclass overrides what it does; by default a pass reads no scan, and its state is that of the
    sums that it gathers, or nothing.

    Parameters
    ----------
    lane : ImagedRun
        The lane, with the results of earlier passes.
    block : range or None
        The block whose scans are added; None where the states of all blocks are merged.
    """

    name: ClassVar[str]  #: the name of its result among those of the lane
    title: ClassVar[str]  #: what it is called where progress is shown
    needs: ClassVar[tuple[str, ...]] = ()  #: earlier passes whose results it reads
    #: goes through all scans even where a section of the lane is wanted
    all_scans: ClassVar[bool] = False
    needs_no_scans: ClassVar[bool] = False  #: works on the results of earlier passes alone
    #: gathers what the viewer shows beside the alarms; left out where nothing is to be explained
    explains: ClassVar[bool] = False

    def __init__(self, lane: ImagedRun, block: range | None, sums: Any = None) -> None:  # noqa: ARG002
        self.lane = lane
        self._sums = sums

    def add(self, scan: ImagedScan) -> None:
        """Add one scan's images, gains and pose."""

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return everything gathered so far as plain arrays, which checkpoints and workers write.

        With ``exact`` a pass that merges the state continues with the same bits. Without it the
        precision of the result suffices, and the state may be smaller.
        """
        return {} if self._sums is None else self._sums.state()

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the state of the block that follows."""
        if self._sums is not None:
            self._sums.merge(dict(state))

    def result(self) -> Arrays:
        """Return what later passes read."""
        raise NotImplementedError

    @staticmethod
    def cache_key(lane: ImagedRun) -> Entries | None:  # noqa: ARG004
        """Return what the result depends on, by which other recipes share it.

        None if no other recipe can use the result.
        """
        return None


def traversal(lane: ImagedRun, kinds: Sequence[type[Pass]], block: range | None) -> Accumulator:
    """Begin passes that go through the same scans together and share each scan's images.

    States and results are those of the only pass, or those of all as groups.

    Parameters
    ----------
    lane : ImagedRun
        The lane.
    kinds : sequence of type
        The classes of the passes.
    block : range or None
        As of :class:`Pass`.
    """
    passes = {kind.name: kind(lane, block) for kind in kinds}

    def add(index: int) -> None:
        scan = ImagedScan(lane, index)
        for member in passes.values():
            member.add(scan)

    if len(passes) == 1:
        (only,) = passes.values()
        return Accumulator(add, only.state, only.merge, only.result)

    def state(exact: bool) -> Arrays:
        return bundle_groups({name: member.state(exact) for name, member in passes.items()})

    def merge(state: Mapping[str, AnyArray]) -> None:
        for name, member in passes.items():
            member.merge(group_of(state, name))

    def result() -> Arrays:
        return bundle_groups({name: member.result() for name, member in passes.items()})

    return Accumulator(add, state, merge, result)


def plan(lane: ImagedRun, *kinds: type[Pass]) -> PlannedPass:
    """Plan passes that go through the scans of a lane together, under the name of the first.

    Those that only explain alarms are left out where the lane is not to be explained.

    Parameters
    ----------
    lane : ImagedRun
        The lane.
    *kinds : type
        Classes of passes.

    Returns
    -------
    PlannedPass
        What the engine runs.
    """
    chosen = [kind for kind in kinds if lane.explains or not kind.explains]
    first = chosen[0]
    needs = dict.fromkeys(name for kind in chosen for name in kind.needs)
    return PlannedPass(
        first.name,
        first.title,
        partial(traversal, lane, chosen),
        tuple(needs),
        all_scans=first.all_scans,
        needs_no_scans=first.needs_no_scans,
        cache_key=partial(first.cache_key, lane),
    )


IMAGING = {"image", "background", "clutter", "motion"}
"""Tables of a recipe that images and their backgrounds depend on."""
VIEWING = IMAGING | {"run_view", "contrast", "map"}
"""Tables of a recipe that run-views and what is read at alarms depend on."""


def background_key(lane: ImagedRun) -> Entries | None:
    """Return what the self-signature and the gain background depend on."""
    recipe = lane.recipe
    for stage in [*recipe.clutter, *_image_features(lane)]:
        if stage.stage_class.learns:
            return None
    tables = recipe.model_dump(mode="json", include=IMAGING)
    return {"recipe": tables, "rows": lane.background_rows}


def view_key(lane: ImagedRun) -> Entries | None:
    """Return what the run-view depends on."""
    recipe = lane.recipe
    background = background_key(lane)
    if background is None or (recipe.map is not None and recipe.map.stage_class.learns):
        return None
    # The entries' names are part of the names of files in a pass cache.
    return background | {
        "recipe": recipe.model_dump(mode="json", include=VIEWING),
        "explains": lane.explains,
        "kept": [lane.view_rows.start, lane.view_rows.stop],
    }


def features_key(lane: ImagedRun) -> Entries | None:
    """Return what the features depend on, the places of the alarms included."""
    view = view_key(lane)
    if view is None:
        return None
    places = lane.alarms()[["x", "y"]].to_numpy(np.float64)
    columns = [stage.model_dump(mode="json") for stage in _image_features(lane)]
    return view | {
        "features": lane.recipe.model_dump(mode="json", include={"features"}),
        "columns": columns,
        "alarms": sha256(places.tobytes()),
    }


def _image_features(lane: ImagedRun) -> list[Named]:
    """List the feature stages of the recipe that read images."""
    stages = []
    for stage in lane.recipe.columns:
        if getattr(stage.stage_class, "of_image", None) is not FeatureStage.of_image:
            stages.append(stage)
    return stages
