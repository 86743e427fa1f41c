"""Truths are sealed, and alarm lists are scored against them."""

import json

import pytest

from flgpr.commands.sealed_scoring import score_sealed, seal_truth_file
from flgpr.trials import content_hash, head_of, read_register

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
