"""Decibels that plastic mines miss."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

from worlds import detection

pytestmark = pytest.mark.slow("studies of papers")


@pytest.mark.parametrize("chance", [0.0, 0.2])
def test_decibels_that_are_missing_bring_the_papers_pd(chance):
    rng = np.random.default_rng(9)
    tables = []
    for roughness, level in ((1.0, 6.0), (2.0, 0.0)):
        ratio = rng.normal(level, 2.0, 3000)
        share = chance + (1 - chance) * expit(ratio - 3.0)
        far = np.where(rng.random(3000) < share, 0.01, 0.5)
        cell = {
            "kind": "plastic",
            "roughness": roughness,
            "permittivity": 4.5,
            "ratio_db": ratio,
            "far": far,
        }
        cell |= {"chance_0.02": chance, "chance_0.07": chance}
        tables.append(pd.DataFrame(cell))
    missing = detection.missing_decibels(pd.concat(tables)).set_index(["far", "roughness"])[
        "missing_db"
    ]
    assert missing[0.02, 2.0] - missing[0.02, 1.0] == pytest.approx(6.0, abs=0.3)
    spread = rng.normal(0.0, 2.0, 100_000)
    raised = chance + (1 - chance) * expit(missing[0.02, 2.0] + spread - 3.0)
    assert raised.mean() == pytest.approx(0.65, abs=0.03)
    assert missing[0.02, 1.0] < 0  # more is found than in the paper
