"""What further looks will make of an alarm's probability, learnt from what the alarms of training lanes became.

The map at a place is the mean of its looks, weighed by their distances, and the confidence its
logistic regression. So after looks of the weights w, W having been gathered, log odds z become z +
A e, where A = Σw / (W + Σw) is known from where the vehicle will be, and e is how far the new looks
lie off the mean so far. It is taken as Gaussian,

    e ~ N(a + (b + c p) z, σ² (ρ + (1 - ρ) Σw² / (Σw)²)),  ln σ = g + h p,  p = 1 / (1 + exp(-z)):

alarms are maxima, so that clutter comes lower when looked at again (b), a mine less so (c) and with a wider spread (h);
looks at a place are alike (ρ).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.estimators import TrainedEstimator
from flgpr.chain.model import Model
from flgpr.chain.passes import Arrays
from flgpr.chain.recipe import Recipe
from flgpr.io import Scan
from flgpr.live.detector import LiveAlarm, LiveDetector
from flgpr.model import complete_scans

NAME = "live.forecast"
"""Where a model keeps it, beside what its stages have learnt."""
_SIDE = 1.2816  # standard deviations to either side that hold 80 % of a Gaussian
_LEAST = 40  # looks at training alarms from which six numbers are learnt
_LARGEST = 30.0  # of log odds: farther off they tell no more


class Followed(NamedTuple):
    """An alarm's log odds when ``seen`` was the weight of its looks, and after further ones of so much in all."""

    odds: float
    seen: float
    total: float
    squares: float  #: of the weights of the further looks
    later: float


@dataclass(frozen=True)
class Forecast:
    """The numbers a, b, c, g, h and ρ."""

    mean: tuple[float, float, float]
    spread: tuple[float, float]
    correlation: float

    def after(self, odds: float, seen: float, looks: Sequence[float]) -> tuple[float, float]:
        """Mean and standard deviation of log odds after ``looks`` of these weights, of which ``seen`` are gathered."""
        (a, b, c), (g, h), rho = self.mean, self.spread, self.correlation
        total = sum(looks)
        known = min(max(odds, -_LARGEST), _LARGEST)
        p = _probability(odds)
        share = total / (seen + total)
        alike = rho + (1 - rho) * sum(one * one for one in looks) / total**2
        return odds + share * (a + (b + c * p) * known), share * math.exp(g + h * p) * math.sqrt(
            alike
        )

    def arrays(self) -> Arrays:
        """Give its arrays."""
        return {
            "mean": np.array(self.mean),
            "spread": np.array(self.spread),
            "correlation": np.array(self.correlation),
        }


def foresees(recipe: Recipe, model: Model) -> bool:
    """Tell whether a recipe's looks and confidence are such that what comes can be told: a mean, and its log odds."""
    detector = model.detector
    linear = isinstance(detector, TrainedEstimator) and detector.linear_in_magnitude
    return linear and recipe.run_view.look == "mean" and not recipe.waits()


def forecast_of(recipe: Recipe, model: Model) -> Forecast | None:
    """Give what a model has learnt of further looks; a UserWarning and None where it could have, but has not."""
    if not foresees(recipe, model):
        return None
    learnt = model.stages.get(NAME)
    if learnt is None:
        looks = model.notes.get(NAME, {}).get("looks", 0)
        why = (
            f"its lanes gave too few, {looks} looks at alarms of {_LEAST}: train on longer lanes, or on more of them"
            if NAME in model.notes
            else "it was trained before that was learnt; train it again"
        )
        warnings.warn(f"model does not tell what further looks are worth: {why}", stacklevel=2)
        return None
    shapes = {name: one.shape for name, one in learnt.items()}
    known = {"mean": (3,), "spread": (2,), "correlation": ()}
    numbers = all(one.dtype == np.float64 for one in learnt.values())
    if shapes != known or not numbers or not all(np.isfinite(one).all() for one in learnt.values()):
        raise ValueError(
            f"model must hold finite {NAME} of shapes {known}, got {shapes}: train it again"
        )
    (a, b, c), (g, h) = learnt["mean"].tolist(), learnt["spread"].tolist()
    return Forecast((a, b, c), (g, h), float(learnt["correlation"]))


