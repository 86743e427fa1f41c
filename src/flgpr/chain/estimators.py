"""Estimators that a recipe may name as its detector: trained by their libraries, kept as arrays and settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.classifier import (
    FloatArray,
    TrainingSet,
    check_words,
    checked_names,
    feature_values,
)
from flgpr.chain.estimator_classes import ALLOWED
from flgpr.chain.recipe_tables import DetectorTable
from flgpr.chain.too_few import Change, TooFewExamplesError, check_classes
from flgpr.detect.scorers import restored_scorer, scorer_of
from flgpr.detect.scorers.checks import Scorer

_OUTWARD = ("ecod", "copod", "knn")  # whose scores grow with what is unlike the examples
_NEIGHBOURS = 5  # of PyOD's KNN, where no option says otherwise
LAYOUT = 2
"""How a trained estimator is laid out in a model: 1 was a file of skops, which could name what to call."""


def find_estimator(name: str) -> Any:
    """Return the class of an allowed estimator.

    One of PyOD is a ModuleNotFoundError without that library.
    """
    module, _, kind = ALLOWED[name].rpartition(".")
    try:
        return getattr(import_module(module), kind)
    except ModuleNotFoundError as error:
        if not module.startswith("pyod"):
            raise
        raise ModuleNotFoundError(
            f"estimator {name} needs PyOD: pip install 'flgpr[benchmark]'"
        ) from error


@dataclass(frozen=True)
class TrainedEstimator:
    """What a fitted estimator scores with, by its name in ``ALLOWED``, and the features it reads, columns in order.

    ``centre`` is subtracted from the features, which are then divided by ``scale``.
    """

    name: str
    features: tuple[str, ...]
    centre: FloatArray
    scale: FloatArray
    scorer: Scorer
    notes: dict[str, Any] = field(default_factory=dict)
    unlike: bool = False  #: whether what is unlike the training examples scores high

    def confidence(self, features: pd.DataFrame) -> FloatArray:
        """Score alarms: higher is more like a mine; NaN where a feature is missing."""
        values, whole = feature_values(features, self.features)
        result = np.full(len(values), np.nan)
        if whole.any():
            outward = self.name in _OUTWARD
            sign = 1 if self.unlike == outward else -1
            result[whole] = sign * self.scorer((values[whole] - self.centre) / self.scale)
        return result

    @property
    def linear_in_magnitude(self) -> bool:
        """Whether its scores are the log odds of a logistic regression on the magnitude alone."""
        # Where examples were weighed, the scores are the odds of other frequencies than theirs.
        plain = bool(getattr(self.scorer, "plain", False))
        return self.name == "logistic" and self.features == ("magnitude",) and plain

    @property
    def border(self) -> float:
        """Confidence where the estimator parts mines from clutter: PyOD's own threshold, zero of all others."""
        return (1 if self.unlike else -1) * self.scorer.threshold

    def contributions(self, features: pd.DataFrame) -> pd.DataFrame:
        """Return the confidences under the estimator's name: what is not linear has no shares of single features."""
        return pd.DataFrame(
            {self.name: self.confidence(features) if len(features) else np.zeros(0)}
        )

    def about(self) -> dict[str, Any]:
        """Return what JSON can hold of it."""
        return {
            "estimator": self.name,
            "layout": LAYOUT,
            "features": list(self.features),
            "unlike": self.unlike,
            "settings": self.scorer.settings(),
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return its arrays."""
        return {"centre": self.centre, "scale": self.scale, **self.scorer.arrays()}

    @classmethod
    def restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], notes: dict[str, Any]
    ) -> TrainedEstimator:
        """Put together what :meth:`about` and :meth:`arrays` gave.

        Nothing but numbers is taken. A layout of before, or whatever breaks a rule of the estimator
        that it names, is a ValueError.
        """
        name = about["estimator"]
        if about.get("layout") != LAYOUT:
            raise ValueError(
                f"its detector {str(name)[:60]!r} was written by an earlier version of flgpr, in a "
                "form that is no "
                "longer read: train it again with `flgpr train`"
            )
        check_words(about, ("estimator", "layout", "features", "unlike", "settings"))
        features = checked_names(about["features"])
        unlike = about.get("unlike")
        if type(unlike) is not bool:
            raise ValueError(f"detector.unlike must be true or false, got {str(unlike)[:60]!r}")
        own = dict(arrays)
        centre = _vector("centre", own, len(features))
        scale = _vector("scale", own, len(features))
        if not (scale > 0).all():
            raise ValueError(f"detector.scale must be positive, got {float(scale.min()):g}")
        try:
            scorer = restored_scorer(name, about["settings"], own, len(features))
        except ValueError as error:
            raise ValueError(f"detector {str(name)[:60]!r}: {error}") from None
        return cls(name, features, centre, scale, scorer, notes, unlike)


def _vector(name: str, arrays: dict[str, NDArray[Any]], length: int) -> FloatArray:
    value = arrays.pop(name, None)
    if (
        value is None
        or value.dtype != np.float64
        or value.shape != (length,)
        or not np.isfinite(value).all()
    ):
        got = "none" if value is None else f"{value.dtype} {value.shape}"
        raise ValueError(
            f"detector.{name} must hold a finite float64 number for each of {length} features, got "
            f"{got}"
        )
    return value


def train_estimator(
    examples: TrainingSet, table: DetectorTable, features: Sequence[str]
) -> TrainedEstimator:
    """Train the estimator that a recipe names on some columns of labelled alarms.

    A class without an example, options that do not fit the estimator, or options with which it
    cannot be kept as plain arrays, are a ValueError.
    """
    values, _ = feature_values(examples.features, features)
    mines = examples.label == 1
    wanted = {"all": np.ones_like(mines), "mines": mines, "clutter": ~mines}[table.on]
    _check_examples(table, int(mines.sum()), int((~mines).sum()))
    X = values[wanted]
    centre = np.zeros(X.shape[1])
    scale = np.ones(X.shape[1])
    if table.scale == "standard":
        spread = X.std(axis=0)
        centre = X.mean(axis=0)
        scale = np.where(spread > 0, spread, 1.0)
    try:
        estimator = find_estimator(table.estimator)(**table.options)
    except TypeError as error:
        raise ValueError(f"detector.options do not fit {table.estimator}: {error}") from None
    estimator.fit((X - centre) / scale, *((examples.label,) if table.on == "all" else ()))
    try:
        scorer = scorer_of(table.estimator, estimator)
    except ValueError as error:
        raise ValueError(f"detector {table.estimator} cannot be kept: {error}") from None
    notes = {
        "hits": int(mines.sum()),
        "false_alarms": int((~mines).sum()),
        "lanes": np.unique(examples.lane).tolist(),
    }
    return TrainedEstimator(
        table.estimator, tuple(features), centre, scale, scorer, notes, unlike=table.on == "clutter"
    )


def _check_examples(table: DetectorTable, hits: int, false_alarms: int) -> None:
    """Refuse fewer examples than an estimator can be trained with."""
    check_classes(table.on, hits, false_alarms)
    shown = {"all": hits + false_alarms, "mines": hits, "clutter": false_alarms}[table.on]
    neighbours = int(table.options.get("n_neighbors", _NEIGHBOURS))
    least = {"mixture": 2, "lda": 3, "knn": neighbours + 1}.get(table.estimator, 1)
    if shown < least:
        fewer = (
            [Change("n_neighbors", shown - 1, neighbours, "[detector.options]")]
            if shown > 1
            else []
        )
        needed = f"{least} examples or more for {table.estimator}, got {shown}"
        raise TooFewExamplesError(needed, changes=fewer if table.estimator == "knn" else [])
