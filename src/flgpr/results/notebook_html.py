"""What a notebook shows of results: a small table and a picture.

Names come from files: each of them is escaped.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flgpr.method.detection import Detection
    from flgpr.model import Lane

_RANGE = 40.0  # dB
_ROWS = 10  # of the table


def detection_html(main: Detection, lane: Lane, run_title: str) -> str:
    """Return a detection in a lane as HTML."""
    summary = f"{len(main.alarms)} alarms in {lane.area:.0f} m² of {run_title}"
    figure, _ = draw_detection(main, lane)
    columns = [name for name in ("x", "y", "confidence") if name in main.alarms]
    strongest = main.alarms.sort_values("confidence", ascending=False)[columns].head(_ROWS)
    picture = picture_html(figure, "run-view with alarms")
    heading = f"<p><b>{html.escape(main.title)}</b>: {html.escape(summary)}</p>"
    return heading + side_by_side_html(picture, table_html(strongest))


def outcomes_html(sentence: str, outcomes: pd.DataFrame, main: Detection, lane: Lane) -> str:
    """Return what became of each target of a lane as HTML.

    Parameters
    ----------
    sentence : str
        What sums it up.
    outcomes : DataFrame
        Rows of targets as a score has them.
    main : Detection
        What was scored.
    lane : Lane
        The lane.
    """
    figure, axes = draw_detection(main, lane)
    is_found = outcomes["found"].to_numpy(dtype=bool)
    found = outcomes[is_found]
    missed = outcomes[~is_found]
    axes.plot(found["x"], found["y"], "s", mfc="none", mec="tab:green", ms=13, label="found")
    axes.plot(missed["x"], missed["y"], "x", mec="tab:orange", ms=11, mew=2, label="missed")
    figure.legend(loc="outside lower center", ncols=3, fontsize="small", markerscale=0.6)
    picture = picture_html(figure, "run-view with alarms and targets")
    return _told(sentence, picture, outcomes)


def curve_html(sentence: str, outcomes: pd.DataFrame, curve: pd.DataFrame) -> str:
    """Return what became of each target as HTML, with the ROC curve (``far``, per m², and ``pd``).

    This is for lists of alarms, of which there is no run-view.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.step(curve["far"], curve["pd"], where="post")
    axes.set(xlabel="false alarms per m²", ylabel="Pd", ylim=(0, 1.02))
    axes.set_xlim(left=0)
    picture = picture_html(figure, "ROC curve")
    return _told(sentence, picture, outcomes)


def _told(sentence: str, picture: str, outcomes: pd.DataFrame) -> str:
    """Return a sentence above a picture and what became of each target.

    Columns of the table can be read without a manual.
    """
    rows = outcomes[["target_id", "kind", "depth"]].rename(
        columns={"target_id": "target", "depth": "depth (m)"}
    )
    rows["outcome"] = np.where(outcomes["found"], "found", "missed")
    # Of a target that no alarm lies near there is nothing to count.
    rows["false alarms above"] = outcomes["n_false"].where(outcomes["detected"])
    rows["off by (m)"] = outcomes["distance"]
    return f"<p>{html.escape(sentence)}</p>{side_by_side_html(picture, table_html(rows))}"


def picture_html(figure: Figure, text: str) -> str:
    """Return a figure as an image, with the text that stands for it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90, metadata={"Software": None})
    picture = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{picture}">'


def table_html(table: pd.DataFrame) -> str:
    """Return a table, to three digits."""
    return table.to_html(
        index=False, float_format="{:.3g}".format, border=0, justify="left", na_rep="–"
    )


def entries_html(entries: Mapping[str, Any]) -> str:
    """Return a table of two columns, what it is and the value."""
    rows = []
    for name, value in entries.items():
        rows.append(f"<tr><th>{html.escape(name)}</th><td>{html.escape(str(value))}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def side_by_side_html(picture: str, table: str) -> str:
    """Return a picture with a table to the right of it, or below it where the page is narrow."""
    return f'<div style="display:flex;flex-wrap:wrap;gap:2em">{picture}<div>{table}</div></div>'


def draw_detection(detection: Detection, lane: Lane, axes: Axes | None = None) -> tuple[Any, Axes]:
    """Draw the first channel of the run-view, dB below its peak, with the alarms.

    By default into a new figure.
    """
    from matplotlib.figure import Figure

    view = detection.view[0, 0]
    level = np.abs(view.values)
    peak = float(np.nanmax(level, initial=0.0)) or 1.0
    with np.errstate(divide="ignore"):
        decibel = 20 * np.log10(level / peak)
    x = view["x"].values
    y = view["y"].values
    axes = axes or Figure(figsize=(3.5, 5.0), layout="constrained").subplots()
    extent = (float(x[0]), float(x[-1]), float(y[0]), float(y[-1]))
    axes.imshow(decibel, "gray", extent=extent, origin="lower", vmin=-_RANGE, vmax=0)
    alarms = detection.alarms
    axes.plot(alarms["x"], alarms["y"], "o", mfc="none", mec="tab:red", ms=8, label="alarm")
    axes.set(
        xlim=(lane.x_min, lane.x_max),
        ylim=(lane.y_min, lane.y_max),
        xlabel="x cross-track (m)",
        ylabel="y down-track (m)",
    )
    return axes.figure, axes
