"""The report on a result, on its score, or on the score of any alarm list.

One page, and the figures for papers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from flgpr.report.curve_figures import figure_bytes, patch_figure, roc_figure
from flgpr.report.figures import (
    channel_figure,
    complete_roc_figure,
    geometry_figure,
    run_view_figure,
)
from flgpr.report.kit import render, table_rows
from flgpr.report.overview import (
    alarm_overview,
    before_and_after,
    is_short,
    places_that_stand_out,
    score_overview,
)
from flgpr.report.trial_block import score_block
from flgpr.results.description import left_out_scans, plausible_poses
from flgpr.results.result import Result
from flgpr.results.score import roc_json
from flgpr.scoring import Rules, Score, score
from flgpr.store import write_whole
from flgpr.types import Entries

if TYPE_CHECKING:
    from flgpr.scoring.matching import LaneLike

_MOST_ROWS = 500  # of alarms and of a curve that are shown
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
    "{far_allowed:.4g}",
    "{n_detected:.0f} of {n_targets:.0f}",
    "{pd:.3f}",
    "{pd_low:.3f} to {pd_high:.3f}",
    "{chance:.3f}",
    "{n_false:.0f}",
    "{far:.4f}",
    "{far_low:.4f} to {far_high:.4f}",
    "{threshold:.5g}",
)
_CURVE = (
    "{threshold:.5g}",
    "{n_detected:.0f} of {n_targets:.0f}",
    "{pd:.2f} ({pd_low:.2f} to {pd_high:.2f})",
    "{chance:.3f}",
    "{n_false:.0f}",
    "{far:.3g} ({far_low:.3g} to {far_high:.3g})",
)
_GROUP = (
    "{n_detected} of {n_targets}",
    "{pd:.3f}",
    "{pd_low:.3f} to {pd_high:.3f}",
    "{chance:.3f}",
)
_MISSED = ("{target_id}", "{kind}", "{cm}", "{x:.2f}, {y:.2f}", "{off_by}", "{first_seen}")
_FALSE = ("{key}", "{x:.2f}, {y:.2f}", "{confidence}", "{found_above}")
_TARGET = ("{target_id}", "{kind}, {deep}", "({x:.2f}, {y:.2f})", "{outcome}")
_SEEN = ("{far:.3g}", "{rank:d}", "{n_false:d}", "{distance:.2f}", "({dx:+.2f}, {dy:+.2f})")
_NEVER = ("never", "", "", "", "")


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
    """Score an alarm list, write the report and return its files.

    Files of the same names are replaced.

    Parameters
    ----------
    folder : path
        Folder to write to; it is made if need be.
    alarms, truth, lane
        As for :func:`flgpr.scoring.score`.
    worst : int
        Missed targets and false alarms that are shown with their image patches.
    alarm_patches : mapping, optional
        Image patches (y, x) by ``alarm_id``, or by row number without that column.
    target_patches : mapping, optional
        Image patches (y, x) by ``target_id``.
    title : str
        Title of the page.
    notes : mapping, optional
        Provenance to print.
    **rules
        As for :class:`flgpr.scoring.Rules`.

    Returns
    -------
    dict of str to Path
        ``html``, ``json``, and figures as ``roc_png`` and so on.
    """
    scored = [score(alarms, truth, lane, Rules(**rules))]
    content = score_files(
        scored,
        notes or {},
        title=title,
        worst=worst,
        alarm_patches=alarm_patches,
        target_patches=target_patches,
    )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    keys = {"report.html": "html", "roc.json": "json"}
    paths = {}
    for name, data in content.items():
        write_whole(folder / name, data)
        paths[keys.get(name, name.replace(".", "_"))] = folder / name
    return paths


def score_files(
    scored: Sequence[Score], notes: Mapping[str, Any], **page: Any
) -> dict[str, str | bytes]:
    """Return the files of a score by name: the page, ``roc.json`` and figures.

    Parameters
    ----------
    scored : sequence of Score
        Scores of the detections, the main one first.
    notes : mapping
        Provenance to print.
    **page
        As for :func:`report_html`.

    Returns
    -------
    dict of str to str or bytes
        Content of each file.
    """
    curves = {}
    figures: dict[str, str | bytes] = {}
    for name, figure in _roc_figures(scored[0]).items():
        curves[name] = figures[f"{name}.png"] = figure_bytes(figure)
        figures[f"{name}.pdf"] = figure_bytes(figure, "pdf")
    files: dict[str, str | bytes] = {
        "report.html": report_html(scored=scored, notes=notes, bands=curves, **page),
        "roc.json": roc_json(scored, notes),
    }
    return files | figures


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
    """Return the report of a result, of its scores, or of scores alone.

    Parameters
    ----------
    result : Result, optional
        The result; without one the page is of the scores alone.
    scored : sequence of Score
        Scores in the order of the result's detections; empty where there is no truth.
    objects : pandas.DataFrame, optional
        Other objects on the lane, which are drawn.
    title : str
        Title of the page, where there is no result.
    notes : mapping, optional
        Provenance to print.
    bands : mapping, optional
        Curves with their bands as PNG, by name.
    sections : mapping, optional
        Addresses of the pages of a lane's sections; "" for none.
    worst, alarm_patches, target_patches
        As for :func:`write_score_report`.

    Returns
    -------
    str
        The page, HTML without references to other files but the pages of sections.
    """
    values: Entries = {
        "result": result,
        "scored": scored,
        "title": title,
        "sections": sections,
        "overview": None,
        "swipe": None,
        "side_by_side": False,
    }
    alarms = pd.DataFrame()
    if result is not None:
        truth = scored[0].matched.truth if scored else None
        values |= _result_values(result, truth, objects)
        alarms = result.alarms
        if not scored:
            values["standing"] = places_that_stand_out(result)
            border = values["run"].get("stands_out", {}).get("border")
            values["overview"] = alarm_overview(result.lane, alarms, border)
    if scored:
        main = scored[0]
        provenance = notes or {}
        scored_name = title
        if result is not None and not title:
            scored_name = str(values["run"].get("title", ""))
        values |= _score_values(scored, worst, alarm_patches or {}, target_patches or {})
        values["overview"] = score_overview(main, objects)
        values["roadside"] = _roadside_shares(main, values.get("notes", {}))
        values["bands"] = bands or {}
        values["provenance"] = {**main.rules_summary(), **provenance}
        values["trial"] = score_block(main, provenance, scored_name or "alarm list")
        alarms = main.labels
    columns = {name: told for name, told in _COLUMNS.items() if name in alarms}
    values["n_alarms"] = len(alarms)
    values["columns"] = [title for title, _ in columns.values()]
    cells = [f"{{{name}:{spec}}}" for name, (_, spec) in columns.items()]
    values["alarms"] = table_rows(alarms[:_MOST_ROWS], cells)
    return render("report.html", **values)


def _result_values(
    result: Result, truth: pd.DataFrame | None, objects: pd.DataFrame | None
) -> Entries:
    """Return the template's values for a result: its run and figures."""
    main, *variants = result.detections
    run = result.manifest["run"]
    masked = [variant.name for variant in variants if "mask_pixels" in variant.notes][:1]
    unmasked = [variant.name for variant in variants if variant.name not in masked]
    other_views = None
    if unmasked:
        other_views = run_view_figure(result, ["main", *unmasked], truth, objects)
    libraries = result.manifest["libraries"]
    return {
        "run": run,
        "lane": result.lane,
        "swipe": before_and_after(result),
        "side_by_side": is_short(result.lane),
        "views": run_view_figure(result, ["main", *masked], truth, objects),
        "variants": other_views,
        "channels": channel_figure(result),
        "geometry": geometry_figure(run, result.lane, main.view["looks"], 0.4),
        "scans": run["scans"] - len(left_out_scans(run)),
        "height": np.mean(plausible_poses(run)[:, 2]),
        "libraries": [f"{name} {version}" for name, version in libraries.items()],
        "notes": {detection.name: detection.notes for detection in result.detections},
    }


