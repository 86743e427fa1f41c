"""Text and JSON of agreements and comparisons, with what is not defined."""

import json
from types import SimpleNamespace

import pandas as pd

from flgpr.commands.agree import agreement_json, agreement_lines
from flgpr.commands.score_text import comparison_lines
from flgpr.scoring import agreement

VERDICTS = ("mine", "unsure", "clutter")
ALIKE = agreement(["mine", "mine"], ["mine", "mine"], VERDICTS)
MIXED = agreement(["mine", "clutter", "mine"], ["mine", "clutter", "unsure"], VERDICTS)
POINT = {
    "far_allowed": 0.01, "pd": 0.5, "pd_low": 0.1, "pd_high": 0.9, "n_detected": 1, "n_targets": 2,
    "n_false": 0, "far": 0.0, "far_low": 0.0, "far_high": 0.02,
}  # fmt: skip


def test_what_is_not_defined_is_null():
    [entry] = agreement_json({("anna", "ben"): (ALIKE, 3, 4)})
    assert entry["kappa"] is None
    assert (entry["only_first"], entry["only_second"]) == (3, 4)
    assert entry["table"]["mine"]["mine"] == 2
    json.dumps(entry, allow_nan=False)


def test_an_agreement_has_its_kappa_and_a_table_of_verdicts():
    lines = list(agreement_lines({("anna", "ben"): (MIXED, 0, 1)}))
    assert "anna and ben: 2 of 3 alarms judged alike" in lines[2]
    assert lines[3].startswith(f"  Cohen's kappa {MIXED.kappa:.2f} (")
    assert lines[4] == "  judged by anna alone 0, by ben alone 1"
    assert lines[5].split() == ["anna", *VERDICTS, "ben"]
    assert lines[6].split() == ["mine", "1", "1", "0"]
    undefined = agreement_lines({("anna", "ben"): (ALIKE, 0, 0)})
    assert "  Cohen's kappa not defined: one verdict throughout" in undefined


def test_a_chance_that_is_not_known_is_said_to_be_so():
    points = pd.DataFrame(
        [
            {"detector": "a", "chance": float("nan"), **POINT},
            {"detector": "longer", "chance": 0.25, **POINT},
        ]
    )
    pair = {
        "first": "a", "second": "longer", "far_allowed": 0.01, "difference": -0.5, "low": -1.0,
        "high": 0.25, "only_first": 0, "only_second": 1, "p": 0.5,
    }  # fmt: skip
    comparison = SimpleNamespace(points=points, pairs=pd.DataFrame([pair]), means=None)
    _, _, heading, first, second, difference = comparison_lines(comparison)
    assert heading == "at most 0.01 false alarms per m²"
    assert first.startswith("  a       Pd 0.50 (0.10 to 0.90), 1 of 2, chance not known; 0 false")
    assert "chance 0.25" in second
    assert difference.startswith("  a less longer: -0.50 (-1.00 to +0.25); alone found 0 and 1")
