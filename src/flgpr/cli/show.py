"""How results and runs are said on a terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from flgpr import tasks
from flgpr.door import Folder

# m above the ground, from where on coverage ahead of a vehicle is not what is asked for
_AIRBORNE = 100.0


def score_summary(folder: Path, scored: list[Any]) -> dict[str, Any]:
    """Summarise scores for a machine."""
    told = Folder(folder).json("roc.json")
    main = told["detections"]["main"]
    point = main["operating_point"]
    last = main["points"][-1]
    return {
        "result": str(folder),
        "targets": main["n_targets"],
        "found": point["n_detected"],
        "false_alarms": point["n_false"],
        "operating_point": point,
        "all_alarms": {
            "found": last["n_detected"],
            "false_alarms": last["n_false"],
            "chance": last["chance"],
        },
        "area_m2": main["area"],
        "pd_mean": main["pd_mean"],
        "rules": told["rules"],
        "notes": told["notes"],
        "outcomes": json.loads(tasks.outcome_table(scored).to_json(orient="records")),
    }


def print_scores(scored: list[Any]) -> None:
    """Print what became of each target at the operating point, and in a sentence what that amounts to."""
    from rich.console import Console
    from rich.table import Table

    title = f"What became of each target at {scored[0].far:.2g} false alarms per m²"
    table = Table(title=title, caption="first seen: at so many false alarms per m²")
    for name in ("target", "outcome", "first seen", "rank", "above", "off by"):
        table.add_column(
            name, justify="left" if name in ("target", "outcome") else "right", no_wrap=True
        )
    for one in scored:
        table.add_section()
        table.add_row(f"[bold]{one.name}[/bold]")
        for row in one.outcomes.to_dict("records"):
            target = f"  {row['target_id']}: {row['kind']}, {100 * row['depth']:.1f} cm"
            seen = [
                f"{row['far']:.2g}",
                str(row["rank"]),
                str(row["n_false"]),
                f"{row['distance']:.2f} m",
            ]
            table.add_row(
                target,
                "found" if row["found"] else "missed",
                *(seen if row["detected"] else ["never"]),
            )
    Console().print(table)
    typer.echo(f"{scored[0].name}: {scored[0].in_words()}")


def comparison_lines(told: Any) -> list[str]:
    """Say detectors side by side: each Pd with interval, counts and chance, and their differences."""
    lines = [
        "95 % intervals in brackets; chance is the Pd of alarms that know nothing of the targets"
    ]
    width = max(map(len, told.points["detector"]))
    for far, rows in told.points.groupby("far_allowed"):
        lines += ["", f"at most {far:g} false alarms per m²"]
        for row in rows.to_dict("records"):
            by_chance = "not known" if math.isnan(row["chance"]) else f"{row['chance']:.2f}"
            lines.append(
                f"  {row['detector']:{width}}  Pd {row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f}), "
                f"{row['n_detected']:.0f} of {row['n_targets']:.0f}, chance {by_chance}; {row['n_false']:.0f} false, "
                f"FAR {row['far']:.4f} ({row['far_low']:.4f} to {row['far_high']:.4f})"
            )
        for row in told.pairs[told.pairs["far_allowed"] == far].to_dict("records"):
            lines.append(
                f"  {row['first']} less {row['second']}: {row['difference']:+.2f} ({row['low']:+.2f} to "
                f"{row['high']:+.2f}); alone found {row['only_first']} and {row['only_second']}, "
                f"McNemar's p = {row['p']:.2g}"
            )
    for row in [] if told.means is None else told.means.to_dict("records"):
        lines += [
            "",
            f"mean Pd: {row['first']} {row['pd_mean_a']:.3f} ({row['low_a']:.3f} to {row['high_a']:.3f}, chance "
            f"{row['chance_a']:.3f}), {row['second']} {row['pd_mean_b']:.3f} ({row['low_b']:.3f} to "
            f"{row['high_b']:.3f}, chance {row['chance_b']:.3f})",
            f"  {row['first']} less {row['second']}: {row['difference']:+.3f} ({row['low']:+.3f} to "
            f"{row['high']:+.3f}), p = {row['p_value']:.2g} by sign flips",
        ]
    return lines


def agreement_lines(pairs: Mapping[tuple[str, str], Any]) -> list[str]:
    """Say how far every two analysts agree, with a table of their verdicts."""
    lines = ["95 % intervals in brackets; kappa is what of the agreement chance does not explain"]
    for (first, second), (told, only_first, only_second) in pairs.items():
        kappa = f"{told.kappa:.2f} ({told.kappa_low:.2f} to {told.kappa_high:.2f})"
        lines += [
            "",
            f"{first} and {second}: {told.agreed} of {told.n} alarms judged alike, {told.share:.2f} "
            f"({told.share_low:.2f} to {told.share_high:.2f}); by chance {told.expected:.2f}",
            f"  Cohen's kappa {'not defined: one verdict throughout' if math.isnan(told.kappa) else kappa}",
            f"  judged by {first} alone {only_first}, by {second} alone {only_second}",
        ]
        table = told.table.rename_axis(None)
        width = max(len(first), *map(len, table.index)) + 2
        head = "".join(f"{name:>9}" for name in table.columns)
        lines.append(f"  {first:{width}}{head}  {second}")
        lines += [
            f"  {name:{width}}" + "".join(f"{count:9d}" for count in row)
            for name, *row in table.itertuples()
        ]
    return lines


def agreement_json(pairs: Mapping[tuple[str, str], Any]) -> list[dict[str, Any]]:
    """Tell a machine how far every two analysts agree; what is not defined is null."""
    return [
        {"first": first, "second": second, "only_first": only_first, "only_second": only_second}
        | {
            name: None if value != value else value
            for name, value in vars(told).items()
            if name != "table"
        }
        | {"table": told.table.to_dict("index")}
        for (first, second), (told, only_first, only_second) in pairs.items()
    ]


def info_lines(told: dict[str, Any]) -> list[str]:
    """Say in words what a run holds."""
    low, high = (value / 1e9 for value in told["frequency_hz"])
    spacing = told["scan_spacing_m"]
    between = f", {spacing[0]:.2f} to {spacing[1]:.2f} m between scans" if spacing else ""
    missing = f"{told['missing_sweeps']} missing" if told["missing_sweeps"] else "none missing"
    masked = f"; scans left out for it: {told['masked_scans']}" if told["masked_scans"] else ""
    even = (
        "evenly spaced"
        if told["uniform_tones"]
        else f"uneven, up to {told['largest_step_hz'] / 1e6:.3g} MHz apart"
    )
    lines = [
        f"{told['title']}" + (f" ({told['source']})" if told["source"] else ""),
        f"  scans          {told['scans']} over {told['travelled_m']:.2f} m of travel{between}",
        f"  sweeps         {told['pairs']} pairs x {', '.join(told['polarizations'])}: {missing}{masked}",
        f"  tones          {told['tones']} from {low:.4g} to {high:.4g} GHz, {even}",
    ]
    if told["unambiguous_path_m"]:
        lines.append(
            f"  range          resolution {told['range_resolution_m']:.3f} m, path unambiguous to "
            f"{told['unambiguous_path_m']:.1f} m"
        )
    heights = [
        told["height_m"] + pose[2] - sum(one[2] for one in told["pose"]) / len(told["pose"])
        for pose in told["pose"]
    ]
    across, along, _ = told["array_m"]
    lines += [
        f"  array          {len(told['tx_m'])} transmitter and {len(told['rx_m'])} receiver positions, "
        f"{across:.2f} m across and {along:.2f} m along, {min(heights):.2f} to {max(heights):.2f} m above the ground",
    ]
    vehicle = told["height_m"] <= _AIRBORNE
    if vehicle:
        lines.append(
            f"  coverage       x {told['lane']['x'][0]:.1f} to {told['lane']['x'][1]:.1f} m, "
            f"y {told['lane']['y'][0]:.1f} to {told['lane']['y'][1]:.1f} m: {told['looks']['mean']:.1f} looks on "
            f"average, at most {told['looks']['most']}, {100 * told['looks']['unseen_share']:.0f} % never seen"
        )
    lines += [
        *(f"  channels       {line}" for line in told["health"]),
        *_recipe_lines(told["recipes"]),
        *(f"  note           {line}" for line in told["import_notes"]),
        *(f"  warning        {line}" for line in told["warnings"]),
        *(["", *_coverage_map(told)] if vehicle else []),
    ]
    return lines


def model_lines(held: dict[str, Any]) -> list[str]:
    """Say in words what a model holds. Its words are somebody's: they are written as JSON, which hides no character."""
    detector = held["detector"]
    lines = [
        f"{held['path']}: {held['format']} version {held['version']}, written by flgpr {_quoted(held['flgpr'])}",
        f"  arrays         {len(held['arrays'])}, {held['bytes'] / 1e6:.3g} MB; none was loaded",
    ]
    if isinstance(detector, dict):
        lines.append(f"  detector       {_quoted(detector.get('estimator'))}")
        for name in sorted(set(detector) - {"estimator"}):
            lines.append(f"    {name:<12} {_quoted(detector[name])}")
    else:
        lines.append("  detector       none")
    lines.append(f"  stages         {_quoted(held['stages'])}")
    if isinstance(held["notes"], dict):
        for name, value in held["notes"].items():
            lines.append(f"  note           {_quoted(name)}: {_quoted(value)}")
    for one in held["arrays"]:
        lines.append(
            f"  array          {_quoted(one['name'])} {_quoted(one['dtype'])} {one['shape']}"
        )
    return lines


