"""A forecast of an alarm's probability after further looks, learnt on training lanes.

The map at a place is the mean of its looks, weighed by their distances, and the confidence its
logistic regression. So after looks of the weights w, W having been gathered, log odds z become z +
A e, where A = Σw / (W + Σw) is known from where the vehicle will be, and e is how far the new looks
lie off the mean so far. It is taken as Gaussian,

    e ~ N(a + (b + c p) z, σ² (ρ + (1 - ρ) Σw² / (Σw)²)),  ln σ = g + h p,  p = 1 / (1 + exp(-z)):

alarms are maxima, so that clutter comes lower when looked at again (b), a mine less so (c) and with
a wider spread (h); looks at a place are alike (ρ).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.live.detector import LiveDetector
from flgpr.live.event_types import ForecastEntries
from flgpr.live.updates import LiveAlarm
from flgpr.method.estimators import LARGEST_ODDS, TrainedEstimator, probability
from flgpr.method.model import Model
from flgpr.model import complete_scans
from flgpr.recipe.schema import Recipe
from flgpr.store.scan_file import stored_scan
from flgpr.types import Arrays, Entries, FloatArray

NAME = "live.forecast"
"""Name of the forecast in a model, among what its stages have learnt."""
_SIDE = 1.2816  # standard deviations to either side that hold 80 % of a Gaussian
_LEAST = 40  # looks at training alarms from which six numbers are learnt


class Followed(NamedTuple):
    """An alarm's log odds, and those after further looks (``later``).

    ``weight_before`` is the sum of the weights of the looks before, and ``total`` that of the
    further looks.
    """

    odds: float
    weight_before: float
    total: float
    squares: float  #: sum of the squared weights of the further looks
    later: float


@dataclass(frozen=True)
class Forecast:
    """The numbers a, b, c (``mean``), g, h (``spread``) and ρ (``correlation``)."""

    mean: tuple[float, float, float]
    spread: tuple[float, float]
    correlation: float

    def after(
        self, odds: float, weight_before: float, looks: Sequence[float]
    ) -> tuple[float, float]:
        """Return mean and standard deviation of the log odds after further looks.

        Parameters
        ----------
        odds : float
            Log odds now.
        weight_before : float
            Sum of the weights of the looks so far.
        looks : sequence of float
            Weights of the further looks.

        Returns
        -------
        mean, deviation : float
            Of the log odds.
        """
        a, b, c = self.mean
        g, h = self.spread
        rho = self.correlation
        total = sum(looks)
        clipped = min(max(odds, -LARGEST_ODDS), LARGEST_ODDS)
        p = probability(odds)
        share = total / (weight_before + total)
        squares = sum(weight * weight for weight in looks)
        alike = rho + (1 - rho) * squares / total**2
        mean = odds + share * (a + (b + c * p) * clipped)
        deviation = share * math.exp(g + h * p) * math.sqrt(alike)
        return mean, deviation

    def arrays(self) -> Arrays:
        """Return the numbers as the arrays that a model stores."""
        return {
            "mean": np.array(self.mean),
            "spread": np.array(self.spread),
            "correlation": np.array(self.correlation),
        }


def foresees(recipe: Recipe, model: Model) -> bool:
    """Return whether further looks can be forecast.

    The map must be a mean of looks, and the confidence its log odds.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    model : Model
        Its model.

    Returns
    -------
    bool
        Whether they can.
    """
    detector = model.detector
    if not isinstance(detector, TrainedEstimator) or not detector.linear_in_magnitude:
        return False
    return recipe.run_view.look == "mean" and not recipe.not_live_because()


def forecast_of(recipe: Recipe, model: Model) -> Forecast | None:
    """Return what a model has learnt of further looks.

    A model that could have learnt it and has not gives a UserWarning and None.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    model : Model
        Its model.

    Returns
    -------
    Forecast or None
        What it has learnt; None where the recipe allows no forecast.

    Raises
    ------
    ValueError
        If the model's arrays are not finite or not of the shapes of a forecast.
    """
    if not foresees(recipe, model):
        return None
    learnt = model.stages.get(NAME)
    if learnt is None:
        warnings.warn(
            f"model does not tell what further looks are worth: {_why_unlearnt(model)}",
            stacklevel=2,
        )
        return None
    shapes = {name: array.shape for name, array in learnt.items()}
    expected = {"mean": (3,), "spread": (2,), "correlation": ()}
    are_floats = all(array.dtype == np.float64 for array in learnt.values())
    are_finite = are_floats and all(np.isfinite(array).all() for array in learnt.values())
    if shapes != expected or not are_finite:
        raise ValueError(
            f"model must hold finite {NAME} of shapes {expected}, got {shapes}: train it again"
        )
    a, b, c = learnt["mean"].tolist()
    g, h = learnt["spread"].tolist()
    return Forecast((a, b, c), (g, h), float(learnt["correlation"]))


def _why_unlearnt(model: Model) -> str:
    """Return why a model has no forecast, and what to do."""
    if NAME not in model.notes:
        return "it was trained before that was learnt; train it again"
    looks = model.notes[NAME].get("looks", 0)
    return (
        f"its lanes gave too few, {looks} looks at alarms of {_LEAST}: "
        "train on longer lanes, or on more of them"
    )


def forecast_event(
    forecast: Forecast,
    detector: LiveDetector,
    alarm: LiveAlarm,
    margin: float | None,
    threshold: float,
    worth: float,
) -> ForecastEntries:
    """Return the members of an alarm's event that forecast it.

    They are its probability and, of an open alarm, what further looks will make of it. The looks
    are those to come if the vehicle drives straight on in steps as before.

    Parameters
    ----------
    forecast : Forecast
        What the model has learnt.
    detector : LiveDetector
        The detector that raised the alarm.
    alarm : LiveAlarm
        The alarm as it stands.
    margin : float or None
        Distance left to stop before the alarm, m. None where no speed is known: then every look
        counts, and whether to wait is left open.
    threshold : float
        Confidence from which an alarm is shown, log odds.
    worth : float
        Waiting is worth it if the next look still leaves room to stop, and the probability that it
        brings the confidence to the other side of ``threshold`` is at least this.

    Returns
    -------
    ForecastEntries
        The members; of an alarm that no look can change, its probability alone.
    """
    odds = alarm.confidence
    event: ForecastEntries = {"p": round(probability(odds), 4)}
    if alarm.state in ("withdrawn", "final"):
        return event
    expected = detector.expected_looks(alarm)
    weights = [weight for _, weight in expected]
    left = len(expected)
    if margin is not None:
        left = sum(distance <= margin for distance, _ in expected)
    event["looks_left"] = left
    if weights:
        _, weight_before = detector.mean_of_looks(alarm)
        mean, deviation = forecast.after(odds, weight_before, weights[:1])
        event["next_p"] = _interval(mean, deviation)
        event["change"] = round(_change(odds, mean, deviation, threshold), 4)
        if left:
            last_mean, last_deviation = forecast.after(odds, weight_before, weights[:left])
            event["last_p"] = _interval(last_mean, last_deviation)
    if margin is not None:
        event["wait"] = left > 0 and event["change"] >= worth
    return event


def _change(odds: float, mean: float, deviation: float, threshold: float) -> float:
    """Return the probability that log odds come to lie on the other side of a threshold."""
    deviations = abs(mean - threshold) / deviation
    # Gaussian: the tail on the far side of the threshold from the mean.
    tail = math.erfc(deviations / math.sqrt(2)) / 2
    stays = (mean < threshold) == (odds < threshold)
    return tail if stays else 1 - tail


def follow(detector: LiveDetector, run: xr.Dataset) -> Iterator[Followed]:
    """Play a stored run to a detector and yield the log odds of alarms after further looks.

    While an alarm stands, its later log odds are its own; afterwards they are the map's at its
    place.
    """
    followed: list[tuple[LiveAlarm, float, list[float]]] = []
    for number in np.flatnonzero(complete_scans(run)):
        if detector.add(stored_scan(run, int(number))).outcome != "taken":
            continue
        remaining = []
        for alarm, weight_before, looks in followed:
            if alarm.y <= detector.closed:
                continue
            value, weight = detector.mean_of_looks(alarm)
            added = weight - weight_before - sum(looks)
            # The difference of sums is not quite zero where the scan did not see the alarm.
            if added > 1e-9 * weight:
                looks.append(added)
                later = _later_odds(detector, alarm, value)
                squares = sum(look * look for look in looks)
                yield Followed(alarm.confidence, weight_before, sum(looks), squares, later)
            remaining.append((alarm, weight_before, looks))
        followed = remaining
        for alarm in detector.alarms.open.values():
            _, weight = detector.mean_of_looks(alarm)
            followed.append((alarm, weight, []))


def _later_odds(detector: LiveDetector, alarm: LiveAlarm, value: float) -> float:
    """Return the log odds of an alarm now.

    Of one that is gone, those of the map's value at its place; NaN without a trained detector.
    """
    current = detector.alarms.open.get(alarm.alarm_id)
    if current is not None:
        return current.confidence
    trained = detector.model.detector
    if trained is None:
        return math.nan
    features = pd.DataFrame({"magnitude": [np.float32(value)]})
    return float(trained.confidence(features)[0])


def learn(followed: Iterable[Followed]) -> tuple[Arrays, Entries]:
    """Fit the forecast's numbers by maximum likelihood.

    Parameters
    ----------
    followed : iterable of Followed
        Log odds of alarms on training lanes after further looks.

    Returns
    -------
    arrays : dict of ndarray
        What a model stores; empty where there are too few looks.
    notes : dict
        ``looks``, their number, and ``within``, the share of later log odds inside the 80 %
        interval.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    rows = np.fromiter(followed, np.dtype((np.float64, len(Followed._fields))))
    notes: Entries = {"looks": len(rows)}
    if len(rows) < _LEAST:
        return {}, notes
    odds, weight_before, total, squares, later = rows.T
    alike = squares / total**2
    share = total / (weight_before + total)
    p = expit(odds)
    clipped = np.clip(odds, -LARGEST_ODDS, LARGEST_ODDS)
    error = (later - odds) / share  # e of the looks, from the mean so far
    terms = np.stack([np.ones_like(p), clipped, p * clipped], axis=1)
    first = np.linalg.lstsq(terms, error, rcond=None)[0]

    def residual(numbers: FloatArray) -> FloatArray:
        return error - terms @ numbers[:3]

    def log_variance(numbers: FloatArray) -> FloatArray:
        rho = expit(numbers[5])
        return 2 * (numbers[3] + numbers[4] * p) + np.log(rho + (1 - rho) * alike)

    def negative_log_likelihood(numbers: FloatArray) -> float:
        variance = log_variance(numbers)
        return float((variance + residual(numbers) ** 2 * np.exp(-variance)).mean())

    spread = np.log(max(np.std(error - terms @ first), 1e-6))
    begin = np.array([*first, spread, 0.0, 0.0])
    best = minimize(negative_log_likelihood, begin, method="BFGS").x
    if not np.isfinite(best).all():
        return {}, notes
    limit = _SIDE * np.exp(log_variance(best) / 2)
    notes["within"] = float((np.abs(residual(best)) <= limit).mean())
    fitted = Forecast(tuple(best[:3]), tuple(best[3:5]), float(expit(best[5])))
    return fitted.arrays(), notes


def _interval(mean: float, deviation: float) -> list[float]:
    """Return the 80 % interval of the probability for Gaussian log odds."""
    low = probability(mean - _SIDE * deviation)
    high = probability(mean + _SIDE * deviation)
    return [round(low, 4), round(high, 4)]
