"""Signal to clutter of bodies as arrays of files would see them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from flgpr.chain.progress import Track, silent
from flgpr.design.signal_to_clutter import (
    DEPTHS,
    DISTANCE,
    Subbands,
    expected_signal_to_clutter,
    ground_model,
    measure_signal_to_clutter,
)
from flgpr.model import load_sensor
from flgpr.simulate.signature import packaged_bodies


def signal_to_clutter_tables(
    sensors: Sequence[str | Path],
    site: str,
    *,
    rms_height: float | None = None,
    correlation_length: float | None = None,
    unevenness: float | None = None,
    permittivity: float | None = None,
    loss_tangent: float | None = None,
    bodies: Sequence[str] | None = None,
    depths: Sequence[float] | None = None,
    distance: float | None = None,
    height: float | None = None,
    subbands: Subbands | None = None,
    window: str = "hann",
    seeds: int | None = None,
    track: Track = silent,
) -> list[pd.DataFrame]:
    """Return a table of signal to clutter for each sensor (preset or TOML), by formula, and measured if wanted.

    ``seeds`` is the number of grounds on which it is measured, which adds the columns ``measured_db``, ``low_db``
    and ``high_db``. None takes all packaged bodies, five depths and 12 m. Parameters are else as of
    :func:`flgpr.design.ground_model` and :func:`flgpr.design.expected_signal_to_clutter`, and so are the errors.
    """
    ground = ground_model(
        site,
        permittivity=permittivity,
        loss_tangent=loss_tangent,
        rms_height=rms_height,
        correlation_length=correlation_length,
        unevenness=unevenness,
    )
    named = list(packaged_bodies() if bodies is None else bodies)
    chosen = list(DEPTHS if depths is None else depths)
    ahead = DISTANCE if distance is None else distance
    tables = []
    for name in sensors:
        sensor = load_sensor(name)
        table = expected_signal_to_clutter(
            sensor, ground, named, chosen, distance=ahead, height=height, subbands=subbands, window=window
        )
        if seeds is not None:
            measured = measure_signal_to_clutter(
                sensor,
                ground,
                named,
                chosen,
                seeds=seeds,
                distance=ahead,
                height=height,
                subbands=subbands,
                window=window,
                track=track,
            )
            table["measured_db"] = measured["signal_to_clutter_db"]
            table[["low_db", "high_db"]] = measured[["low_db", "high_db"]]
        tables.append(table)
    return tables
