"""``flgpr design``: predict what an array will see before it is built."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import Output, Progress
from flgpr.commands.shell import Arguments, command, options_given

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.types import Entries

_DEPTH = 0.05  # m, of the mines of the page


def _lines(returned: Any, call: Arguments) -> Iterator[Any]:
    """Yield tables of signal to clutter, or what each array will see and the page."""
    if call.signal_to_clutter:
        yield from map(_rich_table, returned)
        return
    from flgpr.design.array import expected_in_words

    yield from map(expected_in_words, returned)
    yield f"report: {Path(call.output).resolve()}"


def _as_json(tables: list[pd.DataFrame], _: Arguments) -> Entries:
    """Return the rows of all tables."""
    rows = []
    for table in tables:
        rows += json.loads(table.to_json(orient="records", double_precision=6))
    return {"signal_to_clutter": rows}


def _check_json(call: Arguments) -> Entries:
    """Refuse --json for the page, which has none."""
    if call.as_json and not call.signal_to_clutter:
        raise ValueError("--json goes with --signal-to-clutter, got it without")
    return {}


@command(
    lines=_lines,
    as_json=_as_json,
    python_values=_check_json,
)
def design(
    sensor: str,
    compare: Sequence[str] | None = None,
    output: Output = "design.html",
    band: tuple[float, float] | None = None,
    window: str = "hann",
    site: str = "arid-sand",
    rms: float | None = None,
    depth: Sequence[float] | None = None,
    signal_to_clutter: bool = False,
    body: Sequence[str] | None = None,
    distance: float | None = None,
    height: float | None = None,
    permittivity: float | None = None,
    loss_tangent: float | None = None,
    correlation_length: float | None = None,
    unevenness: float | None = None,
    measure: int | None = None,
    *,
    track: Progress = None,
) -> Any:
    """Predict what an array will see: point spread, resolution, lobes, signal to clutter.

    With --signal-to-clutter print a table for bodies at depths, by formula and with --measure
    measured.

    Parameters
    ----------
    sensor
        Sensor preset or TOML file.
    compare
        Another sensor to compare; may repeat.
    band
        First and last tone, Hz; all by default.
    window
        Window over the tones: boxcar, hann, hamming, taylor.
    site
        Site whose soil and surface the mines lie in.
    rms
        Rms height of the surface, m; the site's by default.
    depth
        Depth of the mines' top, m; may repeat with --signal-to-clutter.

    Signal to clutter
    -----------------
    signal_to_clutter
        Print the expected signal to clutter of bodies; write no page.
    body
        Signal to clutter: packaged body or table; may repeat; all by default.
    distance
        Signal to clutter: ground range to the body, m; 12.
    height
        Signal to clutter: of the array, m; the sensor's by default.
    permittivity
        Signal to clutter: of the soil, with --loss-tangent; the site's by default.
    loss_tangent
        Signal to clutter: of the soil; the site's by default.
    correlation_length
        Signal to clutter: of the surface, m; the site's by default.
    unevenness
        Signal to clutter: of the ground, m³ (ISO 8608); the site's by default.
    measure
        Signal to clutter: measure it too, on simulated images of this number of grounds.

    Returns
    -------
    list of Design or list of pandas.DataFrame
        For each sensor what it will see, or with ``signal_to_clutter`` its table.

    Raises
    ------
    ValueError
        If a sensor, a site or a body is not known, or an option does not go with the others.
    FileExistsError
        If another page is at the output.
    """
    asked = locals()
    from flgpr.progress import silent

    sensors = [sensor, *(compare or [])]
    if not signal_to_clutter:
        for name in options_given(design, asked, "Signal to clutter"):
            raise ValueError(f"`{name}` goes with signal_to_clutter, got it without")
        depths = depth or [_DEPTH]
        if len(depths) > 1:
            raise ValueError(
                f"`depth` must be given once without `signal_to_clutter`, got it {len(depths)} times"
            )
        from flgpr.design.array import Question
        from flgpr.report import design_report

        question = Question(band, window, site, depths[0], rms)
        return design_report(sensors, output, question, track or silent)
    if "output" in options_given(design, asked):
        raise ValueError(
            f"`output` is of the page, which signal_to_clutter leaves out, got {output}"
        )
    from flgpr.design import signal_to_clutter as formulas
    from flgpr.design.grounds import ground_model
    from flgpr.model import load_sensor
    from flgpr.simulate.bodies.signature import packaged_bodies

    ground = ground_model(
        site,
        permittivity=permittivity,
        loss_tangent=loss_tangent,
        rms_height=rms,
        correlation_length=correlation_length,
        unevenness=unevenness,
    )
    viewing = formulas.Viewing(
        distance=formulas.Viewing.distance if distance is None else distance,
        height=height,
        subbands=None if band is None else {"band": band},
        window=window,
    )
    bodies = list(body or packaged_bodies())
    depths = list(depth or formulas.DEPTHS)
    tables = []
    for array in map(load_sensor, sensors):
        table = formulas.expected_signal_to_clutter(array, ground, bodies, depths, viewing)
        if measure is not None:
            measured = formulas.measure_signal_to_clutter(
                array, ground, bodies, depths, viewing, seeds=measure, track=track or silent
            )
            table["measured_db"] = measured["signal_to_clutter_db"]
            table[["low_db", "high_db"]] = measured[["low_db", "high_db"]]
        tables.append(table)
    return tables


def _rich_table(table: pd.DataFrame) -> Any:
    """Return a table for rich, a row for each body and depth, a column for each polarization."""
    from rich.table import Table

    first = table.iloc[0]
    is_measured = "measured_db" in table
    title = (
        f"Signal to clutter (dB): {first['sensor']}, {first['distance']:.3g} m ahead, "
        f"{first['ground']}"
    )
    drawn = Table(title=title, caption=_caption(table))
    drawn.add_column("body", no_wrap=True)
    drawn.add_column("depth (cm)", justify="right")
    for polarization in table["polarization"].unique():
        drawn.add_column(polarization, justify="right", no_wrap=True)
        if is_measured:
            drawn.add_column(f"{polarization} measured", justify="right", no_wrap=True)
    for body in table["body"].unique():
        for depth in table["depth"].unique():
            rows = table[(table["body"] == body) & (table["depth"] == depth)]
            cells = []
            for row in rows.to_dict("records"):
                cells.append(_decibels(row["signal_to_clutter_db"]))
                if is_measured:
                    half_interval = row["high_db"] - row["measured_db"]
                    cells.append(f"{_decibels(row['measured_db'])} ± {half_interval:.1f}")
            drawn.add_row(body, f"{100 * depth:.3g}", *cells)
    return drawn


def _decibels(value: float) -> str:
    """Return a level to a tenth of a decibel; what rounds to zero has no sign."""
    return f"{round(value, 1) + 0.0:.1f}"


def _caption(table: pd.DataFrame) -> str:
    """Return roughness, backscatter and resolution cell of the ground of a table of one band."""
    backscatter = []
    for row in table.drop_duplicates("polarization").itertuples():
        backscatter.append(f"{row.polarization} {row.sigma0_db:.1f} dB")
    first = table.iloc[0]
    return (
        "Peak of a level body alone over the mean clutter of the bare surface, by formula. "
        f"Rms height {1000 * first['rms_height']:.3g} mm, backscatter {', '.join(backscatter)}, "
        f"resolution cell {first['cell_m2']:.2g} m². Factors of each figure: --json."
    )
