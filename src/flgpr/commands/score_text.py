"""Text and JSON of scores and comparisons."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from flgpr.door import Folder

if TYPE_CHECKING:
    from rich.table import Table

    from flgpr.commands.scoring import Scored
    from flgpr.scoring import Score, SideBySide
    from flgpr.scoring.score_entries import ScoreSummary

_LEFT_COLUMNS = ("target", "outcome")
_RIGHT_COLUMNS = ("first seen", "rank", "above", "off by")


def score_summary(scored: Scored) -> ScoreSummary:
    """Return the figures of a score as ``--json`` prints them."""
    report = Folder(scored.folder).json("roc.json")
    detection = report["detections"]["main"]
    operating_point = detection["operating_point"]
    last_point = detection["points"][-1]
    return {
        "result": str(scored.folder),
        "targets": detection["n_targets"],
        "found": operating_point["n_detected"],
        "false_alarms": operating_point["n_false"],
        "operating_point": operating_point,
        "all_alarms": {
            "found": last_point["n_detected"],
            "false_alarms": last_point["n_false"],
            "chance": last_point["chance"],
        },
        "area_m2": detection["area"],
        "pd_mean": detection["pd_mean"],
        "rules": report["rules"],
        "notes": report["notes"],
        "outcomes": json.loads(scored.outcomes().to_json(orient="records")),
    }


def score_lines(scores: list[Score]) -> Iterator[Any]:
    """Yield a table of what became of each target, and a sentence that sums it up."""
    yield _outcome_table(scores)
    yield f"{scores[0].name}: {scores[0].in_words()}"


def _outcome_table(scores: list[Score]) -> Table:
    """Return a table for rich with a section for each detection and a row for each target."""
    from rich.table import Table
    from rich.text import Text

    title = f"What became of each target at {scores[0].far:.2g} false alarms per m²"
    table = Table(title=title, caption="first seen: at so many false alarms per m²")
    for name in _LEFT_COLUMNS:
        table.add_column(name, justify="left", no_wrap=True)
    for name in _RIGHT_COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for score in scores:
        table.add_section()
        table.add_row(Text(score.name, style="bold"))
        for row in score.outcomes.to_dict("records"):
            table.add_row(*_outcome_cells(row))
    return table


def _outcome_cells(row: Mapping[Any, Any]) -> list[str]:
    """Return the cells of a target; one without any alarm was never seen."""
    target = f"  {row['target_id']}: {row['kind']}, {100 * row['depth']:.1f} cm"
    outcome = "found" if row["found"] else "missed"
    if not row["detected"]:
        return [target, outcome, "never"]
    far = f"{row['far']:.2g}"
    return [target, outcome, far, str(row["rank"]), str(row["n_false"]), f"{row['distance']:.2f} m"]


_POINT = (
    "Pd {pd:.2f} ({pd_low:.2f} to {pd_high:.2f}), {n_detected:.0f} of {n_targets:.0f}, "
    "chance {by_chance}; {n_false:.0f} false, FAR {far:.4f} ({far_low:.4f} to {far_high:.4f})"
)
_DIFFERENCE = (
    "  {first} less {second}: {difference:+.2f} ({low:+.2f} to {high:+.2f}); "
    "alone found {only_first} and {only_second}, McNemar's p = {p:.2g}"
)
_MEANS = (
    "mean Pd: {first} {pd_mean_a:.3f} ({low_a:.3f} to {high_a:.3f}, chance {chance_a:.3f}), "
    "{second} {pd_mean_b:.3f} ({low_b:.3f} to {high_b:.3f}, chance {chance_b:.3f})"
)
_MEAN_DIFFERENCE = (
    "  {first} less {second}: {difference:+.3f} ({low:+.3f} to {high:+.3f}), "
    "p = {p_value:.2g} by sign flips"
)


def comparison_lines(comparison: SideBySide) -> Iterator[str]:
    """Yield the Pd of each detector with interval, counts and chance, and the differences."""
    yield "95 % intervals in brackets; chance is the Pd of alarms that know nothing of the targets"
    width = max(len(name) for name in comparison.points["detector"])
    for far, points in comparison.points.groupby("far_allowed"):
        yield ""
        yield f"at most {far:g} false alarms per m²"
        for row in points.to_dict("records"):
            is_known = not math.isnan(row["chance"])
            row["by_chance"] = f"{row['chance']:.2f}" if is_known else "not known"
            yield f"  {row['detector']:{width}}  {_POINT.format_map(row)}"
        pairs = comparison.pairs[comparison.pairs["far_allowed"] == far]
        for row in pairs.to_dict("records"):
            yield _DIFFERENCE.format_map(row)
    if comparison.means is not None:
        for row in comparison.means.to_dict("records"):
            yield ""
            yield _MEANS.format_map(row)
            yield _MEAN_DIFFERENCE.format_map(row)
