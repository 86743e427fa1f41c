"""How scores are printed."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from flgpr.door import Folder


def score_summary(folder: Path, scored: list[Any]) -> dict[str, Any]:
    """Summarise scores for a machine."""
    from flgpr.commands.scoring import outcome_table

    report = Folder(folder).json("roc.json")
    main = report["detections"]["main"]
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
        "rules": report["rules"],
        "notes": report["notes"],
        "outcomes": json.loads(outcome_table(scored).to_json(orient="records")),
    }


def score_lines(scores: list[Any]) -> Iterator[Any]:
    """Return a table of what became of each target, and a sentence of what that amounts to."""
    from rich.table import Table
    from rich.text import Text

    title = f"What became of each target at {scores[0].far:.2g} false alarms per m²"
    table = Table(title=title, caption="first seen: at so many false alarms per m²")
    for name in ("target", "outcome", "first seen", "rank", "above", "off by"):
        table.add_column(
            name, justify="left" if name in ("target", "outcome") else "right", no_wrap=True
        )
    for score in scores:
        table.add_section()
        table.add_row(Text(score.name, style="bold"))
        for row in score.outcomes.to_dict("records"):
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
    yield table
    yield f"{scores[0].name}: {scores[0].in_words()}"


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


def blind_lines(score: Any) -> Iterator[str]:
    """Return what a score against a sealed truth lets be known."""
    yield score.points.to_string(index=False, float_format=_three_digits)
    if score.targets is not None:
        yield score.targets.to_string(index=False, na_rep="never", float_format=_three_digits)
    counts = []
    for name, value in score.counts.items():
        text = f"{value:.6g}" if isinstance(value, float) else value
        counts.append(f"{name} {text}")
    yield ", ".join(counts)
    yield (
        f"look {score.looks} at this truth, different alarm lists so far: {score.lists}; "
        "the seal guards against accidents, not against the holder of the passphrase"
    )
    for name, head in score.heads.items():
        yield f"{name}: {head['lines']} lines, the last is {head['head']}"


def _three_digits(value: float) -> str:
    return f"{value:.3g}"


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
