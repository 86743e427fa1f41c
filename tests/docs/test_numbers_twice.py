"""Numbers of the papers' studies that stand on several pages are the same on all of them."""

import csv
import re

import pytest

from reading import ROOT, read

pytestmark = pytest.mark.slow("checks of pages")

EVIDENCE = ROOT / "docs" / "evidence"
PAPERS = {
    "cosgrove2004": "Cosgrove et al. 2004",
    "flsar2004": "flsar2004",
    "wang2007": "Wang et al. 2007",
    "fuse2018": "Fuse et al. 2018",
}
NUMBER = r"([-+]?\d+(?:\.\d+)?)\s?(?:%|dB)?"
INTERVAL = re.compile(rf"{NUMBER}\s+\({NUMBER}\s+to\s+{NUMBER}\)")


def intervals(text):
    """Collect numbers with their intervals, without signs: one page has a loss, another a gain."""
    return [
        (found, [abs(float(number)) for number in found.groups()])
        for found in INTERVAL.finditer(text)
    ]


def causes(paper):
    """Rows of the table of causes that are of a paper."""
    lines = read(EVIDENCE / "verdicts" / "causes.csv").splitlines()
    return "\n".join(line for line in lines if line.lstrip('"').startswith(f"{PAPERS[paper]}:"))


def stands(values, decimals, others):
    """Tell whether a number stands among others, as a share or in per cent, rounded to its decimals."""
    half = 0.501 * 10.0**-decimals
    wanted = [values[0], *sorted(values[1:])]
    for other in others:
        known = [other[0], *sorted(other[1:])]
        for unit in (1, 100, 0.01):
            gaps = [abs(unit * a - b) for a, b in zip(known, wanted, strict=True)]
            if max(gaps) <= half:
                return True
    return False


@pytest.mark.parametrize("paper", PAPERS)
def test_intervals_of_other_pages_are_those_of_the_papers_own(paper):
    own = read(EVIDENCE / "papers" / f"{paper}.md")
    sources = (f"verdicts/{paper}*.csv", f"verdicts/reasons-{paper}.csv", f"papers/{paper}/*.csv")
    for tables in sources:
        own += "".join(read(table) for table in sorted(EVIDENCE.glob(tables)))
    known = [values for _, values in intervals(own)]
    told = causes(paper) + read(EVIDENCE / "papers" / f"{paper}-steps.md")
    found = intervals(told)
    assert found
    for text, values in found:
        decimals = max(len(number.partition(".")[2]) for number in text.groups())
        assert stands(values, decimals, known), text.group()


def test_a_number_that_differs_is_noticed():
    assert stands([0.21, 0.18, 0.24], 2, [[0.209, 0.178, 0.240]])
    assert stands([1.8, 1.7, 2.0], 1, [[0.0184, 0.0170, 0.0199]])
    assert not stands([0.21, 0.18, 0.25], 2, [[0.209, 0.178, 0.240]])


def test_every_page_says_the_same_of_how_many_vectors_the_prior_keeps():
    with (EVIDENCE / "verdicts" / "flsar2004.csv").open(encoding="utf-8") as file:
        rows = {row["statement"]: row["prepared"] for row in csv.DictReader(file)}
    kept = float(rows["share of relevance vectors"].split()[0])
    pages = [ROOT / "docs" / "reference" / "rvm.md"]
    pages += [EVIDENCE / "papers" / f"flsar2004{name}.md" for name in ("", "-steps")]
    for page in pages:
        text = " ".join(read(page).split())
        assert f"{100 * kept:.1f} %" in text, page
        assert "about as many" not in text, page


def test_the_pages_first_sentence_has_the_sums_of_its_table():
    page = read(EVIDENCE / "verdicts.md")
    table = page.partition("## Agreement by paper")[2].partition("\n## ")[0]
    counts = []
    for title in PAPERS.values():
        row = next(line for line in table.splitlines() if line.startswith(f"| [{title}]("))
        counts.append(
            [int(n) for n in re.match(r"\s*(\d+), (\d+), (\d+)", row.split("|")[2]).groups()]
        )
    agree, disagree, undecided = (sum(column) for column in zip(*counts, strict=True))
    total = agree + disagree + undecided
    sentence = (
        f"Of {total} statements of the four papers {agree} agree on prepared lanes, {disagree} disagree and "
        f"{undecided} stay open"
    )
    assert sentence in " ".join(page.split())
