"""A result as a notebook shows it: its run-view with the alarms, and a table of the strongest."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flgpr.chain.detection import Detection
    from flgpr.model import Lane

_RANGE = 40.0  # dB
_ROWS = 10  # of the table


def detection_html(main: Detection, lane: Lane, run_title: str) -> str:
    """Return a detection in a lane as HTML."""
    summary = f"{len(main.alarms)} alarms in {lane.area:.0f} m² of {run_title}"
    picture = base64.b64encode(_picture(main, lane)).decode()
    columns = [name for name in ("x", "y", "confidence") if name in main.alarms]
    strongest = main.alarms.sort_values("confidence", ascending=False)[columns].head(_ROWS)
    table = strongest.to_html(index=False, float_format="{:.3g}".format, border=0)
    return (
        f"<p><b>{html.escape(main.title)}</b>: {html.escape(summary)}</p>"
        f'<div style="display:flex;gap:2em"><img alt="run-view with alarms" '
        f'src="data:image/png;base64,{picture}">{table}</div>'
    )


def _picture(detection: Detection, lane: Lane) -> bytes:
    """Draw the first channel of the run-view, dB below its peak, with the alarms, as PNG."""
    from matplotlib.figure import Figure

    view = detection.view[0, 0]
    level = np.abs(view.values)
    peak = float(np.nanmax(level, initial=0.0)) or 1.0
    with np.errstate(divide="ignore"):
        decibel = 20 * np.log10(level / peak)
    x = view["x"].values
    y = view["y"].values
    figure = Figure(figsize=(3.5, 5.0), layout="constrained")
    axes = figure.subplots()
    extent = (float(x[0]), float(x[-1]), float(y[0]), float(y[-1]))
    axes.imshow(decibel, "gray", extent=extent, origin="lower", vmin=-_RANGE, vmax=0)
    alarms = detection.alarms
    axes.scatter(alarms["x"], alarms["y"], s=60, facecolors="none", edgecolors="tab:red")
    axes.set(
        xlim=(lane.x_min, lane.x_max),
        ylim=(lane.y_min, lane.y_max),
        xlabel="x cross-track (m)",
        ylabel="y down-track (m)",
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90, metadata={"Software": None})
    return buffer.getvalue()
