"""Text and JSON of scores, comparisons, blind scores and agreements."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.door import Folder

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from flgpr.commands.analysts import PairAgreement
    from flgpr.scoring import Agreement, Score, SideBySide
    from flgpr.scoring.score_entries import ScoreSummary
    from flgpr.trials import BlindScore

_LEFT_COLUMNS = ("target", "outcome")
_RIGHT_COLUMNS = ("first seen", "rank", "above", "off by")


def score_summary(folder: Path, scored: list[Score]) -> ScoreSummary:
    """Return the figures of a score as ``--json`` prints them."""
    from flgpr.commands.scoring import outcome_table

    report = Folder(folder).json("roc.json")
    detection = report["detections"]["main"]
    operating_point = detection["operating_point"]
    last_point = detection["points"][-1]
    return {
        "result": str(folder),
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
        "outcomes": json.loads(outcome_table(scored).to_json(orient="records")),
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


def comparison_lines(comparison: SideBySide) -> list[str]:
    """Return the Pd of each detector with interval, counts and chance, and the differences."""
    lines = [
        "95 % intervals in brackets; chance is the Pd of alarms that know nothing of the targets"
    ]
    width = max(len(name) for name in comparison.points["detector"])
    for far, points in comparison.points.groupby("far_allowed"):
        lines += ["", f"at most {far:g} false alarms per m²"]
        for row in points.to_dict("records"):
            lines.append(_detector_line(row, width))
        pairs = comparison.pairs[comparison.pairs["far_allowed"] == far]
        for row in pairs.to_dict("records"):
            lines.append(_difference_line(row))
    if comparison.means is not None:
        for row in comparison.means.to_dict("records"):
            lines += ["", *_mean_lines(row)]
    return lines


def _detector_line(row: Mapping[Any, Any], width: int) -> str:
    """Return the operating point of a detector, whose name is padded to a width."""
    by_chance = "not known" if math.isnan(row["chance"]) else f"{row['chance']:.2f}"
    return (
        f"  {row['detector']:{width}}  "
        f"Pd {row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f}), "
        f"{row['n_detected']:.0f} of {row['n_targets']:.0f}, chance {by_chance}; "
        f"{row['n_false']:.0f} false, "
        f"FAR {row['far']:.4f} ({row['far_low']:.4f} to {row['far_high']:.4f})"
    )


def _difference_line(row: Mapping[Any, Any]) -> str:
    """Return by how much two detectors differ at an operating point."""
    return (
        f"  {row['first']} less {row['second']}: "
        f"{row['difference']:+.2f} ({row['low']:+.2f} to {row['high']:+.2f}); "
        f"alone found {row['only_first']} and {row['only_second']}, "
        f"McNemar's p = {row['p']:.2g}"
    )


def _mean_lines(row: Mapping[Any, Any]) -> list[str]:
    """Return the mean Pd of two detectors and their difference."""
    first = (
        f"{row['first']} {row['pd_mean_a']:.3f} "
        f"({row['low_a']:.3f} to {row['high_a']:.3f}, chance {row['chance_a']:.3f})"
    )
    second = (
        f"{row['second']} {row['pd_mean_b']:.3f} "
        f"({row['low_b']:.3f} to {row['high_b']:.3f}, chance {row['chance_b']:.3f})"
    )
    return [
        f"mean Pd: {first}, {second}",
        f"  {row['first']} less {row['second']}: "
        f"{row['difference']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f}), "
        f"p = {row['p_value']:.2g} by sign flips",
    ]


def blind_lines(blind: BlindScore) -> Iterator[str]:
    """Yield what a score against a sealed truth shows: points, counts, looks and log heads."""
    yield blind.points.to_string(index=False, float_format=_three_digits)
    if blind.targets is not None:
        yield blind.targets.to_string(index=False, na_rep="never", float_format=_three_digits)
    counts = []
    for name, value in blind.counts.items():
        text = f"{value:.6g}" if isinstance(value, float) else value
        counts.append(f"{name} {text}")
    yield ", ".join(counts)
    yield (
        f"look {blind.looks} at this truth, different alarm lists so far: {blind.lists}; "
        "the seal guards against accidents, not against the holder of the passphrase"
    )
    for name, head in blind.heads.items():
        yield f"{name}: {head['lines']} lines, the last is {head['head']}"


def _three_digits(value: float) -> str:
    """Return a number to three digits."""
    return f"{value:.3g}"


def agreement_lines(pairs: Mapping[tuple[str, str], PairAgreement]) -> list[str]:
    """Return how far every two analysts agree, with a table of their verdicts."""
    lines = ["95 % intervals in brackets; kappa is what of the agreement chance does not explain"]
    for (first, second), (agreement, only_first, only_second) in pairs.items():
        lines += [
            "",
            f"{first} and {second}: {agreement.agreed} of {agreement.n} alarms judged alike, "
            f"{agreement.share:.2f} ({agreement.share_low:.2f} to {agreement.share_high:.2f}); "
            f"by chance {agreement.expected:.2f}",
            f"  Cohen's kappa {_kappa(agreement)}",
            f"  judged by {first} alone {only_first}, by {second} alone {only_second}",
        ]
        lines += _verdict_lines(agreement.table, first, second)
    return lines


def _kappa(agreement: Agreement) -> str:
    """Return Cohen's kappa with its interval, which one verdict throughout leaves undefined."""
    if math.isnan(agreement.kappa):
        return "not defined: one verdict throughout"
    return f"{agreement.kappa:.2f} ({agreement.kappa_low:.2f} to {agreement.kappa_high:.2f})"


def _verdict_lines(counts: pd.DataFrame, first: str, second: str) -> list[str]:
    """Return a table of counts, verdicts of the first (rows) by those of the second (columns)."""
    table = counts.rename_axis(None)
    width = max(len(first), *[len(verdict) for verdict in table.index]) + 2
    heading = "".join(f"{verdict:>9}" for verdict in table.columns)
    lines = [f"  {first:{width}}{heading}  {second}"]
    for verdict, *row in table.itertuples():
        cells = "".join(f"{count:9d}" for count in row)
        lines.append(f"  {verdict:{width}}{cells}")
    return lines


def agreement_json(pairs: Mapping[tuple[str, str], PairAgreement]) -> list[dict[str, Any]]:
    """Return how far every two analysts agree as ``--json`` prints it; undefined is null."""
    entries = []
    for (first, second), (agreement, only_first, only_second) in pairs.items():
        entry: dict[str, Any] = {
            "first": first,
            "second": second,
            "only_first": only_first,
            "only_second": only_second,
        }
        for name, value in vars(agreement).items():
            if name != "table":
                entry[name] = None if math.isnan(value) else value
        entry["table"] = agreement.table.to_dict("index")
        entries.append(entry)
    return entries
