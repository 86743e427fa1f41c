"""The report on a result, on its score, or on the score of any alarm list: one page, and the figures for papers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from flgpr.report.figures import channel_figure, geometry_figure, run_view_figure, whole_roc_figure
from flgpr.report.kit import render
from flgpr.results.description import left_out_scans, plausible_poses
from flgpr.results.result import Result
from flgpr.results.score import roc_json
from flgpr.scoring import Rules, Score, score
from flgpr.store import write_whole
from flgpr.trials import figure_bytes, patch_figure, roc_figure

if TYPE_CHECKING:
    from flgpr.scoring.matching import LaneLike

_MOST = 500  # so many rows of alarms and of a curve are shown
_FORMATS = ("png", "pdf")
_COLUMNS = {
    "lane": ("lane", ""),
    "alarm_id": ("alarm", ""),
    "x": (">x (m)", ".2f"),
    "y": (">y (m)", ".2f"),
    "confidence": (">confidence", ""),
    "magnitude": (">magnitude", ".2f"),
    "scans": (">scans", ".0f"),
    "roadside": (">explained by roadside", ".0%"),
    "label": ("counts as", ""),
}
"""Title and format of each column of the table of alarms."""
_POINT = (
    "{far_allowed:.4g}", "{n_detected:.0f} of {n_targets:.0f}", "{pd:.3f}", "{pd_low:.3f} to {pd_high:.3f}", "{chance}",
    "{n_false:.0f}", "{far:.4f}", "{far_low:.4f} to {far_high:.4f}", "{threshold:.5g}",
)  # fmt: skip
_CURVE = (
    "{threshold:.5g}", "{n_detected:.0f} of {n_targets:.0f}", "{pd:.2f} ({pd_low:.2f} to {pd_high:.2f})", "{chance}",
    "{n_false:.0f}", "{far:.3g} ({far_low:.3g} to {far_high:.3g})",
)  # fmt: skip
_GROUP = ("{n_detected} of {n_targets}", "{pd:.3f}", "{pd_low:.3f} to {pd_high:.3f}", "{chance}")
_MISSED = ("{target_id}", "{kind}", "{deep}", "{x:.2f}, {y:.2f}", "{off}", "{at}")
_FALSE = ("{key}", "{x:.2f}, {y:.2f}", "{confidence:.5g}", "{found_above}")


def write_score_report(
    folder: str | Path,
    alarms: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    *,
    worst: int = 12,
    alarm_patches: Mapping[Any, ArrayLike] | None = None,
    target_patches: Mapping[Any, ArrayLike] | None = None,
    title: str = "Detection report",
    notes: Mapping[str, Any] | None = None,
    **rules: Any,
) -> dict[str, Path]:
    """Score an alarm list and write the report; give its files: ``html``, ``json``, figures as ``roc_png`` and so on.

    Alarms, truth, lane and rules are as for :func:`flgpr.scoring.score` and :class:`flgpr.scoring.Rules`. ``worst`` is
    how many missed targets and false alarms are shown with their image patches (y, x), by ``target_id``, and by
    ``alarm_id`` or, without that column, row number. ``notes`` are provenance to print. Files of the same names are
    replaced.
    """
    scored = [score(alarms, truth, lane, Rules(**rules))]
    patches = {"alarm_patches": alarm_patches or {}, "target_patches": target_patches or {}}
    content = score_files(scored, notes or {}, title=title, worst=worst, **patches)
    home = Path(folder)
    home.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        write_whole(home / name, data)
    keys = {"report.html": "html", "roc.json": "json"}
    return {keys.get(name, name.replace(".", "_")): home / name for name in content}


def score_files(
    scored: Sequence[Score], notes: Mapping[str, Any], **page: Any
) -> dict[str, str | bytes]:
    """Make the files of a score, by name: page, ``roc.json`` and figures; ``page`` as for :func:`report_html`."""
    figures = _figures(scored[0])
    pictures = {
        name: {kind: figure_bytes(one, kind) for kind in _FORMATS} for name, one in figures.items()
    }
    shown = {name: kinds["png"] for name, kinds in pictures.items()}
    return {
        "report.html": report_html(scored=scored, notes=notes, bands=shown, **page),
        "roc.json": roc_json(scored, notes),
        **{
            f"{name}.{kind}": data
            for name, kinds in pictures.items()
            for kind, data in kinds.items()
        },
    }


def report_html(
    result: Result | None = None,
    scored: Sequence[Score] = (),
    objects: pd.DataFrame | None = None,
    *,
    title: str = "",
    notes: Mapping[str, Any] | None = None,
    bands: Mapping[str, bytes] | None = None,
    sections: Mapping[str, str] | None = None,
    worst: int = 12,
    alarm_patches: Mapping[Any, ArrayLike] | None = None,
    target_patches: Mapping[Any, ArrayLike] | None = None,
) -> str:
    """Write the report of a result, of its scores in the order of its detections, or of scores alone.

    ``bands`` are curves as PNG by name, ``sections`` the addresses of the pages of a lane's sections ("" for none); the
    rest is as for :func:`write_score_report`, and ``objects`` are drawn.
    """
    values: dict[str, Any] = {
        "result": result,
        "scored": scored,
        "title": title,
        "sections": sections,
    }
    if result is not None:
        values |= _found(result, scored[0].matched.truth if scored else None, objects)
    if scored:
        values |= _scored(scored, worst, alarm_patches or {}, target_patches or {})
        values["roadside"] = _roadside_shares(scored[0], values.get("notes", {}))
        values |= {
            "bands": bands or {},
            "told": {**scored[0].told_rules(), **(notes or {})},
            "in_words": in_words,
        }
    alarms = (
        scored[0].labels if scored else result.detections[0].alarms if result else pd.DataFrame()
    )
    columns = [name for name in _COLUMNS if name in alarms]
    rows = alarms[:_MOST].to_dict("records")
    values["n_alarms"] = len(alarms)
    values["columns"] = [_COLUMNS[name][0] for name in columns]
    values["alarms"] = [[_plain(row[name], _COLUMNS[name][1]) for name in columns] for row in rows]
    return render("report.html", **values)


def _found(
    result: Result, truth: pd.DataFrame | None, objects: pd.DataFrame | None
) -> dict[str, Any]:
    """Draw what was found, and tell what was run."""
    main, *others = result.detections
    run = result.manifest["run"]
    masked = [one.name for one in others if "mask_pixels" in one.notes][:1]
    plain = [one.name for one in others if one.name not in masked]
    return {
        "run": run,
        "lane": result.lane,
        "views": run_view_figure(result, ["main", *masked], truth, objects),
        "variants": run_view_figure(result, ["main", *plain], truth, objects) if plain else None,
        "channels": channel_figure(result),
        "geometry": geometry_figure(run, result.lane, main.view["looks"], 0.4),
        "scans": run["scans"] - len(left_out_scans(run)),
        "height": np.mean(plausible_poses(run)[:, 2]),
        "libraries": [
            f"{name} {version}" for name, version in result.manifest["libraries"].items()
        ],
        "notes": {one.name: one.notes for one in result.detections},
    }


def _scored(
    scored: Sequence[Score],
    worst: int,
    alarm_patches: Mapping[Any, ArrayLike],
    target_patches: Mapping[Any, ArrayLike],
) -> dict[str, Any]:
    """Lay out what became of targets and alarms."""
    main = scored[0]
    missed = main.missed()
    false = main.worst_false_alarms(worst)
    groups = main.breakdown()
    missed["deep"] = [_plain(100 * depth) for depth in missed["depth"]]
    missed["off"] = [
        f"{off:.2f}" if found else "none"
        for off, found in missed[["distance", "detected"]].to_numpy()
    ]
    missed["at"] = [
        f"{far:.4f}" if found else "never" for far, found in missed[["far", "detected"]].to_numpy()
    ]
    false["key"] = false["alarm_id"] if "alarm_id" in false.columns else false.index
    by = [name for name in ("kind", "depth", "soil") if name in groups.columns]
    none = not len(main.matched.truth)
    groups[by] = groups[by].map(_plain)
    return {
        "last": main.curve.iloc[-1],
        "attrs": main.curve.attrs,
        "main": main,
        "rules": main.rules,
        "pd_mean": main.pd_mean,
        "mean_by_chance": _plain(main.pd_mean["chance"], ".3f") if main.pd_mean else "",
        "last_by_chance": _plain(main.curve["chance"].iloc[-1], ".2f"),
        "survey": main.survey,
        "roc": whole_roc_figure(scored),
        "outcomes": [_outcome_rows(one) for one in scored],
        "shifts": _knows_shifts(main),
        "points": _rows(main.operating_points(), _POINT, none),
        "curve": _rows(main.curve.iloc[1:][:_MOST], _CURVE, none),
        "n_points": len(main.curve) - 1,
        "by": by,
        "breakdown": _rows(groups, (*(f"{{{name}}}" for name in by), *_GROUP)),
        "missed": _rows(missed, _MISSED),
        "missed_patches": _patches(
            [k for k in missed["target_id"] if k in target_patches][:worst], target_patches
        ),
        "false_alarms": _rows(false, _FALSE),
        "false_patches": _patches(
            [key for key in false["key"] if key in alarm_patches], alarm_patches
        ),
    }


def _rows(table: pd.DataFrame, cells: Sequence[str], nothing: bool = False) -> list[list[str]]:
    """Write every row of a table by the formats of its cells; those of a Pd say ``none`` where there is nothing."""
    said = ["none" if nothing and ("{pd" in cell or "{chance" in cell) else cell for cell in cells]
    if "chance" in table:
        table = table.assign(chance=[_plain(level, ".3f") for level in table["chance"]])
    return [[cell.format_map(row) for cell in said] for row in table.to_dict("records")]


def _figures(main: Score) -> dict[str, Any]:
    """Draw all targets with their band, and the subsets by kind and by depth."""
    far_max = main.rules.far_max
    if not len(main.matched.truth):
        return {"roc": roc_figure({"no targets": main.curve}, None, far_max)}
    sure = f"{100 * main.rules.level:g} % simultaneous bands"
    groups = {"roc": ("All targets", main.bands()), "kind": ("By kind", main.bands("kind"))}
    groups["depth"] = ("By depth", main.bands("depth"))
    return {
        name: roc_figure(
            {label: curve for label, (curve, _) in each.items()},
            {label: band for label, (_, band) in each.items()},
            far_max,
            f"{title}, {sure}",
        )
        for name, (title, each) in groups.items()
        if each
    }


def _outcome_rows(one: Score) -> list[list[str]]:
    """Tell of every target whether it is found at the operating point, at which FAR it is first seen, and how."""
    rows = []
    for row in one.outcomes.to_dict("records"):
        told = ["found" if row["found"] else "missed", "never", "", "", "", ""]
        if row["detected"]:
            told[1:] = [
                f"{row['far']:.3g}",
                f"{row['rank']:d}",
                f"{row['n_false']:d}",
                f"{row['distance']:.2f}",
            ]
            told.append(f"({row['dx']:+.2f}, {row['dy']:+.2f})")
        deep = "depth not known" if np.isnan(row["depth"]) else f"{100 * row['depth']:.1f} cm"
        cells = [
            row["target_id"],
            f"{row['kind']}, {deep}",
            f"({row['x']:.2f}, {row['y']:.2f})",
            *told,
        ]
        if _knows_shifts(one):
            cells.append(
                f"{row['expected_shift']:.2f}" if np.isfinite(row["expected_shift"]) else ""
            )
        rows.append(cells)
    return rows


def _knows_shifts(one: Score) -> bool:
    return "expected_shift" in one.outcomes and bool(one.outcomes["expected_shift"].notna().any())


def _roadside_shares(main: Score, notes: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Take for each target found the share of its alarm's amplitude that the roadside's modelled response explains."""
    if "roadside" not in main.labels or not notes.get(main.name, {}).get("mask_pixels"):
        return []
    found = main.outcomes[main.outcomes["detected"]]
    return [
        (row["target_id"], float(main.labels["roadside"].iloc[row["alarm"]]))
        for row in found.to_dict("records")
    ]


def _patches(keys: Sequence[Any], patches: Mapping[Any, ArrayLike]) -> Any:
    return (
        patch_figure([patches[key] for key in keys], [str(key) for key in keys]) if keys else None
    )


def _plain(value: Any, spec: str = "") -> str:
    """Say a value of a table, rounded where it is a number."""
    if pd.isna(value):
        return "not known"
    return format(value, spec or (".5g" if isinstance(value, float) else ""))


def in_words(value: Any) -> str:
    """Say a value of the rules, nested or not, as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {in_words(entry)}" for name, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(in_words(entry) for entry in value) or "unnamed"
    return f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else str(value)
