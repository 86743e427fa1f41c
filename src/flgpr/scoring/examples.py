"""ROC of classifier scores example by example (flsar2004, par. 45 and 52)."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from flgpr.scoring.curve import count_at, describe, make_curve


def example_roc(
    score: ArrayLike,
    is_target: ArrayLike,
    area: float,
    *,
    n_targets: int | None = None,
    repeats: int = 1,
    level: float = 0.95,
) -> pd.DataFrame:
    """Compute the ROC of held-out scores of examples, false alarms over the area that was searched.

    Every example that passed the prescreener counts by itself, whether or not another shows the same mine.

    Parameters
    ----------
    score : (example,) array_like
        Held-out score of each example, e.g. leave-one-out.
    is_target : (example,) array_like of bool
        Whether it shows a target.
    area : float
        Area that was searched to find the examples, m².
    n_targets : int, optional
        Number of target examples with those that a prescreener lost; by default none was lost.
    repeats : int
        How often each clutter example occurs, e.g. once for each held-out mine with a one-class detector
        (flsar2004, par. 52); the false alarms are divided by it.
    level : float
        Level of the exact intervals of each row.

    Returns
    -------
    DataFrame
        As of :func:`flgpr.scoring.roc`.

    Raises
    ------
    ValueError
        If shapes differ, a score is not finite, ``n_targets`` is less than the target examples, or ``repeats`` does
        not divide the number of clutter examples.

    Examples
    --------
    >>> from flgpr.scoring import example_roc
    >>> curve = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
    >>> curve[["threshold", "pd", "far"]].round(3)
       threshold     pd   far
    0        inf  0.000  0.00
    1        4.0  0.333  0.00
    2        3.0  0.333  0.02
    3        2.0  0.667  0.02
    4        1.0  1.000  0.02
    """
    scores, mine = np.asarray(score, dtype=np.float64), np.asarray(is_target)
    if scores.ndim != 1 or mine.shape != scores.shape:
        raise ValueError(f"score and is_target must be of one length, got shapes {scores.shape} and {mine.shape}")
    if not np.isin(mine, (0, 1)).all():
        raise ValueError(f"is_target must hold truth values, got {np.unique(mine)[:4]}")
    if not np.isfinite(scores).all():
        raise ValueError(f"score must be finite, got {int((~np.isfinite(scores)).sum())} values that are not")
    mine = mine.astype(bool)
    found = int(mine.sum())
    total = found if n_targets is None else int(n_targets)
    if total < found:
        raise ValueError(f"n_targets must be at least the {found} target examples, got {n_targets}")
    if repeats < 1 or (len(scores) - found) % repeats:
        raise ValueError(f"repeats must divide the {len(scores) - found} clutter examples, got {repeats}")
    if not (math.isfinite(area) and area > 0):
        raise ValueError(f"area must be positive, got {area}")
    thresholds = np.append(np.inf, np.unique(scores)[::-1])
    n_false = count_at(thresholds, scores[~mine])
    attrs = {**describe("examples"), "n_examples": len(scores), "n_prescreened": found, "repeats": int(repeats)}
    counted = n_false if repeats == 1 else n_false / repeats
    return make_curve(thresholds, count_at(thresholds, scores[mine]), counted, total, area, attrs, level)
