"""Tables of verdicts: numbers of repeats in place of a study's, and single experiments beside them."""

import csv
import math
import sys
from dataclasses import replace

import pytest

import verdict_tables
from flgpr_papers.kit.findings import OPEN, Finding, measured, write_findings

pytestmark = pytest.mark.slow("studies of papers")
ABOVE_ZERO = (0.0, math.inf)


def test_repeats_stand_in_the_table(tmp_path, monkeypatch, capsys):
    study = tmp_path / "studies" / "wang2007"
    (study / "replicates").mkdir(parents=True)
    one = [
        measured("A beats B", "yes", "", (0.1, -0.1, 0.3), ABOVE_ZERO, 0.05),
        measured("RVM and SVM alike", "yes", "", (0.0, -0.2, 0.2), (-0.1, 0.1)),
        Finding("asked by us", "not tried", "1", OPEN),
    ]
    many = [
        measured("A beats B", "yes", "", (0.1, 0.05, 0.15), ABOVE_ZERO, 0.05),
        measured("RVM and SVM alike", "yes", "", (0.0, -0.01, 0.01), (-0.1, 0.1)),
    ]
    shown = [replace(finding, shown=(7, 9)) for finding in many]
    write_findings(study, one, quick=False)
    write_findings(study / "replicates", shown, quick=False)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "studies"), str(tmp_path)])
    verdict_tables.main()
    with (tmp_path / "wang2007.csv").open(encoding="utf-8") as file:
        header, first, second = csv.reader(file)
    assert header[2:7] == ["rule", "prepared", "power", "experiments that show it", "verdict"]
    assert first[2:4] == ["above 0, worth 0.05", many[0].ours]
    assert first[5:] == ["7 of 9", "agrees", "–", "–"]
    assert second[3] == many[1].ours
    assert second[5:] == ["7 of 9", "agrees", "–", "–"]
    assert "2 agrees, 0 disagrees, 0 cannot say" in capsys.readouterr().out


def test_what_did_not_run_again_keeps_its_cells(tmp_path, monkeypatch):
    """One study of one world at a time renews a table; repeats alone do, too."""
    study = tmp_path / "studies" / "wang2007"
    (study / "as-found").mkdir(parents=True)
    found = [
        measured("A beats B", "yes", "", (0.1, -0.1, 0.3), ABOVE_ZERO, 0.05),
        measured("RVM and SVM alike", "yes", "", (0.0, -0.2, 0.2), (-0.1, 0.1)),
    ]
    write_findings(study, found, quick=False)
    write_findings(study / "as-found", found[:1], quick=False)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "studies"), str(tmp_path)])
    verdict_tables.main()
    with (tmp_path / "wang2007.csv").open(encoding="utf-8") as file:
        before = list(csv.reader(file))

    (study / "findings.json").unlink()
    (study / "as-found" / "findings.json").unlink()
    again = measured("A beats B", "yes", "", (0.2, 0.15, 0.25), ABOVE_ZERO, 0.05)
    more = measured("A beats C", "yes", "", (0.2, 0.15, 0.25), ABOVE_ZERO, 0.05)
    (study / "replicates").mkdir()
    write_findings(study / "replicates", [again, more], quick=False)
    verdict_tables.main()
    with (tmp_path / "wang2007.csv").open(encoding="utf-8") as file:
        header, first, second, third = csv.reader(file)
    assert header == before[0]
    assert (first[3], first[6]) == (again.ours, "agrees")
    assert first[7:] == before[1][7:]
    assert second == before[2]
    assert (third[0], third[6]) == ("A beats C", "agrees")
