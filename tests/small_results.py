"""A result folder as detection would write it, of three alarms and a few pixels."""

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.method.detection import Detection
from flgpr.model import Lane
from flgpr.recipe.make import with_earlier
from flgpr.recipe.schema import recipe_text
from flgpr.results.result import write_result

LANE = Lane(-1.0, 1.0, 2.0, 4.0)


def small_result(folder, classifier=None, days=False, **described):
    """Write the result; with ``days`` it has an earlier drive, with a gain of its own."""
    alarms = pd.DataFrame(
        {
            "alarm_id": ["a", "b", "c"],
            "x": [0.1, -0.7, 0.9],
            "y": [3.0, 3.5, 2.2],
            "confidence": [9.0, 4.0, 2.5],
        }
    )
    x = np.arange(-1, 1.01, 0.5)
    y = np.arange(2.0, 4.01, 0.5)
    view = xr.DataArray(
        np.random.default_rng(0).random((1, 1, y.size, x.size), np.float32),
        dims=("polarization", "subband", "y", "x"),
        coords={
            "polarization": ["HH"],
            "subband": ["F1"],
            "y": y,
            "x": x,
            "looks": (("y", "x"), np.ones((5, 5))),
        },
    )
    features = pd.DataFrame({"C_HH_F1": [9.0, 4.0, 2.5], "M_VV_F1": [3.0, 2.0, 1.0]})
    detection = Detection(
        "main", "as it stands", alarms, view, {"confidence": "C_HH_F1"}, features=features
    )
    text = recipe_text("wang2007")
    if days:
        detection = replace(
            detection, before=2 * view, earlier=6 * view[..., ::-1, :].assign_coords(y=y)
        )
        text = with_earlier(text)
    run = {"title": "small", "scans": 0, "masked_scans": [], **described}
    return write_result(folder, [detection], text, LANE, run, classifier)
