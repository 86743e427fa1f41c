"""Scores as text, and lanes that are compared by their fingerprints."""

import numpy as np
import pandas as pd

from flgpr.proving_ground.fingerprints import _compared
from flgpr.proving_ground.table import paired_in_words, pd_in_words

SCORE = {
    "pd": 0.5, "pd_low": 0.25, "pd_high": 0.75, "n_detected": 6, "n_targets": 12, "n_false": 3,
    "chance": 0.125,
}  # fmt: skip


def test_a_pd_is_written_with_its_interval_counts_and_chance():
    words = "0.50 (0.25 to 0.75), 6 of 12, 3 false, chance 0.12"
    assert pd_in_words(SCORE) == words


def test_the_reference_is_not_compared_with_itself():
    assert paired_in_words(SCORE) == ""
    assert paired_in_words(SCORE | {"p": np.nan}) == ""
    paired = SCORE | {"p": 0.0313, "only": 5, "reference_only": 0}
    assert paired_in_words(paired, "; against wang2007 ") == "; against wang2007 +5 -0, p = 0.031"


def test_lanes_are_the_same_bits_alike_or_others():
    known = pd.Series({"sha256": "a", "HH": 1.0, "VV": 2.0})
    assert _compared(known, known) == "same bits"
    assert _compared(pd.Series({"sha256": "b", "HH": 1.00005, "VV": 2.0}), known) == "alike"
    assert _compared(pd.Series({"sha256": "b", "HH": 1.0005, "VV": 2.0}), known) == "other"