def _score_values(
    scored: Sequence[Score],
    worst: int,
    alarm_patches: Mapping[Any, ArrayLike],
    target_patches: Mapping[Any, ArrayLike],
) -> Entries:
    """Return the template's values for what became of targets and alarms."""
    main = scored[0]
    missed = main.missed()
    is_seen = missed["detected"]
    missed["cm"] = 100 * missed["depth"]
    missed["off_by"] = missed["distance"].map("{:.2f}".format).where(is_seen, "none")
    missed["first_seen"] = missed["far"].map("{:.4f}".format).where(is_seen, "never")
    false = main.worst_false_alarms(worst)
    # Lists without names of alarms have their patches by row number.
    false["key"] = false["alarm_id"] if "alarm_id" in false.columns else false.index
    groups = main.breakdown()
    by = [name for name in ("kind", "depth", "soil") if name in groups.columns]
    missed_keys = [key for key in missed["target_id"] if key in target_patches][:worst]
    false_keys = [key for key in false["key"] if key in alarm_patches]
    has_targets = bool(len(main.matched.truth))
    return {
        "last": main.curve.iloc[-1],
        "main": main,
        "rules": main.rules,
        "roc": complete_roc_figure(scored),
        "outcomes": [_outcome_rows(detection) for detection in scored],
        "shifts": _knows_shifts(main),
        "points": table_rows(main.operating_points(), _cells(_POINT, has_targets)),
        "curve": table_rows(main.curve.iloc[1:][:_MOST_ROWS], _cells(_CURVE, has_targets)),
        "n_points": len(main.curve) - 1,
        "by": by,
        "breakdown": table_rows(groups, (*[f"{{{name}}}" for name in by], *_GROUP)),
        "missed": table_rows(missed, _MISSED),
        "missed_patches": _patches(missed_keys, target_patches),
        "false_alarms": table_rows(false, _FALSE),
        "false_patches": _patches(false_keys, alarm_patches),
    }