def _quoted(value: Any, most: int = 100) -> str:
    """Write a value of a file as JSON in ASCII, cut off where it is long."""
    text = json.dumps(value)
    return text if len(text) <= most else text[: most - 3] + "..."


def _recipe_lines(faults: dict[str, list[str]]) -> list[str]:
    """Say which recipes fit, and of the others what does not."""
    lines = [
        f"{name} fits" if not some else f"{name}: {one}"
        for name, some in faults.items()
        for one in some or [""]
    ]
    if any(faults.values()):
        lines.append("`flgpr recipe for RUN` makes one that fits")
    return [f"  {'recipe' if k == 0 else '':<15}{line}" for k, line in enumerate(lines)]


def _coverage_map(told: dict[str, Any]) -> list[str]:
    """Draw looks as a map of characters, down-track upwards, at most 24 lines."""
    rows = told["looks_map"]
    most = max(told["looks"]["most"], 1)
    stride = max(1, len(rows) // 24)
    shades = " ░▒▓█"
    low, high = told["lane"]["y"]
    drawn = []
    for index in range(0, len(rows), stride):
        y = low + (high - low) * index / max(len(rows) - 1, 1)
        cells = "".join(shades[-(-count * (len(shades) - 1) // most)] * 2 for count in rows[index])
        drawn.append(f"  y {y:7.1f} m  {cells}")
    return [*drawn[::-1], f"  {'':11}looks: blank 0 … {shades[-1]} {most}"]
