"""Truths are sealed, and alarm lists are scored against them."""

import json

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.trials import content_hash, head_of, read_register
from flgpr_trials.sealing import require_seal
from scored_blind import holds_sealed_score, score_sealed, seal_truth_file

PHRASE = "correct horse battery"


def test_a_truth_is_sealed_and_scored_blind(scoring_files):
    pytest.importorskip("cryptography")
    sealed = seal_truth_file(
        scoring_files / "truth.csv", scoring_files / "lane.toml", scoring_files / "sealed", PHRASE
    )
    score = score_sealed(scoring_files / "alarms.csv", sealed, PHRASE, scoring_files / "blind")
    assert score.counts["n_targets"] == 2
    told = json.loads((scoring_files / "blind" / "roc.json").read_text())
    assert told["notes"] == {
        "looks": 1, "lists": 1, "alarms_sha256": content_hash(scoring_files / "alarms.csv"),
        "sealed_sha256": content_hash(sealed), "log": head_of(read_register(f"{sealed}.log.jsonl")),
    }  # fmt: skip
    assert "threshold" not in told["detections"]["main"]["points"][0]
    assert "targets" not in told["detections"]["main"]
    with pytest.raises(FileNotFoundError, match="sealed truth not found"):
        score_sealed(scoring_files / "alarms.csv", scoring_files / "none", PHRASE)


def test_a_seal_is_left_if_it_is_the_same_and_refused_otherwise(scoring_files):
    pytest.importorskip("cryptography")
    truth = scoring_files / "truth.csv"
    lane = scoring_files / "lane.toml"
    sealed = seal_truth_file(truth, lane, scoring_files / "sealed", PHRASE)
    data = sealed.read_bytes()
    assert seal_truth_file(truth, lane, sealed, PHRASE) == sealed
    assert sealed.read_bytes() == data
    with pytest.raises(FileExistsError, match="output must not exist yet"):
        seal_truth_file(truth, lane, sealed, PHRASE, halo=2.0)
    with pytest.raises(FileExistsError, match="sealed with another passphrase"):
        seal_truth_file(truth, lane, sealed, "another horse battery")
    assert sealed.read_bytes() == data


def test_a_score_that_is_there_costs_no_look(scoring_files):
    pytest.importorskip("cryptography")
    alarms = scoring_files / "alarms.csv"
    folder = scoring_files / "blind"
    sealed = seal_truth_file(
        scoring_files / "truth.csv", scoring_files / "lane.toml", scoring_files / "sealed", PHRASE
    )
    assert not holds_sealed_score(alarms, sealed, folder)
    score_sealed(alarms, sealed, PHRASE, folder)
    assert holds_sealed_score(alarms, sealed, folder)
    alarms.write_text("x,y,confidence\n0,10,1\n")
    with pytest.raises(FileExistsError, match=r"roc\.json, which holds something else"):
        holds_sealed_score(alarms, sealed, folder)
    assert len(read_register(f"{sealed}.log.jsonl")) == 1


def test_a_library_that_is_missing_is_told_before_a_passphrase_is_typed(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "zxcvbn" else name)
    with pytest.raises(ModuleNotFoundError, match=r"library zxcvbn: pip install 'flgpr\[seal\]'"):
        require_seal()


def test_the_verb_seals_and_several_lists_are_for_a_verdict(scoring_files):
    pytest.importorskip("cryptography")
    truth, lane, sealed = (str(scoring_files / name) for name in ("truth.csv", "lane.toml", "s"))
    told = CliRunner().invoke(
        app, ["seal", truth, "--lane", lane, "-o", sealed], input=f"{PHRASE}\n{PHRASE}\n"
    )
    assert told.exit_code == 0, told.output
    assert told.stdout.endswith(f"wrote {sealed}\n")
    assert "now" not in told.stderr.splitlines()[-1]
    lists = [str(scoring_files / name) for name in ("alarms.csv", "alarms.csv")]
    refused = CliRunner().invoke(app, ["score", *lists, "--sealed", sealed])
    assert "`flgpr trial verdict` judges several, got 2 lists" in refused.stderr
    refused = CliRunner().invoke(app, ["score", lists[0], "--sealed", sealed, "--halo", "1"])
    assert "the truth was sealed with, got --halo" in refused.stderr