def _cells(cells: Sequence[str], has_targets: bool) -> list[str]:
    """Return the formats of a table of points; without targets Pd and chance are "none"."""
    return [
        cell if has_targets or not ("{pd" in cell or "{chance" in cell) else "none"
        for cell in cells
    ]


def _roc_figures(main: Score) -> Entries:
    """Return the curves of all targets with their band, and of the subsets by kind and by depth."""
    far_max = main.rules.far_max
    if not len(main.matched.truth):
        return {"roc": roc_figure({"no targets": main.curve}, None, far_max)}
    level = f"{100 * main.rules.level:g} % simultaneous bands"
    groups = {
        "roc": ("All targets", main.bands()),
        "kind": ("By kind", main.bands("kind")),
        "depth": ("By depth", main.bands("depth")),
    }
    figures = {}
    for name, (title, curves_and_bands) in groups.items():
        if not curves_and_bands:
            continue
        curves = {label: curve for label, (curve, _) in curves_and_bands.items()}
        bands = {label: band for label, (_, band) in curves_and_bands.items()}
        figures[name] = roc_figure(curves, bands, far_max, f"{title}, {level}")
    return figures


def _outcome_rows(scored: Score) -> list[list[str]]:
    """Return a row per target: its place, and whether and how it is found."""
    outcomes = scored.outcomes
    deep = (100 * outcomes["depth"]).map("{:.1f} cm".format)
    outcomes = outcomes.assign(
        deep=deep.where(outcomes["depth"].notna(), "depth not known"),
        outcome=outcomes["found"].map({True: "found", False: "missed"}),
    )
    shift: tuple[str, ...] = ()
    if _knows_shifts(scored):
        shift = ("{shift}",)
        texts = outcomes["expected_shift"].map("{:.2f}".format)
        outcomes["shift"] = texts.where(np.isfinite(outcomes["expected_shift"]), "")
    rows = []
    for index, is_seen in enumerate(outcomes["detected"]):
        seen = _SEEN if is_seen else _NEVER
        rows += table_rows(outcomes.iloc[[index]], (*_TARGET, *seen, *shift))
    return rows


def _knows_shifts(scored: Score) -> bool:
    """Return whether the shift by refraction is known of any target."""
    if "expected_shift" not in scored.outcomes:
        return False
    return bool(scored.outcomes["expected_shift"].notna().any())


def _roadside_shares(main: Score, notes: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return for each target found the share of its alarm's amplitude that the roadside explains.

    The share is that of the roadside's modelled response; the list is empty where it was not
    computed.
    """
    if "roadside" not in main.labels or not notes.get(main.name, {}).get("mask_pixels"):
        return []
    shares = []
    for target in main.outcomes[main.outcomes["detected"]].to_dict("records"):
        share = float(main.labels["roadside"].iloc[target["alarm"]])
        shares.append((target["target_id"], share))
    return shares


def _patches(keys: Sequence[Any], patches: Mapping[Any, ArrayLike]) -> Any:
    """Return a figure of image patches; None where there are none."""
    if not keys:
        return None
    return patch_figure([patches[key] for key in keys], [str(key) for key in keys])
