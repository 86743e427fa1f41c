"""Make the tables of docs/verdicts.md from the folder of `flgpr reproduce all` in both worlds.

    python benchmarks/verdict_tables.py FOLDER [docs/verdicts]

A study that has results in one world only has dashes for the other. The counts that the page's first table holds are
printed. Tables of experiments, ``reasons.csv`` of ``flgpr reproduce reasons``, are taken over as they are.
"""

import csv
import json
import sys
from pathlib import Path
from typing import Any

WORLDS = {"prepared": "", "as found": "as-found"}
"""Folder of a world within that of a study, by the heading of its columns."""
VERDICTS = ("agrees", "disagrees", "cannot say")


def main() -> None:
    """Write a table for every study in the folder."""
    folder = Path(sys.argv[1])
    output = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/verdicts")
    for study in sorted(path for path in folder.iterdir() if path.is_dir()):
        copy_reasons(study, output)
        findings = {world: read_findings(study / place) for world, place in WORLDS.items()}
        rows = rows_of(findings)
        if not rows:
            continue
        path = output / f"{study.name}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([header(), *rows])
        print(
            f"{path}: {'; '.join(count_verdicts(world, found) for world, found in findings.items())}"
        )


def copy_reasons(study: Path, output: Path) -> None:
    """Take over the tables of experiments of a study, a file per world."""
    for place in WORLDS.values():
        table = study / place / "reasons.csv"
        if table.is_file():
            name = "-".join(part for part in ("reasons", study.name, place) if part)
            (output / f"{name}.csv").write_text(table.read_text(encoding="utf-8"), encoding="utf-8")


def header() -> list[str]:
    """Return the names of the columns."""
    columns = ["statement", "the paper"]
    for world in WORLDS:
        columns += [world, "verdict"]
    return columns


def read_findings(folder: Path) -> dict[str, dict[str, Any]]:
    """Read the statements of a run that were judged, by claim and quantity; none where it was not run."""
    path = folder / "findings.json"
    if not path.is_file():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))["findings"]
    judged = [finding for finding in found if finding["verdict"] in VERDICTS]
    return {finding["claim"]: finding for finding in judged}


def rows_of(findings: dict[str, dict[str, dict[str, Any]]]) -> list[list[str]]:
    """Return a row for every statement that a world judged, in the order of the first world that has it."""
    claims: dict[str, str] = {}
    for found in findings.values():
        for claim, finding in found.items():
            claims.setdefault(claim, finding["paper"])
    rows = []
    for claim, paper in claims.items():
        row = [claim, paper]
        for found in findings.values():
            finding = found.get(claim)
            row += [finding["ours"], finding["verdict"]] if finding else ["–", "–"]
        rows.append(row)
    return rows


def count_verdicts(world: str, found: dict[str, dict[str, Any]]) -> str:
    """Return how many statements agree, disagree and cannot be said in a world."""
    if not found:
        return f"{world}: not run"
    verdicts = [finding["verdict"] for finding in found.values()]
    return f"{world}: " + ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in VERDICTS)


if __name__ == "__main__":
    main()
