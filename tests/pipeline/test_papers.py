"""The overview of all papers: made-up verdicts through the very files that the papers write."""

import csv
import json
from dataclasses import asdict

import pytest
from typer.testing import CliRunner

from flgpr.cli import app
from flgpr.pipeline.reproduce import (
    cosgrove2004_findings,
    flsar2004_findings,
    fuse2018_findings,
    papers,
    wang2007_findings,
)


def write_cosgrove(folder):
    of = cosgrove2004_findings.Finding
    found = [of("A above B", "Pd", 0.2, 0.1, 0.3, "agrees"), of("Anything else?", "Pd", 0.0, 0.0, 0.0, "open")]
    short = [of("one seed", "Pd", 0.2, float("-inf"), float("inf"), "cannot say")]
    records = {"open": found, "roadside": short}
    told = {world: cosgrove2004_findings.as_records(one) for world, one in records.items()}
    (folder / "findings.json").write_text(json.dumps({"findings": told}))
    return folder / "index.html"


def write_flsar(folder):
    made = [flsar2004_findings.finding("n", "p", "q", (0.1, 0.06, 0.2), (-0.05, 0.05))]
    flsar2004_findings.findings_table(made).to_csv(folder / "findings.csv", index=False)
    return folder / "report.md"


def write_wang(folder):
    made = wang2007_findings.Finding("F1 < F2", "0.9 & more", "0.8, 9 of 10", "undecided")
    (folder / "findings.json").write_text(json.dumps({"findings": [asdict(made)]}))
    return folder / "wang2007.html"


def write_fuse(folder):
    made = fuse2018_findings.Finding("less clutter", "26.5 dB", "20 dB (19 to 21)", "disagrees")
    (folder / "findings.json").write_text(json.dumps({"findings": [asdict(made)]}))
    return folder / "fuse2018.html"


@pytest.fixture
def made_up(monkeypatch):
    """The table of the papers with runs that only write their findings."""
    order = []

    def runs(name, write):
        def run(folder, quick, _):
            order.append((name, quick))
            folder.mkdir(exist_ok=True)
            return write(folder)

        return run

    writers = {"cosgrove2004": write_cosgrove, "flsar2004": write_flsar, "fuse2018": write_fuse, "wang2007": write_wang}
    table = {
        name: papers.Paper(papers.PAPERS[name].title, runs(name, write), papers.PAPERS[name].verdicts)
        for name, write in writers.items()
    }
    monkeypatch.setattr(papers, "PAPERS", table)
    return order


def test_all_papers_are_run_and_their_verdicts_counted(made_up, tmp_path):
    page = papers.reproduce_all(tmp_path / "all", quick=True)
    assert made_up == [("cosgrove2004", True), ("flsar2004", True), ("fuse2018", True), ("wang2007", True)]
    with (tmp_path / "all" / "verdicts.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [(row["paper"], row["verdict"]) for row in rows] == [
        ("cosgrove2004", "agrees"),
        ("cosgrove2004", "cannot say"),
        ("flsar2004", "disagrees"),
        ("fuse2018", "disagrees"),
        ("wang2007", "cannot say"),
    ]
    assert rows[0]["ours"] == "0.20 (0.10 to 0.30)"
    assert "no interval" in rows[1]["ours"]
    html = page.read_text("utf-8")
    for text in ("Quick run", 'href="wang2007/wang2007.html"', "0.9 &amp; more", "F1 &lt; F2"):
        assert text in html
    assert "://" not in html
    counts = html[html.index(">cosgrove2004</a>") :].split("</tr>")[0]
    assert [int(part[0]) for part in counts.split("<td class=n>")[1:]] == [1, 0, 1]


def test_a_paper_that_fails_leaves_what_is_done_and_says_what_is_missing(made_up, tmp_path, monkeypatch):
    def fails(*_):
        raise ValueError("no room on the disk")

    broken = papers.Paper("t", fails, papers.PAPERS["wang2007"].verdicts)
    monkeypatch.setitem(papers.PAPERS, "wang2007", broken)
    told = CliRunner().invoke(app, ["reproduce", "all", "-o", str(tmp_path / "all"), "--quick", "--quiet"])
    assert told.exit_code == 2
    assert "no room" in told.stderr
    html = (tmp_path / "all" / "index.html").read_text("utf-8")
    assert html.count("still to be run") == 1
    assert "Quick run" in html
    assert made_up == [("cosgrove2004", True), ("flsar2004", True), ("fuse2018", True)]


def test_words_for_verdicts_are_translated_or_refused():
    assert [papers.verdict_of(word) for word in ("holds", "fails", "undecided")] == list(papers.VERDICTS)
    with pytest.raises(ValueError, match="verdict must be one of"):
        papers.verdict_of("perhaps")


def test_reproduce_names_the_papers_it_knows(tmp_path):
    told = CliRunner().invoke(app, ["reproduce", "none2001", "-o", str(tmp_path / "x")])
    assert told.exit_code == 2
    assert all(name in told.stderr for name in (*papers.PAPERS, "all"))
    assert not (tmp_path / "x").exists()
