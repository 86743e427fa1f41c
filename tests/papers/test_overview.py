"""The overview of all papers: made-up findings through the very files that the studies write."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr_papers import overview
from flgpr_papers.kit.findings import (
    NO_VERDICT,
    Finding,
    judge,
    measured,
    read_findings,
    write_findings,
)

pytestmark = pytest.mark.slow("studies of papers")

MADE_UP = {
    "cosgrove2004": [
        replace(measured("A above B", "", "Pd", (0.2, 0.1, 0.31), (0.0, math.inf)), group="open"),
        replace(measured("Anything else?", "", "Pd", (0.0, 0.0, 0.0)), group="open"),
        measured("one seed", "", "Pd", (0.2, -math.inf, math.inf), (0.0, math.inf)),
    ],
    "flsar2004": [measured("n", "p", "q", (0.1, 0.06, 0.2), (-0.05, 0.05))],
    "fuse2018": [
        Finding(
            "less clutter", "26.5 dB", "20 dB (19 to 21)", "disagrees", interval=(20.0, 19.0, 21.0)
        )
    ],
    "wang2007": [Finding("F1 < F2", "0.9 & more", "0.8, 9 of 10", "cannot say")],
}


@pytest.fixture
def made_up(monkeypatch):
    """Studies that only write their findings."""
    order = []

    def run(paper, folder, quick, track=None, world="own"):
        order.append((paper, quick))
        folder.mkdir(exist_ok=True, parents=True)
        write_findings(folder, MADE_UP[paper], quick, world=world)
        return folder / f"{paper}.html"

    monkeypatch.setattr(overview, "run_study", run)
    return order


def test_parts_of_the_studies_are_made_beforehand():
    assert overview.parts_of("wang2007", True) == ["b1", "c1", "c2", "c3"]
    assert overview.parts_of("wang2007", False)[0] == "b1"
    assert overview.parts_of("cosgrove2004", True) == ["1", "2"]
    assert overview.parts_of("fuse2018", True) == [None]


def test_all_papers_are_run_and_their_verdicts_counted(made_up, tmp_path):
    page = overview.reproduce("all", tmp_path / "all")
    assert made_up == [
        ("wang2007", False),
        ("fuse2018", False),
        ("flsar2004", False),
        ("cosgrove2004", False),
    ]
    with (tmp_path / "all" / "verdicts.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [(row["paper"], row["verdict"]) for row in rows] == [
        ("cosgrove2004", "agrees"),
        ("cosgrove2004", "cannot say"),
        ("flsar2004", "disagrees"),
        ("fuse2018", "disagrees"),
        ("wang2007", "cannot say"),
    ]
    assert rows[0]["ours"] == "0.20 (0.10 to 0.31)"
    assert "no interval" in rows[1]["ours"]
    html = page.read_text("utf-8")
    assert (rows[3]["claim"], rows[3]["stated"]) == ("less clutter", "26.5 dB")
    for text in (
        "<td>26.5 dB</td>",
        'href="wang2007/wang2007.html"',
        "0.9 &amp; more",
        "F1 &lt; F2",
    ):
        assert text in html
    assert "://" not in html
    counts = html[html.index(">cosgrove2004</a>") :].split("</tr>")[0]
    assert [int(part[0]) for part in counts.split("<td class=n>")[1:]] == [1, 0, 1, 0]


def test_a_quick_run_of_all_papers_has_no_verdicts(made_up, tmp_path):
    html = overview.reproduce("all", tmp_path / "all", quick=True).read_text("utf-8")
    assert "Quick run" in html
    assert html.count(f"<td colspan=4>{NO_VERDICT}</td>") == 4
    with (tmp_path / "all" / "verdicts.csv").open(newline="") as lines:
        assert {row["verdict"] for row in csv.DictReader(lines)} == {NO_VERDICT}


def test_a_paper_that_fails_leaves_what_is_done_and_says_what_is_missing(
    made_up, tmp_path, monkeypatch
):
    run = overview.run_study

    def fails_at_last(paper, *rest):
        if paper == "cosgrove2004":
            raise ValueError("no room on the disk")
        return run(paper, *rest)

    monkeypatch.setattr(overview, "run_study", fails_at_last)
    told = CliRunner().invoke(
        app, ["reproduce", "all", "-o", str(tmp_path / "all"), "--quick", "--quiet"]
    )
    assert told.exit_code == 2
    assert "no room" in told.stderr
    html = (tmp_path / "all" / "index.html").read_text("utf-8")
    assert html.count("still to be run") == 1
    assert "Quick run" in html
    assert made_up == [("wang2007", True), ("fuse2018", True), ("flsar2004", True)]


@pytest.mark.parametrize(
    ("interval", "verdict"),
    [
        ((0.0, -0.02, 0.03), "agrees"),
        ((0.1, 0.06, 0.2), "disagrees"),
        ((0.04, 0.01, 0.08), "cannot say"),
    ],
)
def test_verdicts_follow_the_rule(interval, verdict):
    assert judge(interval, (-0.05, 0.05)) == verdict
    assert measured("a", "b", "c", interval, (-0.05, 0.05)).verdict == verdict


def test_differences_are_judged_against_zero():
    above_zero = (0.0, math.inf)
    gaps = [(0.5, 0.1, 1), (-0.5, -1, -0.1), (0, -1, 1), (0, 0, 0)]
    assert [judge(gap, above_zero) for gap in gaps] == [
        "agrees",
        "disagrees",
        *["cannot say"] * 2,
    ]
    assert judge((0, 0, 0), above_zero, 0.05) == "disagrees"  # not worth a gain
    assert judge((0.03, -0.04, 0.1), (-0.05, math.inf)) == "agrees"


def test_findings_come_back_as_they_were_written(tmp_path):
    for name in ("flsar2004", "fuse2018", "wang2007"):
        write_findings(tmp_path, MADE_UP[name], False, seeds=3)
        assert read_findings(tmp_path) == MADE_UP[name]
    write_findings(tmp_path, MADE_UP["cosgrove2004"], False)
    *whole, one = read_findings(tmp_path)
    assert whole == MADE_UP["cosgrove2004"][:2]
    assert np.isnan(one.interval[1:]).all()
    assert "Infinity" not in (tmp_path / "findings.json").read_text()


def test_a_study_that_is_there_is_told_and_its_other_form_is_refused(tmp_path, monkeypatch):
    class Study:
        page = "wang2007.html"

        @staticmethod
        def reproduce(folder, quick, _, world):
            folder.mkdir(exist_ok=True, parents=True)
            write_findings(folder, MADE_UP["wang2007"], quick, world=world)
            (folder / "wang2007.html").write_text("quick" if quick else "full")
            return folder / "wang2007.html"

    monkeypatch.setattr(overview, "study_of", lambda _: Study)
    words = ["reproduce", "wang2007", "-o", str(tmp_path / "w")]
    assert "exists already" not in CliRunner().invoke(app, [*words, "--quick"]).stderr
    again = CliRunner().invoke(app, [*words, "--quick"])
    assert again.exit_code == 0
    assert "wang2007.html exists already" in again.stderr
    full = CliRunner().invoke(app, words)
    assert full.exit_code == 2
    assert "with the quick form: choose another output" in full.stderr
    assert (tmp_path / "w" / "wang2007.html").read_text() == "quick"
    as_found = CliRunner().invoke(app, [*words, "--quick", "--world", "as-found"])
    assert as_found.exit_code == 0
    assert (
        json.loads((tmp_path / "w" / "as-found" / "findings.json").read_text())["world"]
        == "as-found"
    )
    assert json.loads((tmp_path / "w" / "findings.json").read_text())["world"] == "own"


def test_results_of_another_world_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(overview, "study_of", lambda _: pytest.fail("ran"))
    write_findings(tmp_path, MADE_UP["wang2007"], False)  # as before there were two worlds
    with pytest.raises(
        FileExistsError, match="lanes of the world 'as-found': choose another output"
    ):
        overview.reproduce("wang2007", tmp_path)
    with pytest.raises(ValueError, match="world must be one of own, as-found, got 'mars'"):
        overview.reproduce("wang2007", tmp_path, world="mars")
    told = CliRunner().invoke(
        app, ["reproduce", "worlds", "--world", "as-found", "-o", str(tmp_path / "x")]
    )
    assert told.exit_code == 2
    assert "it is now python evidence/worlds" in told.stderr


def test_both_worlds_of_all_papers_have_an_overview(made_up, tmp_path):
    folder = tmp_path / "all"
    assert overview.reproduce("all", folder, world="as-found") == folder / "as-found.html"
    assert overview.reproduce("all", folder) == folder / "index.html"
    own, as_found = ((folder / name).read_text("utf-8") for name in ("index.html", "as-found.html"))
    assert 'href="wang2007/wang2007.html"' in own
    assert 'href="as-found.html"' in own
    assert 'href="wang2007/as-found/wang2007.html"' in as_found
    assert "roads as found" in as_found
    assert (folder / "verdicts.csv").read_bytes() == (folder / "verdicts-as-found.csv").read_bytes()
