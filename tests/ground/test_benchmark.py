"""``flgpr benchmark``: lists, and arguments as they arrive at the proving ground."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr_ground.commands.benchmark import benchmark_table, list_benchmark, run_benchmark


def test_entries_splits_and_lanes_are_listed():
    lines = list_benchmark(quick=True)
    heads = [lines.index(name) for name in ("entries:", "splits:", "lanes:")]
    assert heads == sorted(heads)
    assert any(line.split()[:1] == ["wang2007"] for line in lines[heads[0] : heads[1]])
    words = CliRunner().invoke(app, ["benchmark", "list", "--quick"])
    assert words.exit_code == 0, words.output
    assert words.stdout.splitlines() == lines


def test_a_ground_that_is_not_known_is_refused_in_a_line():
    done = CliRunner().invoke(app, ["benchmark", "list", "--ground", "no-ground"])
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    assert "no-ground" in done.output


def test_the_table_of_several_folders_is_written_to_the_first(monkeypatch):
    written = []

    def write_score_tables(folders, output):
        written.append((folders, output))
        return "table"

    monkeypatch.setattr("flgpr.proving_ground.write_score_tables", write_score_tables)
    assert benchmark_table(["a", "b"]) == "table"
    assert benchmark_table(["a", "b"], "c") == "table"
    assert written == [(["a", "b"], "a"), (["a", "b"], "c")]


def test_a_run_states_its_page(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("flgpr.proving_ground.run_benchmark", lambda *given: asked.append(given))
    monkeypatch.setattr("flgpr.proving_ground.write_score_tables", lambda *_: "table")
    monkeypatch.setattr("flgpr.proving_ground.write_submissions", lambda _: [])
    words = ["benchmark", "run", "wang2007", "--quick", "--tier", "prepared"]
    done = CliRunner().invoke(app, [*words, "--workers", "2", "-o", str(tmp_path / "ground")])
    assert done.exit_code == 0, done.output
    [(entries, output, quick, options, ground, tier)] = asked
    assert (entries, Path(output), quick) == (["wang2007"], tmp_path / "ground", True)
    assert (ground, tier, options.workers) == (None, "prepared", 2)
    assert done.stdout.splitlines()[-2:] == [
        "table", f"page: {(tmp_path / 'ground' / 'index.html').resolve()}"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("tier", "status"), [((), 1), (("--tier", "rough"), 1), (("--tier", "smooth"), 0)]
)
def test_a_class_that_does_not_finish_ends_the_run_with_status_1(
    tier, status, monkeypatch, tmp_path
):
    table = "scores\nmy-detector did not finish on the tier rough: fit must not fail"
    monkeypatch.setattr("flgpr.proving_ground.run_benchmark", lambda *_: None)
    monkeypatch.setattr("flgpr.proving_ground.write_score_tables", lambda *_: table)
    monkeypatch.setattr("flgpr.proving_ground.write_submissions", lambda _: [])
    words = ["benchmark", "run", "module:MyDetector", *tier, "-o", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == status, done.output
    assert ("has no score where it failed: my-detector" in done.stdout) == bool(status)


def test_a_tier_that_the_ground_has_not_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"tier must be one of those of .*, got 'muddy'"):
        run_benchmark(["wang2007"], tmp_path / "ground", quick=True, tier="muddy")
