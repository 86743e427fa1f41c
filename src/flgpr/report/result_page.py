"""The report on a result: what was found, what became of each target, and what was run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from flgpr.report.figures import channel_figure, geometry_figure, roc_figure, run_view_figure
from flgpr.report.kit import render
from flgpr.results.result import Result
from flgpr.results.score import Score
from flgpr.scoring import pd_mean

_MOST_ALARMS = 500
_COLUMNS = {
    "alarm_id": ("alarm", ""),
    "x": (">x (m)", ".2f"),
    "y": (">y (m)", ".2f"),
    "confidence": (">confidence", ".2f"),
    "magnitude": (">magnitude", ".2f"),
    "scans": (">scans", ".0f"),
    "roadside": (">explained by roadside", ".0%"),
    "label": ("counts as", ""),
}
"""Title and format of each column of the table of alarms."""


def report_html(
    result: Result,
    scored: list[Score] | None = None,
    truth: pd.DataFrame | None = None,
    objects: pd.DataFrame | None = None,
) -> str:
    """Write the report of a result.

    Parameters
    ----------
    result : Result
        A result folder, read.
    scored : list of Score, optional
        Scores; without them the page shows what was found and nothing about truth.
    truth, objects : DataFrame, optional
        Tables to draw.

    Returns
    -------
    str
        HTML that needs nothing beside it.
    """
    main, *others = result.detections
    run = result.manifest["run"]
    masked = [one.name for one in others if "mask_pixels" in one.notes][:1]
    plain = [one.name for one in others if one.name not in masked]
    alarms = scored[0].labels if scored else main.alarms
    columns = [name for name in _COLUMNS if name in alarms]
    values: dict[str, Any] = {
        "views": run_view_figure(result, ["main", *masked], truth, objects),
        "variants": run_view_figure(result, ["main", *plain], truth, objects) if plain else None,
        "channels": channel_figure(result),
        "geometry": geometry_figure(run, result.lane, main.view["looks"], 0.4),
        "columns": [_COLUMNS[name][0] for name in columns],
        "alarms": [
            [format(row[name], _COLUMNS[name][1]) for name in columns]
            for row in alarms[:_MOST_ALARMS].to_dict("records")
        ],
        "scans": run["scans"] - len(run["masked_scans"]),
        "height": np.mean(np.asarray(run["pose"])[:, 2]),
        "libraries": [f"{name} {version}" for name, version in result.manifest["libraries"].items()],
        "recipe": (result.folder / "recipe.toml").read_text(encoding="utf-8"),
    }
    if scored:
        curve = scored[0].curve
        values |= {
            "last": curve.iloc[-1],
            "roc": roc_figure(scored),
            "outcomes": [_outcome_rows(one) for one in scored],
            "roadside": _roadside_shares(scored[0]),
            "pd_mean": pd_mean(curve) if curve.attrs["n_targets"] else None,
            "curve": _curve_rows(curve),
        }
    return render("result.html", result=result, main=main, run=run, lane=result.lane, scored=scored, **values)


def _outcome_rows(one: Score) -> list[list[str]]:
    """Tell of every target whether it was found, and how."""
    rows = []
    for row in one.outcomes.to_dict("records"):
        told = ["missed", "", "", "", ""]
        if row["detected"]:
            told = ["found", f"{row['rank']:d}", f"{row['n_false']:d}", f"{row['distance']:.2f}"]
            told.append(f"({row['dx']:+.2f}, {row['dy']:+.2f})")
        what = f"{row['kind']}, {100 * row['depth']:.1f} cm deep"
        shift = f"{row['expected_shift']:.2f}" if np.isfinite(row["expected_shift"]) else ""
        rows.append([row["target_id"], what, f"({row['x']:.2f}, {row['y']:.2f})", *told, shift])
    return rows


def _roadside_shares(main: Score) -> list[tuple[str, float]]:
    """Take for each target found the share of its alarm's amplitude that the roadside's modelled response explains."""
    alarms = main.detection.alarms
    if "roadside" not in alarms or not main.detection.notes.get("mask_pixels"):
        return []
    found = main.outcomes[main.outcomes["detected"]]
    return [(row["target_id"], float(alarms["roadside"].iloc[row["alarm"]])) for row in found.to_dict("records")]


def _curve_rows(curve: pd.DataFrame) -> list[list[str]]:
    return [
        [
            "all" if np.isinf(row["threshold"]) else f"{row['threshold']:.2f}",
            f"{row['n_detected']:.0f} of {row['n_targets']:.0f}",
            f"{row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f})",
            f"{row['n_false']:.0f}",
            f"{row['far']:.2f} ({row['far_low']:.2f} to {row['far_high']:.2f})",
        ]
        for row in curve.iloc[1:].to_dict("records")
    ]
