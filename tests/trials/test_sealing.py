"""A sealed truth hides what it holds, opens with its passphrase alone, and is never half valid."""

import json

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.trials import open_truth, seal_truth
from flgpr_trials.sealing import decrypt_truth, seals, to_seal

LANE = Lane(0.0, 4.0, 0.0, 30.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b", "c"],
        "x": [1.123, 2.0, 3.0],
        "y": [5.0, 10.0, 15.987],
        "kind": ["metal", "metal", "plastic"],
        "depth": [0.0, np.nan, 0.1],
    }
)
PHRASE = "correct horse battery"


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    pytest.importorskip("cryptography")
    return seal_truth(TRUTH, LANE, tmp_path_factory.mktemp("sealed") / "sealed", PHRASE)


def test_a_sealed_truth_hides_the_truth_and_opens_with_its_passphrase(sealed):
    text = sealed.read_text()
    for word in ("1.123", "15.987", "metal", "target_id"):
        assert word not in text
    truth, lanes, rules = open_truth(sealed, PHRASE)
    pd.testing.assert_frame_equal(truth, TRUTH)
    assert Lane(**lanes[""]) == LANE
    assert rules == {"halo": 1.0, "area": "union", "by": "kind", "show": "curve"}


def test_a_wrong_passphrase_opens_nothing(sealed, tmp_path):
    with pytest.raises(ValueError, match="passphrase must be the one"):
        open_truth(sealed, "wrong passphrase")
    bent = tmp_path / "bent"
    for text in (
        "no json",
        "{}",
        json.dumps({**json.loads(sealed.read_text()), "format": "other"}),
    ):
        bent.write_text(text)
        with pytest.raises(ValueError, match="format flgpr-sealed-truth-2"):
            open_truth(bent, PHRASE)


def test_the_key_costs_what_is_promised(sealed):
    assert json.loads(sealed.read_text())["scrypt"]["n"] >= 2**17


def test_a_truth_that_cannot_be_scored_is_never_sealed(tmp_path):
    pytest.importorskip("cryptography")
    for truth, options, message in (
        (TRUTH.drop(columns="kind"), {"by": None}, "columns kind"),
        (TRUTH, {"halo": 40.0}, "area must be positive"),
        (TRUTH, {"by": "soil"}, "by must name a column"),
        (TRUTH, {"area": "frames"}, "frame_area must be given"),
    ):
        with pytest.raises(ValueError, match=message):
            seal_truth(truth, LANE, tmp_path / "s", PHRASE, **options)
    with pytest.raises(ValueError, match="at least 8 characters"):
        seal_truth(TRUTH, LANE, tmp_path / "s", "short")
    assert not (tmp_path / "s").exists()


def test_a_sealed_file_is_not_overwritten(sealed):
    with pytest.raises(FileExistsError):
        seal_truth(TRUTH, LANE, sealed, pytest.fail)


def test_a_decrypted_truth_is_no_look(sealed):
    log = sealed.with_name("sealed.log.jsonl")
    before = log.read_bytes() if log.exists() else None
    assert decrypt_truth(sealed, PHRASE).rules["halo"] == 1.0
    assert (log.read_bytes() if log.exists() else None) == before


def test_a_file_seals_its_truth_lane_and_rules_and_no_others(sealed):
    assert seals(sealed, PHRASE, to_seal(TRUTH, LANE)) == (True, None)
    assert seals(sealed, PHRASE, to_seal(TRUTH, LANE, halo=0.5)) == (False, None)
    assert seals(sealed, PHRASE, to_seal(TRUTH.assign(depth=0.2), LANE)) == (False, None)
    assert seals(sealed, "wrong passphrase", to_seal(TRUTH, LANE)) == (False, None)
