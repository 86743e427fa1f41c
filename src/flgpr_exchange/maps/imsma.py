"""Alarms as a table of points for IMSMA, the Information Management System for Mine Action.

The columns follow the draft of minimum data requirements that the Geneva International Centre for
Humanitarian Demining (GICHD) published in 2018 (repository GICHD/mdr): of a contaminated location
its coordinates, its status, the type and the location of evidence, and the category of device; of a
device its category and model, its condition and its depth; of the activity its organisation, method
and date. What a radar cannot know stays empty, to be filled in by whoever investigates the point.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr import __version__
from flgpr.geo.points import STATEMENT

STATUS = "open: alarm of a radar, not investigated"
EVIDENCE = "radar alarm (neither direct nor indirect evidence by itself)"
METHOD = "forward-looking ground-penetrating radar"

IMSMA_COLUMNS = {
    "id": "name of the point, unique in the file",
    "latitude": "WGS 84 (EPSG:4326), decimal degrees",
    "longitude": "WGS 84 (EPSG:4326), decimal degrees",
    "coordinate_system": "EPSG:4326 in every row",
    "position_accuracy_m": "standard deviation by the anchor alone, in the worst direction, m",
    "date": "when the data were taken, ISO 8601",
    "status": "open: nobody has investigated the point",
    "evidence_type": "what the point rests on",
    "device_category": "suspected category of device; empty: the radar does not classify devices",
    "device_model": "empty: to be filled in after investigation",
    "device_condition": "empty: to be filled in after investigation",
    "depth_m": "depth of the top of the device, m; empty where the list has none",
    "confidence": "of the alarm; higher is more like a mine, no absolute scale",
    "organisation": "who made the survey; empty where it was not stated",
    "operational_method": "how the point was found",
    "source": "what the point came from: processing or digest, and version of flgpr",
    "remarks": "that the point is no hazard area, and what its absence does not say",
}
"""Columns of the table and what each holds."""


def imsma_table(points: pd.DataFrame, organisation: str = "") -> pd.DataFrame:
    """Return alarms on the Earth as the rows of a table for IMSMA.

    Parameters
    ----------
    points : DataFrame
        Alarms of :func:`flgpr.geo.points.georeference`; columns ``alarm_id``, ``kind`` and
        ``depth`` (m) are used where there are any.
    organisation : str
        Who made the survey.

    Returns
    -------
    DataFrame
        The columns of :data:`IMSMA_COLUMNS`, a row for each alarm.
    """
    kinds = points["kind"].fillna("").astype(str) if "kind" in points else ""
    columns = {
        "id": _ids(points),
        "latitude": points["latitude"].round(8),
        "longitude": points["longitude"].round(8),
        "coordinate_system": points["crs"],
        "position_accuracy_m": points["anchor_sigma"].round(3),
        "date": points["time"],
        "status": STATUS,
        "evidence_type": EVIDENCE,
        "device_category": kinds,
        "device_model": "",
        "device_condition": "",
        "depth_m": points.get("depth", np.nan),
        "confidence": points["confidence"],
        "organisation": organisation,
        "operational_method": METHOD,
        "source": points["processing_id"] + f", flgpr {__version__}",
        "remarks": STATEMENT,
    }
    return pd.DataFrame(columns, index=range(len(points)))


def _ids(points: pd.DataFrame) -> list[str]:
    """Return the names of alarms; those of several lanes have the lane's name before them."""
    names = []
    for number, row in enumerate(points.to_dict("records"), 1):
        stated = row.get("alarm_id")
        name = stated if isinstance(stated, str) and stated else f"alarm-{number}"
        lane = row.get("lane")
        names.append(f"{lane}/{name}" if isinstance(lane, str) and lane else name)
    return names
