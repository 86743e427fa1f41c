"""What rival stages that learn from run-views have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd
import xarray as xr

from flgpr.screen import local_maxima
from flgpr.stages import TrainingView
from flgpr.stages.too_few import Change
from flgpr.types import FloatArray, floats


def maxima_in_lane(lane: TrainingView, level: FloatArray, radius: float) -> FloatArray:
    """Return x and y (n, 2) of the local maxima of a level (y, x) of the run-view in the lane.

    They are at least ``radius`` apart, m.
    """
    table = local_maxima(lane.view[0, 0].copy(data=level), radius)
    places = floats(table[["x", "y"]])
    return places[lane.lane.contains(places[:, 0], places[:, 1])]


def check_images(view: xr.DataArray, learnt_images: int) -> None:
    """Refuse a run-view of another number of images than those that were learnt from."""
    images = math.prod(view.shape[:-2])
    if images != learnt_images:
        raise ValueError(
            f"model must have been trained on run-views of {images} images, as this one, "
            f"got {learnt_images}"
        )


def kinds_change(settings: Any, views: Sequence[TrainingView]) -> list[Change]:
    """Return the change to the kinds of targets that the truth holds.

    None where a stage learns from all of them already.
    """
    kinds = sorted(set(pd.concat([lane.truth["kind"] for lane in views])))
    if not set(kinds) - set(settings.kinds):
        return []
    return [Change("kinds", kinds, list(settings.kinds))]
