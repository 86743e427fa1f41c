"""Signal to clutter of bodies as arrays of files would see them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from flgpr.chain.progress import Track, silent
from flgpr.design.signal_to_clutter import (
    DEPTHS,
    GroundModel,
    Viewing,
    expected_signal_to_clutter,
    measure_signal_to_clutter,
)
from flgpr.model import load_sensor
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
    """Return a table of signal to clutter for each sensor (preset or TOML), by formula, and measured if wanted.

    ``seeds`` is the number of grounds on which it is measured, which adds the columns ``measured_db``, ``low_db`` and
    ``high_db``. None takes all packaged bodies and five depths. Else see
    :func:`flgpr.design.expected_signal_to_clutter` and :func:`flgpr.design.measure_signal_to_clutter`, also for errors.
    """
    named = list(packaged_bodies() if bodies is None else bodies)
    chosen = list(DEPTHS if depths is None else depths)
    tables = []
    for name in sensors:
        sensor = load_sensor(name)
        table = expected_signal_to_clutter(sensor, ground, named, chosen, viewing)
        if seeds is not None:
            measured = measure_signal_to_clutter(
                sensor, ground, named, chosen, viewing, seeds=seeds, track=track
            )
            table["measured_db"] = measured["signal_to_clutter_db"]
            table[["low_db", "high_db"]] = measured[["low_db", "high_db"]]
        tables.append(table)
    return tables
