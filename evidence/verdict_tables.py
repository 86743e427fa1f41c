"""Make the tables of docs/evidence/verdicts.md from the folder of `flgpr reproduce all` in both worlds.

    python evidence/verdict_tables.py FOLDER [docs/evidence/verdicts]

Cells that the folder has no result for stay as they stand in the table; delete a table to make it anew. Where
`evidence/replicates.py` has repeated an experiment, the row has what holds in all repeats together. A table says beside
each number how often its rule would have answered, and in how many experiments of the paper's size it shows what the
paper says. The counts that the page's first table holds are printed. Tables of experiments, ``reasons.csv`` of
``python evidence/reasons``, are taken over as they are.
"""

import csv
import sys
from pathlib import Path

from flgpr_papers.kit.findings import Finding, read_findings

WORLDS = {"prepared": "", "as found": "as-found"}
"""Folder of a world within that of a study, by the heading of its columns."""
VERDICTS = ("agrees", "disagrees", "cannot say")
MAIN_GROUP = "open"
"""Group of lanes that a study's own table has, where it has several."""
FIRST = 3
"""Columns before those of worlds."""
COLUMNS = {"prepared": slice(FIRST, FIRST + 4), "as found": slice(FIRST + 4, FIRST + 6)}
"""Columns of each world; the last of them is its verdict."""
Statement = tuple[str, str]
"""What tells a statement from others of its group: claim and quantity."""


def main() -> None:
    """Write a table for every study in the folder, and one for each further group of its lanes."""
    folder = Path(sys.argv[1])
    output = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/evidence/verdicts")
    for study in sorted(path for path in folder.iterdir() if path.is_dir()):
        copy_reasons(study, output)
        judged = {world: judged_findings(study / place) for world, place in WORLDS.items()}
        groups = dict.fromkeys(finding.group for found in judged.values() for finding in found)
        for group in groups:
            findings = {world: by_statement(found, group) for world, found in judged.items()}
            name = study.name if group in ("", MAIN_GROUP) else f"{study.name}-{group}"
            path = output / f"{name}.csv"
            rows = with_kept(path, rows_of(findings))
            with path.open("w", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerows([header(), *rows])
            print(f"{path}: {'; '.join(count_verdicts(rows))}")


def copy_reasons(study: Path, output: Path) -> None:
    """Take over the tables of experiments of a study, a file per world."""
    for place in WORLDS.values():
        table = study / place / "reasons.csv"
        if table.is_file():
            name = "-".join(part for part in ("reasons", study.name, place) if part)
            (output / f"{name}.csv").write_text(table.read_text(encoding="utf-8"), encoding="utf-8")


def header() -> list[str]:
    """Return the names of the columns; the first world has power and single experiments, too."""
    first, *others = WORLDS
    columns = [
        "statement",
        "the paper",
        "rule",
        first,
        "power",
        "experiments that show it",
        "verdict",
    ]
    for world in others:
        columns += [world, "verdict"]
    return columns


def judged_findings(folder: Path) -> list[Finding]:
    """Read the statements of a run, or of its repeats alone, that were judged; none where neither ran."""
    repeated: dict[Statement, Finding] = {}
    if (folder / "replicates" / "findings.json").is_file():
        for finding in read_findings(folder / "replicates"):
            repeated[finding.claim, finding.quantity] = finding
    has_run = (folder / "findings.json").is_file()
    found = read_findings(folder) if has_run else list(repeated.values())
    found = [repeated.get((finding.claim, finding.quantity), finding) for finding in found]
    return [finding for finding in found if finding.verdict in VERDICTS]


def by_statement(found: list[Finding], group: str) -> dict[Statement, Finding]:
    """Return the findings of a group of lanes by claim and quantity: one claim may be asked of several quantities."""
    chosen = [finding for finding in found if finding.group == group]
    return {(finding.claim, finding.quantity): finding for finding in chosen}


def rows_of(findings: dict[str, dict[Statement, Finding]]) -> list[list[str]]:
    """Return a row for every statement that a world judged, in the order of the first world that has it.

    Where a claim is asked of several quantities the quantity stands with it.
    """
    papers: dict[Statement, str] = {}
    for found in findings.values():
        for statement, finding in found.items():
            papers.setdefault(statement, finding.paper)
    claims = [claim for claim, _ in papers]
    rows = []
    for (claim, quantity), paper in papers.items():
        name = f"{claim} ({quantity})" if claims.count(claim) > 1 else claim
        in_worlds = [found.get((claim, quantity)) for found in findings.values()]
        rules = [finding.criterion for finding in in_worlds if finding and finding.criterion]
        row = [name, paper, rules[0] if rules else "–"]
        for number, finding in enumerate(in_worlds):
            row += cells_of(finding, number == 0)
        rows.append(row)
    return rows


def cells_of(finding: Finding | None, in_full: bool) -> list[str]:
    """Return the cells of a statement in a world; in full with power and single experiments."""
    texts = ["", ""]
    if finding is not None:
        # Two detectors that find all or nothing cannot differ: the table says it, too.
        remark = f"; {finding.note}" if finding.note.startswith("both find") else ""
        texts = [finding.ours + remark, finding.verdict]
    if in_full:
        more = ["", ""] if finding is None else [finding.power_in_words, finding.shown_in_words]
        texts[1:1] = more
    return [text or "–" for text in texts]


def with_kept(path: Path, rows: list[list[str]]) -> list[list[str]]:
    """Return the rows with the cells of an older table where there is no new verdict, in its order."""
    if not path.is_file():
        return rows
    with path.open(newline="", encoding="utf-8") as file:
        _, *old = csv.reader(file)
    new = {row[0]: row for row in rows}
    kept = []
    for row in old:
        now = new.pop(row[0], row)
        for columns in COLUMNS.values():
            if now[columns][-1] != "–":
                row[columns] = now[columns]
        kept.append([row[0], *now[1:FIRST], *row[FIRST:]])
    return [*kept, *new.values()]


def count_verdicts(rows: list[list[str]]) -> list[str]:
    """Return for every world how many statements agree, disagree and cannot be said."""
    counts = []
    for world, columns in COLUMNS.items():
        verdicts = [row[columns][-1] for row in rows]
        counts.append(
            f"{world}: " + ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in VERDICTS)
        )
    return counts


if __name__ == "__main__":
    main()
