"""How far two analysts agree who judged the same alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flgpr.scoring.intervals import clopper_pearson


@dataclass(frozen=True)
class Agreement:
    """Agreement of two analysts, and Cohen's kappa: what of it chance does not explain."""

    table: pd.DataFrame  #: counts: verdicts of the first (rows) by those of the second (columns)
    n: int  #: alarms that both judged
    agreed: int  #: alarms that they judged alike
    #: share, share_low, share_high: share of these with its exact interval
    share: float
    share_low: float
    share_high: float
    expected: float  #: share that analysts with these shares of verdicts would judge alike by chance
    #: kappa, kappa_low, kappa_high: NaN where both gave one and the same verdict throughout: chance explains all of it
    kappa: float
    kappa_low: float
    kappa_high: float


def agreement(first: Sequence[str], second: Sequence[str], categories: Sequence[str], level: float = 0.95) -> Agreement:
    """Compare verdicts of two analysts on the same alarms, in the same order.

    Kappa is that of Cohen 1960, Eq. 1 ("A coefficient of agreement for nominal scales", Educ. Psychol. Meas. 20); its
    interval is the exact one of the agreement with the chance agreement taken as given, as there: it covers at least as
    often as the level says, also where all verdicts agree. Verdicts that are no category are a ValueError.

    Examples
    --------
    Of ten alarms, half mines to both, they judge eight alike.

    >>> from flgpr.scoring import agreement
    >>> told = agreement([*"mmmmmccccc"], [*"mmmmcmcccc"], ["m", "c"])
    >>> told.agreed, round(told.kappa, 2), round(told.kappa_low, 2), round(told.kappa_high, 2)
    (8, 0.6, -0.11, 0.95)
    """
    if len(first) != len(second) or not len(first):
        raise ValueError(f"verdicts must be of the same alarms, at least one, got {len(first)} and {len(second)}")
    strange = sorted({str(one) for one in [*first, *second] if one not in categories})
    if strange:
        raise ValueError(f"verdicts must be {', '.join(categories)}, got {', '.join(strange)}")
    names = pd.Index(categories)
    counts = np.zeros((len(names), len(names)), dtype=np.int64)
    np.add.at(counts, (names.get_indexer(pd.Index(first)), names.get_indexer(pd.Index(second))), 1)
    n, agreed = int(counts.sum()), int(np.trace(counts))
    expected = float((counts.sum(axis=0) * counts.sum(axis=1)).sum() / n**2)
    low, high = (float(one) for one in clopper_pearson(agreed, n, level))
    shares = agreed / n, low, high
    kappas = [(one - expected) / (1 - expected) if expected < 1 else np.nan for one in shares]
    return Agreement(pd.DataFrame(counts, names, names), n, agreed, *shares, expected, *kappas)
