"""The report: one self-contained HTML page per result."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
import pandas as pd

from flgpr.pipeline.figures import channel_figure, data_url, geometry_figure, roc_figure, run_view_figure
from flgpr.pipeline.html import html_image, html_page, html_table
from flgpr.pipeline.result import Result
from flgpr.pipeline.score import Score
from flgpr.scoring import pd_mean

_MOST_ALARMS = 500


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
    main, variants = result.detections[0], result.detections[1:]
    run = result.manifest["run"]
    pairs = ["main", *[one.name for one in variants if "mask_pixels" in one.notes][:1]]
    others = ["main", *[one.name for one in variants if one.name not in pairs]]
    parts = [
        f"<h1>{escape(run['title'])}: {len(main.alarms)} alarms</h1>",
        f"<p class=lead>{escape(_summary(result, scored))}</p>",
        html_image(data_url(run_view_figure(result, pairs, truth, objects)), "run-view with alarms"),
    ]
    if scored is not None:
        parts += ["<h2>What became of each target</h2>", *[_outcomes(one) for one in scored], *_remarks(scored)]
        parts += [
            "<h2>ROC</h2>",
            html_image(data_url(roc_figure(scored)), "ROC"),
            _roc_text(scored[0]),
            _curve(scored[0]),
        ]
    parts += ["<h2>Alarms</h2>", _alarms(scored[0].labels if scored else main.alarms)]
    if len(others) > 1:
        parts += ["<h2>The same with another self-signature</h2>", _variant_note(run)]
        parts.append(html_image(data_url(run_view_figure(result, others, truth, objects)), "run-views of the variants"))
    parts += ["<h2>Sub-bands and polarizations</h2>"]
    parts.append(html_image(data_url(channel_figure(result), 90), "run-view of every channel"))
    parts += ["<h2>Geometry and coverage</h2>", _geometry_text(run)]
    parts.append(html_image(data_url(geometry_figure(run, result.lane, main.view["looks"], 0.4)), "geometry"))
    parts += ["<h2>What was run</h2>", _provenance(result)]
    title = f"{run['title']} - {result.recipe.name}"
    return html_page(title, parts)


def _summary(result: Result, scored: list[Score] | None) -> str:
    lane = result.lane
    where = f"Lane {lane.x_min:g} to {lane.x_max:g} m across, {lane.y_min:g} to {lane.y_max:g} m along"
    text = f"{where}, recipe “{result.recipe.name}”. "
    if scored is None:
        return text + "Not scored: no truth was given."
    last = scored[0].curve.iloc[-1]
    if not last.n_targets:
        return text + f"No target stands here: {int(last.n_false)} false alarms on {last.area:.2f} m²."
    return text + (
        f"All alarms declared: {int(last.n_detected)} of {int(last.n_targets)} targets found "
        f"(Pd {last.pd:.2f}, 95 % interval {last.pd_low:.2f} to {last.pd_high:.2f}) with {int(last.n_false)} false alarms on "
        f"{last.area:.2f} m² (FAR {last.far:.2f} per m², {last.far_low:.2f} to {last.far_high:.2f})."
    )


def _outcomes(one: Score) -> str:
    rows: list[list[str]] = []
    for row in one.outcomes.to_dict("records"):
        found = bool(row["detected"])
        shift = row["expected_shift"]
        rows.append(
            [
                row["target_id"],
                f"{row['kind']}, {100 * row['depth']:.1f} cm deep",
                f"({row['x']:.2f}, {row['y']:.2f})",
                "found" if found else "missed",
                f"{row['rank']:d}" if found else "",
                f"{row['n_false']:d}" if found else "",
                f"{row['distance']:.2f}" if found else "",
                f"({row['dx']:+.2f}, {row['dy']:+.2f})" if found else "",
                f"{shift:.2f}" if np.isfinite(shift) else "",
            ]
        )
    head = ["target", "*kind", "*at (m)", "*", "rank", "false alarms above", "distance (m)", "offset x, y (m)"]
    title = (
        "Recipe as it stands"
        if one.detection.name == "main"
        else one.detection.title[:1].upper() + one.detection.title[1:]
    )
    table = html_table([*head, "refraction shift expected (m)"], rows)
    return f"<h3>{escape(title)}</h3>{_detection_note(one)}{table}"


def _detection_note(one: Score) -> str:
    notes = one.detection.notes
    if one.detection.name == "main" or "mask_pixels" not in notes:
        return ""
    if not notes["mask_pixels"]:
        return "<p class=note>Nothing beside the lane outshines it: nothing was subtracted.</p>"
    x, y = notes["mask_centre"]
    return (
        f"<p class=note>{notes['mask_pixels']} pixels beside the lane, about ({x:.2f}, {y:.2f}) m, outshine every pixel in "
        f"it. Their modelled response was fitted and subtracted scan by scan: the peak there fell by "
        f"{notes['mask_peak_reduced_by_db']:.1f} dB.</p>"
    )


def _remarks(scored: list[Score]) -> list[str]:
    """Say of each alarm on a target whether the roadside's sidelobes made it."""
    main = scored[0]
    remarks = []
    if "roadside" in main.detection.alarms and main.detection.notes.get("mask_pixels"):
        for row in main.outcomes[main.outcomes["detected"]].to_dict("records"):
            share = float(main.detection.alarms["roadside"].iloc[row["alarm"]])
            verdict = "not the roadside's doing" if share < 0.5 else "mostly the roadside's sidelobes"
            remarks.append(
                f"<li>{escape(row['target_id'])}: the modelled roadside response has {100 * share:.0f} % of the amplitude at "
                f"the alarm, so the alarm is {verdict}.</li>"
            )
    text = (
        "<p class=note>Rank counts all alarms by confidence; false alarms above are those inside the lane, outside every "
        "halo, at or above the target's alarm. The shift expected from refraction is what focusing on the surface does to "
        "an echo from the top of the target; scoring does not correct for it.</p>"
    )
    return [f"<ul>{''.join(remarks)}</ul>" if remarks else "", text]


