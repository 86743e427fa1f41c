"""Repeats of an experiment: kept on disk, judged together, and counted one by one."""

import numpy as np
import pytest

import replicates
from flgpr_papers.kit.findings import AGREES, UNDECIDED, Finding, read_findings
from flgpr_papers.kit.intervals import students
from flgpr_papers.wang2007.lanes import calibration_scenes

pytestmark = pytest.mark.slow("studies of papers")
VALUES = np.random.default_rng(4).normal(0.1, 0.05, 12)


@pytest.fixture
def runs(monkeypatch, tmp_path):
    """Stand in for the experiment of a paper; returns the numbers of the replicates that ran."""
    numbers = []

    def experiment(folder):
        def run(number):
            numbers.append(number)
            value = float(VALUES[number - 1])
            rule = (0.0, np.inf)
            return [
                Finding("A beats B", "", "", UNDECIDED, interval=(value, -1.0, 1.0), rule=rule),
                Finding("not asked", "", "", "open", interval=(value, -1.0, 1.0)),
            ]

        return run

    monkeypatch.setitem(replicates.EXPERIMENTS, "wang2007", experiment)
    monkeypatch.setattr(replicates, "STORED", tmp_path / "none")
    return numbers


def test_replicates_resume_and_are_judged_together(runs, tmp_path):
    replicates.main([str(tmp_path), "wang2007", "--count", "4"])
    replicates.main([str(tmp_path), "wang2007", "--count", "12"])
    assert runs == list(range(1, 13))
    (found,) = read_findings(tmp_path / "wang2007" / "replicates")
    assert found.interval == pytest.approx(students(VALUES))
    assert found.verdict == AGREES
    assert found.shown == (int((VALUES > 0).sum()), 12)


def test_no_replicate_begins_after_its_time(runs, tmp_path):
    replicates.main([str(tmp_path), "wang2007", "--count", "2"])
    replicates.main([str(tmp_path), "wang2007", "--count", "3", "--minutes", "-1"])
    assert runs == [1, 2]
    (found,) = read_findings(tmp_path / "wang2007" / "replicates")
    assert found.shown == (2, 2)


def test_replicates_that_ran_before_are_taken_as_they_are(runs, tmp_path, monkeypatch):
    replicates.main([str(tmp_path / "before"), "wang2007", "--count", "2"])
    stored = tmp_path / "stored" / "wang2007"
    stored.parent.mkdir()
    (tmp_path / "before" / "wang2007" / "replicates").rename(stored)
    monkeypatch.setattr(replicates, "STORED", stored.parent)
    replicates.main([str(tmp_path / "anew"), "wang2007", "--count", "3"])
    assert runs == [1, 2, 3]


def test_a_replicate_has_the_same_mines_on_other_lanes():
    lanes = calibration_scenes()
    again = calibration_scenes(replicate=3)
    for name, (scene, seed) in lanes.items():
        assert again[name] == (scene, seed + 3000)
