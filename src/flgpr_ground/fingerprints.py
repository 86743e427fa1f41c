"""Whether lanes are those of the authors: fingerprints of lanes beside the packaged ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import Folder
from flgpr.store.files import existing
from flgpr.store.tables import parse_columns, parse_csv
from flgpr_ground.ground import Ground, packaged_text
from flgpr_ground.lanes import PRINTS


def same_lanes(ground: Ground, folder: Path) -> dict[str, str]:
    """Compare lanes with the packaged fingerprints.

    Parameters
    ----------
    ground : Ground
        The ground.
    folder : Path
        Folder of the lanes.

    Returns
    -------
    dict of str to str
        "same bits", "alike", "other", "not there" or "not known" by the name of the lane.
    """
    existing(folder / PRINTS, "fingerprints of lanes")
    return likeness_of(ground, Folder(folder).read(PRINTS))


def likeness_of(ground: Ground, prints: bytes) -> dict[str, str]:
    """Compare the fingerprints of lanes with the packaged ones, as :func:`same_lanes` does.

    Parameters
    ----------
    ground : Ground
        The ground.
    prints : bytes
        Table of fingerprints, which may come from anyone.

    Returns
    -------
    dict of str to str
        "same bits", "alike", "other", "not there" or "not known" by the name of the lane.

    Raises
    ------
    ValueError
        If it is no such table.
    """
    known = packaged_fingerprints(ground)
    table = parse_columns(prints, "lane", "sha256")
    if not {"lane", "sha256"} <= set(table.columns):
        raise ValueError(
            f"fingerprints must have the columns lane and sha256, got {', '.join(table.columns)}"
        )
    present = table.set_index("lane")
    if present.index.has_duplicates:
        raise ValueError("fingerprints must have every lane once, got one again")
    likeness = {}
    for name in ground.lanes:
        likeness[name] = "not there" if name not in present.index else "not known"
        if name in present.index and name in known.index:
            likeness[name] = _compared(present.loc[name], known.loc[name])
    return likeness


def packaged_fingerprints(ground: Ground) -> pd.DataFrame:
    """Return the authors' fingerprints of the lanes of a ground.

    Parameters
    ----------
    ground : Ground
        The ground.

    Returns
    -------
    pandas.DataFrame
        By the name of the lane: ``sha256`` and the rms of the echoes of every polarization. There
        are no rows for a ground of somebody else.
    """
    table = parse_csv(packaged_text("fingerprints.csv"))
    title_and_lane = table["lane"].str.split(" ", n=1, expand=True)
    rows = table.assign(lane=title_and_lane[1])[title_and_lane[0] == ground.title]
    return rows.set_index("lane")


def _compared(present: Any, known: Any) -> str:
    """Return how alike two lanes are, by a row of each table of fingerprints."""
    if present["sha256"] == known["sha256"]:
        return "same bits"
    levels = [column for column in known.index if column != "sha256" and pd.notna(known[column])]
    try:
        measured = [float(present[column]) for column in levels]
    except (KeyError, TypeError, ValueError):
        return "other"  # no number for a polarization
    is_alike = np.allclose(measured, known[levels].astype(float), rtol=1e-4, atol=0)
    return "alike" if is_alike else "other"
