"""The report: one self-contained HTML file, and the figures as PNG and PDF for papers."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

import flgpr
from flgpr.scoring.assignment import assign, label_alarms
from flgpr.scoring.bootstrap import band, pd_mean_interval
from flgpr.scoring.breakdown import DEPTH_EDGES, depth_classes, pd_table
from flgpr.scoring.checks import LaneLike
from flgpr.scoring.curve import operating_row, pd_mean
from flgpr.scoring.figures import figure_bytes, patch_figure, roc_figure
from flgpr.scoring.lane_roc import roc_of
from flgpr.scoring.matching import Match, match
from flgpr.scoring.refraction import Refraction
from flgpr.scoring.survey import survey_share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """body{font:15px/1.45 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222;background:#fff}
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.2rem .7rem;border-bottom:1px solid #ccc;text-align:right}
th:first-child,td:first-child,.w{text-align:left}td.w{overflow-wrap:anywhere}img{max-width:100%}h2{margin-top:2rem}.note{color:#555}
@media(max-width:700px){table{display:block;overflow-x:auto}}"""
_NO_FIGURE = ("none", "never", "not known", "inf")
_FIRST_POINTS = (0.005, 0.01, 0.02, 0.05, 0.1)


def write_report(
    folder: str | Path,
    alarms: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    *,
    halo: float = 1.0,
    halo_as: Literal["radius", "diameter"] = "radius",
    area: Literal["union", "paper"] = "union",
    far: float = 0.01,
    far_max: float = 0.1,
    draws: int = 1000,
    seed: int = 0,
    level: float = 0.95,
    worst: int = 12,
    alarm_patches: Mapping[Any, ArrayLike] | None = None,
    target_patches: Mapping[Any, ArrayLike] | None = None,
    refraction: Refraction | None = None,
    survey_error: float | None = None,
    title: str = "Detection report",
    notes: Mapping[str, Any] | None = None,
) -> dict[str, Path]:
    """Score an alarm list and write the report.

    Parameters
    ----------
    folder : str or Path
        Where to write; made if missing, files of the same names are replaced.
    alarms, truth, lane, halo, halo_as, area, refraction, survey_error
        As for :func:`flgpr.scoring.roc`.
    far : float
        Operating point at which targets count as missed and Pd is broken down, per m².
    far_max : float
        End of the FAR axis and of the averaging of PD_mean, per m².
    draws, seed, level
        Of the bootstrap bands and all intervals.
    worst : int
        Number of missed targets and of false alarms shown with patches.
    alarm_patches : mapping, optional
        Image patches (y, x) by ``alarm_id`` or, without that column, by row number of the alarm table.
    target_patches : mapping, optional
        Image patches (y, x) by ``target_id``.
    title : str
        Heading.
    notes : mapping, optional
        Provenance to print: recipe, hashes, seeds.

    Returns
    -------
    dict of str to Path
        The files: ``html``, ``json``, and ``roc``, ``kind``, ``depth`` figures as ``..._png`` and ``..._pdf``.

    Raises
    ------
    ValueError
        As :func:`flgpr.scoring.roc`.
    """
    matched = match(alarms, truth, lane, halo, halo_as=halo_as, refraction=refraction)
    curve = roc_of(matched, area=area, level=level)
    figures = _figures(matched, curve, far_max, {"area": area, "level": level, "draws": draws, "seed": seed})
    summary: dict[str, Any] = {
        **{str(name): value for name, value in curve.attrs.items()},
        "version": flgpr.__version__,
        "bootstrap": {"draws": draws, "seed": seed},
        **({} if survey_error is None else {"survey_error": vars(survey_share(survey_error, matched.halo))}),
        **dict(notes or {}),
    }
    if len(matched.truth):
        low, high = pd_mean_interval(matched, far_max, area=area, level=level, draws=draws, seed=seed)
        summary["pd_mean"] = {"value": pd_mean(curve, far_max), "low": low, "high": high, "far_max": far_max}
    body = [
        f"<h1>{html.escape(title)}</h1>",
        _heading(curve, summary, far_max),
        *(_image(figure, f"ROC: {name}") for name, figure in figures.items()),
        _points_table(curve, far_max),
        _breakdown(matched, far, area, level),
        _missed(matched, far, area, worst, target_patches or {}),
        _false_alarms(matched, curve, worst, alarm_patches or {}),
        "<h2>How it was scored</h2>" + _listing(summary),
    ]
    told = json.dumps({**summary, "points": curve_points(curve)}, indent=1, allow_nan=False, default=str)
    content = {"html": ("report.html", _page(title, "\n".join(body)).encode()), "json": ("roc.json", told.encode())}
    for name, figure in figures.items():
        for kind in ("png", "pdf"):
            content[f"{name}_{kind}"] = (f"{name}.{kind}", figure_bytes(figure, kind))
    return _write_all(Path(folder), content)


def _write_all(folder: Path, content: Mapping[str, tuple[str, bytes]]) -> dict[str, Path]:
    """Write files once all of them are made, so that an error leaves nothing behind."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {key: folder / name for key, (name, _) in content.items()}
    for key, (_, data) in content.items():
        paths[key].write_bytes(data)
    return paths


def curve_points(curve: pd.DataFrame) -> list[dict[str, float | int | None]]:
    """Turn a curve into plain values that JSON can hold.

    Parameters
    ----------
    curve : DataFrame
        ROC table.

    Returns
    -------
    list of dict
        One per row; infinite and unknown values are None.
    """
    rows = curve.drop(columns=["n_targets", "area"], errors="ignore").to_dict("records")
    return [{str(name): value if math.isfinite(value) else None for name, value in row.items()} for row in rows]


def _figures(matched: Match, curve: pd.DataFrame, far_max: float, options: dict[str, Any]) -> dict[str, Figure]:
    """Draw all targets with their band, and the subsets by kind and by depth."""
    if len(matched.truth) == 0:
        return {"roc": roc_figure({"no targets": curve}, None, far_max)}
    grid = np.linspace(0, far_max, 101)
    whole = band(matched, None, grid, **options)
    sure = f"{100 * options['level']:g} % simultaneous bands"
    figures = {"roc": roc_figure({"all": curve}, {"all": whole}, far_max, f"All targets, {sure}")}
    kinds = sorted(map(str, matched.truth["kind"].unique()))
    by_kind = {kind: (matched.truth["kind"].astype(str) == kind).to_numpy() for kind in kinds}
    depth = depth_classes(matched.truth["depth"], DEPTH_EDGES)
    by_depth = {str(name): (depth == name).to_numpy() for name in depth.cat.categories}
    for name, groups in (("kind", by_kind), ("depth", by_depth)):
        curves = {label: roc_of(matched, chosen, area=options["area"]) for label, chosen in groups.items()}
        if curves:
            bands = {label: band(matched, chosen, grid, **options) for label, chosen in groups.items()}
            figures[name] = roc_figure(curves, bands, far_max, f"By {name}, {sure}")
    return figures


def _heading(curve: pd.DataFrame, summary: Mapping[str, Any], far_max: float) -> str:
    mean = summary.get("pd_mean")
    level = 100 * float(curve.attrs["level"])
    known = "" if mean is None else (
        f"Mean Pd up to {far_max:g} per m²: <b>{mean['value']:.3f}</b> ({level:g} % interval {mean['low']:.3f} to "
        f"{mean['high']:.3f}). "
    )  # fmt: skip
    error = summary.get("survey_error")
    lost = "" if error is None else f"{error['lost']:.3f}" if error["lost"] >= 0.001 else "under 0.001"
    survey = "" if error is None else (
        f" Survey error {error['sigma']:g} m per axis, {100 * error['share']:.0f} % of the halo; an alarm right on a "
        f"target is lost to it with probability {lost}."
    )  # fmt: skip
    return (
        f"<p>{known}{curve.attrs['n_targets']} targets, {curve.attrs['n_alarms']} alarms, of which "
        f"{int(curve['n_false'].iloc[-1])} false, on {curve.attrs['area']:.1f} m².</p>"
        f"<p class=note>Convention: {html.escape(curve.attrs['source'])}; FAR is {html.escape(curve.attrs['far_is'])} "
        f"(rule {html.escape(curve.attrs['area_rule'])}); halo radius {curve.attrs['halo_radius']:g} m; refraction "
        f"correction: {html.escape(curve.attrs['refraction'])}.{survey}</p>"
    )


def _points_table(curve: pd.DataFrame, far_max: float) -> str:
    rows = []
    for allowed in sorted({*(far for far in _FIRST_POINTS if far <= far_max), far_max}):
        point = curve.iloc[int(operating_row(curve, allowed))]
        rows.append(
            {
                "allowed FAR (per m²)": f"{allowed:g}",
                "threshold": f"{point['threshold']:.5g}",
                "Pd": f"{point['pd']:.3f}",
                "Pd interval": f"{point['pd_low']:.3f} to {point['pd_high']:.3f}",
                "found": f"{point['n_detected']:.0f} of {point['n_targets']:.0f}",
                "FAR (per m²)": f"{point['far']:.4f}",
                "FAR interval": f"{point['far_low']:.4f} to {point['far_high']:.4f}",
                "false alarms": f"{point['n_false']:.0f}",
            }
        )
    level = 100 * float(curve.attrs["level"])
    return f"<h2>Operating points</h2>{_table(rows)}<p class=note>Exact {level:g} % intervals, point by point.</p>"


def _breakdown(matched: Match, far: float, area: Literal["union", "paper"], level: float) -> str:
    if len(matched.truth) == 0:
        return ""
    table = pd_table(matched, far, area=area, level=level)
    names = [name for name in ("kind", "depth", "soil") if name in table.columns]
    rows = [
        {
            **{name: _known(row[name]) for name in names},
            "found": f"{row['n_detected']} of {row['n_targets']}",
            "Pd": f"{row['pd']:.3f}",
            "Pd interval": f"{row['pd_low']:.3f} to {row['pd_high']:.3f}",
        }
        for row in table.to_dict("records")
    ]
    return f"<h2>Pd by {', '.join(names)} at {far:g} false alarms per m²</h2>{_table(rows)}"


def _missed(
    matched: Match, far: float, area: Literal["union", "paper"], worst: int, patches: Mapping[Any, ArrayLike]
) -> str:
    table = assign(matched, area)
    missed = table[table["far"] > far].sort_values("far", ascending=False, kind="stable")
    rows = [
        {
            "target": str(row["target_id"]),
            "kind": str(row["kind"]),
            "depth (cm)": _known(100 * row["depth"]),
            "x, y (m)": f"{row['x']:.2f}, {row['y']:.2f}",
            "best alarm off by (m)": f"{row['distance']:.2f}" if row["detected"] else "none",
            "found at FAR (per m²)": f"{row['far']:.4f}" if row["detected"] else "never",
        }
        for row in missed.to_dict("records")
    ]
    shown = [name for name in missed["target_id"] if name in patches][:worst]
    text = f"<h2>Missed targets at {far:g} false alarms per m²: {len(missed)}</h2>"
    images = _patches([patches[name] for name in shown], [str(name) for name in shown], "missed targets")
    return text + (_table(rows) if rows else "<p>None.</p>") + images


def _false_alarms(matched: Match, curve: pd.DataFrame, worst: int, patches: Mapping[Any, ArrayLike]) -> str:
    labels = label_alarms(matched)
    false = labels[labels["label"] == "false"].sort_values("confidence", ascending=False, kind="stable").head(worst)
    keys = list(false["alarm_id"]) if "alarm_id" in false.columns else list(false.index)
    detected = np.append(curve["n_detected"].to_numpy(), 0)
    rows = [
        {
            "alarm": str(key),
            "x, y (m)": f"{row['x']:.2f}, {row['y']:.2f}",
            "confidence": f"{row['confidence']:.5g}",
            "targets found above it": f"{detected[int((curve['threshold'] > row['confidence']).sum()) - 1]}",
        }
        for key, row in zip(keys, false.to_dict("records"), strict=True)
    ]
    shown = [key for key in keys if key in patches]
    images = _patches([patches[key] for key in shown], [str(key) for key in shown], "worst false alarms")
    return f"<h2>Worst false alarms</h2>{_table(rows) if rows else '<p>None.</p>'}{images}"


def _patches(patches: Sequence[ArrayLike], labels: Sequence[str], name: str) -> str:
    return _image(patch_figure(patches, labels), name) if len(patches) else ""


def _image(figure: Figure, name: str) -> str:
    data = base64.b64encode(figure_bytes(figure)).decode()
    return f'<p><img alt="{html.escape(name)}" src="data:image/png;base64,{data}"></p>'


def _table(rows: Sequence[Mapping[str, str]]) -> str:
    """Lay out a table; columns of words stand to the left, of figures to the right."""
    words = {name for row in rows for name, value in row.items() if value[:1].isalpha() and value not in _NO_FIGURE}
    mark = {name: " class=w" if name in words else "" for name in rows[0]}
    head = "".join(f"<th{mark[name]}>{html.escape(name)}</th>" for name in rows[0])
    lines = ["".join(f"<td{mark[name]}>{html.escape(value)}</td>" for name, value in row.items()) for row in rows]
    return f"<table><tr>{head}</tr>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


def _listing(summary: Mapping[str, Any]) -> str:
    return _table([{"what": str(name), "value": _in_words(value)} for name, value in summary.items()])


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_in_words(entry)}" for name, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_in_words(entry) for entry in value) or "unnamed"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _known(value: Any) -> str:
    if pd.isna(value):
        return "not known"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _page(title: str, body: str) -> str:
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head>\n<body>{body}</body></html>\n"
    )
