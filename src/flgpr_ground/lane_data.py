"""A lane of a proving ground as a detector sees it: run, image, and truth where that is open."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd
import xarray as xr

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.store import open_run
from flgpr.store.tables import read_table_in
from flgpr_ground.ground import GroundLane


@dataclass(frozen=True)
class LaneData:
    """A lane of a proving ground; what it holds is read when it is asked for."""

    name: str  #: its name on the ground
    site: str  #: name of its site
    part: str  #: "train", "validate" or "test"; the truth of the last is sealed
    lane: Lane  #: its borders, m in the lane frame
    folder: Path = field(repr=False)  #: has the lanes of the ground
    recipe: str = field(repr=False)  #: TOML text of the recipe that makes the image

    @cached_property
    def run(self) -> xr.Dataset:
        """The run: ``signal`` (scan, polarization, pair, frequency), positions and poses."""
        return open_run(self.folder / f"{self.name}.zarr")

    @cached_property
    def image(self) -> xr.DataArray:
        """The run-view (polarization, subband, y, x) in the lane frame, over the background."""
        setup = ImagedRun(self.run, parse_recipe(self.recipe), self.lane, explains=False)
        engine = engine_of(setup)
        engine.run(names=list(engine.passes)[: list(engine.passes).index("view") + 1])
        return setup.view()

    @property
    def truth(self) -> pd.DataFrame:
        """The targets: ``x``, ``y`` (m), ``kind``, ``depth`` (m), ``target_id``.

        Raises
        ------
        ValueError
            If the lane is one to test on.
        """
        if self.part == "test":
            raise ValueError(f"truth must be of a training lane, got {self.name}, which is sealed")
        return read_table_in(self.folder, f"{self.name}-truth.csv", "truth")


def lane_data(lane: GroundLane, folder: Path, recipe: str) -> LaneData:
    """Return a lane that lies in a folder, with the recipe (TOML text) of its image."""
    return LaneData(lane.name, lane.site, lane.part, lane.lane, folder, recipe)