def told(
    forecast: Forecast,
    detector: LiveDetector,
    alarm: LiveAlarm,
    margin: float | None,
    threshold: float,
    worth: float,
) -> dict[str, Any]:
    """Tell an alarm's probability and, of an open one, what further looks will make of it: members of its event.

    The looks are those to come if the vehicle drives straight on in steps as before. ``margin`` is the room left now
    to stop before it, m; None where no speed is known: then every look counts, and whether to wait is left open. It is
    worth it if the next look still leaves room, and the probability that it brings the confidence to the other side of
    ``threshold`` is ``worth`` or more.
    """
    odds = alarm.confidence
    if alarm.state in ("withdrawn", "final"):
        return {"p": round(_probability(odds), 4)}
    coming = detector.coming(alarm)
    looks = [weight for _, weight in coming]
    left = sum(margin is None or way <= margin for way, _ in coming)
    event: dict[str, Any] = {"p": round(_probability(odds), 4), "looks_left": left}
    if looks:
        _, seen = detector.looked(alarm)
        mean, deviation = forecast.after(odds, seen, looks[:1])
        event["next_p"] = _interval(mean, deviation)
        across = math.erfc(abs(mean - threshold) / deviation / math.sqrt(2)) / 2
        change = across if (mean < threshold) == (odds < threshold) else 1 - across
        event["change"] = round(change, 4)
        if left:
            event["last_p"] = _interval(*forecast.after(odds, seen, looks[:left]))
    if margin is not None:
        event["wait"] = left > 0 and event["change"] >= worth
    return event


def follow(detector: LiveDetector, run: xr.Dataset) -> Iterator[Followed]:
    """Play a stored run to a detector and tell what became of every alarm after each of its further looks.

    An alarm's log odds are its own as long as it stands, afterwards the map's at its place.
    """
    open_: list[tuple[LiveAlarm, float, list[float]]] = []
    for scan in _scans(run):
        if detector.add(scan).outcome != "taken":
            continue
        going = []
        for alarm, seen, looks in open_:
            if alarm.y <= detector.closed:
                continue
            value, weight = detector.looked(alarm)
            new = weight - seen - sum(looks)
            if new > 1e-9 * weight:
                looks.append(new)
                same = detector.alarms.get(alarm.alarm_id)
                later = same.confidence if same is not None else _confidence(detector, value)
                yield Followed(alarm.confidence, seen, sum(looks), sum(w * w for w in looks), later)
            going.append((alarm, seen, looks))
        open_ = going + [(one, detector.looked(one)[1], []) for one in detector.alarms.values()]


def learn(followed: Iterable[Followed]) -> tuple[Arrays, dict[str, Any]]:
    """Learn the likeliest numbers; nothing where alarms were looked at again too seldom."""
    from scipy.optimize import minimize
    from scipy.special import expit

    rows = np.fromiter(followed, np.dtype((np.float64, len(Followed._fields))))
    notes: dict[str, Any] = {"looks": len(rows)}
    if len(rows) < _LEAST:
        return {}, notes
    odds, seen, total, squares, later = rows.T
    alike = squares / total**2
    share = total / (seen + total)
    p = expit(odds)
    known = np.clip(odds, -_LARGEST, _LARGEST)
    off = (later - odds) / share
    terms = np.stack([np.ones_like(p), known, p * known], axis=1)
    first = np.linalg.lstsq(terms, off, rcond=None)[0]

    def parts(numbers: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rho = expit(numbers[5])
        return off - terms @ numbers[:3], 2 * (numbers[3] + numbers[4] * p) + np.log(
            rho + (1 - rho) * alike
        )

    def unlikely(numbers: NDArray[np.float64]) -> float:
        rest, variance = parts(numbers)
        return float((variance + rest**2 * np.exp(-variance)).mean())

    begin = np.array([*first, np.log(max(np.std(off - terms @ first), 1e-6)), 0.0, 0.0])
    best = minimize(unlikely, begin, method="BFGS").x
    if not np.isfinite(best).all():
        return {}, notes
    rest, variance = parts(best)
    notes["within"] = float((np.abs(rest) <= _SIDE * np.exp(variance / 2)).mean())
    found = Forecast(tuple(best[:3]), tuple(best[3:5]), float(expit(best[5])))
    return found.arrays(), notes


def _scans(run: xr.Dataset) -> Iterator[Scan]:
    """Give the complete scans of a stored run as if they came."""
    for number in np.flatnonzero(complete_scans(run)):
        one = run.isel(scan=number)
        signal = np.asarray(one["signal"].values, dtype=np.complex64)
        yield Scan(
            int(number),
            float(one["time"]),
            np.asarray(one["pose"].values, dtype=np.float64),
            signal,
        )


def _confidence(detector: LiveDetector, value: float) -> float:
    trained = detector.model.detector
    read = pd.DataFrame({"magnitude": [np.float32(value)]})
    return math.nan if trained is None else float(trained.confidence(read)[0])


def _probability(odds: float) -> float:
    return 1 / (1 + math.exp(-min(max(odds, -_LARGEST), _LARGEST)))


def _interval(mean: float, deviation: float) -> list[float]:
    return [round(_probability(mean + side * _SIDE * deviation), 4) for side in (-1, 1)]
