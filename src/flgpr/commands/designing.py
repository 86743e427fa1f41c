"""Signal to clutter of bodies for arrays that presets or files describe."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from flgpr.design.grounds import GroundModel
from flgpr.design.signal_to_clutter import (
    DEPTHS,
    Viewing,
    expected_signal_to_clutter,
    measure_signal_to_clutter,
)
from flgpr.model import load_sensor
from flgpr.progress import Track, silent
from flgpr.simulate.bodies.signature import packaged_bodies


def signal_to_clutter_tables(
    sensors: Sequence[str | Path],
    ground: GroundModel,
    viewing: Viewing,
    *,
    bodies: Sequence[str] | None = None,
    depths: Sequence[float] | None = None,
    seeds: int | None = None,
    track: Track = silent,
) -> list[pd.DataFrame]:
    """Return a table of signal to clutter for each sensor, by formula, and measured if asked for.

    Parameters
    ----------
    sensors : sequence of str or path
        Presets or TOML files.
    ground : GroundModel
        Soil and surface.
    viewing : Viewing
        Distance, height and band.
    bodies : sequence of str, optional
        Packaged bodies or tables, by default all packaged ones.
    depths : sequence of float, optional
        Depths of the bodies' tops, by default five, m.
    seeds : int, optional
        Number of simulated grounds on which signal to clutter is measured. It adds the columns
        ``measured_db``, ``low_db`` and ``high_db``.
    track : Track
        Shows progress.

    Returns
    -------
    list of pandas.DataFrame
        Tables of :func:`flgpr.design.expected_signal_to_clutter`.

    Raises
    ------
    ValueError
        As that function and :func:`flgpr.design.measure_signal_to_clutter`.
    """
    body_names = list(packaged_bodies() if bodies is None else bodies)
    depth_list = list(DEPTHS if depths is None else depths)
    tables = []
    for name in sensors:
        sensor = load_sensor(name)
        table = expected_signal_to_clutter(sensor, ground, body_names, depth_list, viewing)
        if seeds is not None:
            measured = measure_signal_to_clutter(
                sensor, ground, body_names, depth_list, viewing, seeds=seeds, track=track
            )
            table["measured_db"] = measured["signal_to_clutter_db"]
            table[["low_db", "high_db"]] = measured[["low_db", "high_db"]]
        tables.append(table)
    return tables
