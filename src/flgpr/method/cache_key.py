"""What the result of a pass depends on beside run, lane and version of the program.

Recipes that agree in it share the result. None stands for a result that no other recipe can use,
because a stage that has learnt took part in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.method.imaged_run import ImagedRun
from flgpr.stages import FeatureStage, Named
from flgpr.store import sha256

IMAGING = {"image", "background", "clutter", "motion"}
"""Tables of a recipe that images and their backgrounds depend on."""
VIEWING = IMAGING | {"run_view", "contrast", "map"}
"""Tables of a recipe that run-views and what is read at alarms depend on."""


def background_key(lane: ImagedRun) -> dict[str, Any] | None:
    """Return what the self-signature and the gain background depend on."""
    recipe = lane.recipe
    for stage in [*recipe.clutter, *_image_columns(lane)]:
        if stage.stage_class.learns:
            return None
    tables = recipe.model_dump(mode="json", include=IMAGING)
    return {"recipe": tables, "rows": lane.background_rows}


def view_key(lane: ImagedRun) -> dict[str, Any] | None:
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


def features_key(lane: ImagedRun) -> dict[str, Any] | None:
    """Return what the features depend on, the places of the alarms included."""
    view = view_key(lane)
    if view is None:
        return None
    places = lane.alarms()[["x", "y"]].to_numpy(np.float64)
    columns = [stage.model_dump(mode="json") for stage in _image_columns(lane)]
    return view | {
        "features": lane.recipe.model_dump(mode="json", include={"features"}),
        "columns": columns,
        "alarms": sha256(places.tobytes()),
    }


def _image_columns(lane: ImagedRun) -> list[Named]:
    """List the feature stages of the recipe that read images."""
    columns = []
    for stage in lane.recipe.columns:
        if getattr(stage.stage_class, "of_image", None) is not FeatureStage.of_image:
            columns.append(stage)
    return columns