def _roc_text(one: Score) -> str:
    attrs = one.curve.attrs
    if not attrs["n_targets"]:
        return "<p>Without targets there is no probability of detection; the table below counts the false alarms.</p>"
    return (
        f"<p>{attrs['n_targets']} targets, {attrs['area']:.2f} m² outside their halos; one false alarm is "
        f"{1 / attrs['area']:.2f} per m². PD_mean (FAR up to 0.1 per m²) {pd_mean(one.curve):.2f}. The band is the exact 95 % "
        f"interval of each point. With so few targets and so small a lane this says what happened here, not how good the "
        f"method is.</p>"
    )


def _curve(one: Score) -> str:
    rows = [
        [
            "all" if np.isinf(row["threshold"]) else f"{row['threshold']:.2f}",
            f"{int(row['n_detected'])} of {int(row['n_targets'])}",
            f"{row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f})",
            f"{int(row['n_false'])}",
            f"{row['far']:.2f} ({row['far_low']:.2f} to {row['far_high']:.2f})",
        ]
        for row in one.curve.iloc[1:].to_dict("records")
    ]
    return html_table(["threshold", "found", "Pd (95 %)", "false alarms", "FAR per m² (95 %)"], rows)


def _alarms(alarms: pd.DataFrame) -> str:
    columns = [("alarm_id", "*alarm", "{}"), ("x", "x (m)", "{:.2f}"), ("y", "y (m)", "{:.2f}")]
    columns += [
        ("confidence", "confidence", "{:.2f}"),
        ("magnitude", "magnitude", "{:.2f}"),
        ("scans", "scans", "{:.0f}"),
    ]
    columns += [("roadside", "explained by roadside", "{:.0%}"), ("label", "*counts as", "{}")]
    used = [column for column in columns if column[0] in alarms]
    rows = [[form.format(row[name]) for name, _, form in used] for row in alarms[:_MOST_ALARMS].to_dict("records")]
    if not rows:
        return "<p>No alarms.</p>"
    more = f"<p class=note>The first {len(rows)} of {len(alarms)}; alarms.csv has them all.</p>"
    return html_table([title for _, title, _ in used], rows) + (more if len(alarms) > len(rows) else "")


def _variant_note(run: dict[str, Any]) -> str:
    scans = run["scans"] - len(run["masked_scans"])
    return (
        f"<p class=note>Estimated over {scans} scans, a mean self-signature also holds 1/{scans} of every target, and "
        f"subtracting it leaves ghosts of each target at the places it has in the other scans.</p>"
        if scans < 10
        else ""
    )


def _geometry_text(run: dict[str, Any]) -> str:
    pose = np.asarray(run["pose"])
    low, high = (value / 1e9 for value in run["frequency_hz"])
    text = (
        f"{run['scans']} scans from y = {pose[0, 1]:.2f} to {pose[-1, 1]:.2f} m, array {pose[:, 2].mean():.2f} m above the "
        f"ground, {len(run['tx_m'])} transmitter and {len(run['rx_m'])} receiver positions in {run['pairs']} pairs, "
        f"{', '.join(run['polarizations'])}, {run['tones']} tones from {low:.4g} to {high:.4g} GHz."
    )
    if run["missing_sweeps"]:
        masked = ", ".join(map(str, run["masked_scans"]))
        text += f" {run['missing_sweeps']} sweeps are missing; scans left out for it: {masked}."
    else:
        text += " No sweep is missing."
    return f"<p>{escape(text)}</p>"


def _provenance(result: Result) -> str:
    manifest = result.manifest
    libraries = ", ".join(f"{name} {version}" for name, version in manifest["libraries"].items())
    store = manifest["run"].get("store_sha256", "not stored")
    return (
        f"<p>flgpr {escape(manifest['flgpr'])}, Python {escape(manifest['python'])}, {escape(libraries)}.<br>"
        f"Source: {escape(manifest['run']['source'] or 'not stated')}.<br>"
        f"Run (SHA-256 of its manifest): <code>{escape(store)}</code><br>"
        f"Recipe (SHA-256): <code>{manifest['recipe_sha256']}</code></p>"
        f"<details open><summary>recipe.toml</summary><pre>"
        f"{escape((result.folder / 'recipe.toml').read_text(encoding='utf-8'))}</pre></details>"
    )
