"""The counts of the first table of the page of verdicts are those of its tables."""

import csv
import re
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow("checks of pages")

EVIDENCE = Path(__file__).parents[2] / "docs" / "evidence"
STUDIES = {
    "Cosgrove et al. 2004": "cosgrove2004",
    "flsar2004": "flsar2004",
    "Wang et al. 2007": "wang2007",
    "Fuse et al. 2018": "fuse2018",
}
VERDICTS = ("agrees", "disagrees", "cannot say")


def stated_counts(study):
    """Counts of agreement, by world, that the page states."""
    page = (EVIDENCE / "verdicts.md").read_text(encoding="utf-8")
    table = page.partition("## Agreement by paper")[2].partition("\n## ")[0]
    row = next(line for line in table.splitlines() if line.startswith(f"| [{study}]("))
    cells = row.strip("| ").split("|")[1:3]
    return [
        [int(number) for number in re.match(r"\s*(\d+), (\d+), (\d+)", cell).groups()]
        for cell in cells
    ]


@pytest.mark.parametrize("study", STUDIES)
def test_counts_of_agreement_are_those_of_the_tables(study):
    with (EVIDENCE / "verdicts" / f"{STUDIES[study]}.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = [number for number, title in enumerate(header) if title == "verdict"]
    counted = []
    for column in columns:
        verdicts = Counter(row[column] for row in rows)
        counted.append([verdicts[name] for name in VERDICTS])
    assert counted == stated_counts(study)
