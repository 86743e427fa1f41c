"""Who found what: the best alarm of every target, and what every alarm was."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.scoring.curve import count_at
from flgpr.scoring.lane_roc import AreaRule, far_area
from flgpr.scoring.matching import Match


def assign(matched: Match, area: AreaRule = "union", frame_area: float | None = None) -> pd.DataFrame:
    """Tell for every target which alarm is its best one and what it costs to find it.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.
    area, frame_area
        Area of the FAR, as for :func:`flgpr.scoring.roc`.

    Returns
    -------
    DataFrame
        The truth table's columns and, per target: ``detected``, whether any alarm is in its halo; ``alarm``, row of
        its best alarm (-1 for none); ``confidence`` (-inf for none); ``distance`` of that alarm, m (NaN); ``rank``
        among all alarms, 1 for the highest, ties sharing the best rank (0 for none); ``n_false``, the false alarms at
        or above that confidence; ``far``, the same per m² (inf for none): the FAR at which the target is found.
    """
    alarm, confidence, distance = matched.best()
    found = alarm >= 0
    total = far_area(matched, area, frame_area)
    n_false = count_at(confidence, matched.confidence[matched.false])
    above = count_at(np.nextafter(confidence, np.inf), matched.confidence)
    return matched.truth.assign(
        detected=found,
        alarm=alarm,
        confidence=confidence,
        distance=distance,
        rank=np.where(found, above + 1, 0),
        n_false=n_false,
        far=np.where(found, n_false / total, np.inf),
    )


def label_alarms(matched: Match) -> pd.DataFrame:
    """Tell for every alarm of a match what it counts as.

    The alarm table gets ``label``, one of "detection" (the best alarm of a target), "ignored" (in a halo, but another
    alarm is better), "false" and "outside" (in no halo and outside the lane); ``target``, row of the nearest target
    within a halo (-1 for none); ``distance`` to it, m (NaN for none).
    """
    best = matched.best()[0]
    label = np.where(matched.in_halo, "ignored", np.where(matched.false, "false", "outside")).astype(object)
    label[best[best >= 0]] = "detection"
    target, distance = np.full(len(label), -1), np.full(len(label), np.nan)
    order = np.lexsort((matched.pair_target, matched.pair_distance, matched.pair_alarm))
    first = order[np.unique(matched.pair_alarm[order], return_index=True)[1]]
    target[matched.pair_alarm[first]] = matched.pair_target[first]
    distance[matched.pair_alarm[first]] = matched.pair_distance[first]
    return matched.alarms.assign(label=label, target=target, distance=distance)
