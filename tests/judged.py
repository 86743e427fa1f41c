"""Verdicts on lists that find some of the mines of a lane, as tests ask for them."""

import numpy as np
import pandas as pd

from flgpr.model import Lane
from flgpr.scoring import Rules, match
from flgpr_trials.folder import Requirement
from flgpr_trials.verdict import judge

LANE = Lane(-2, 2, 0, 300)
WANTED = Requirement(pd=0.9, far=0.05, confidence=0.95)
RULES = Rules(shifts=20)


def truth_of(count):
    table = pd.DataFrame({"target_id": [f"T{n}" for n in range(count)], "x": 0.0})
    return table.assign(y=5.0 + 9 * np.arange(count), kind="metal", depth=0.05)


def judged(found, count=31, **changes):
    """Return the verdict on lists that find the first or, if negative, the last mines of a lane."""
    truth = truth_of(count)
    matches = {}
    for vendor, number in found.items():
        hits = truth[:number] if number >= 0 else truth[number:]
        alarms = hits[["x", "y"]].assign(confidence=1.0)
        matches[vendor] = match(alarms, truth, LANE, 1.0)
    return judge(matches, WANTED.model_copy(update=changes), RULES)
