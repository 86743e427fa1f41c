"""Estimators that a recipe may name as its detector.

They are trained by their libraries, and a model holds arrays and settings of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from flgpr.detect.estimator_table import find_estimator, scorer_class, trained_class
from flgpr.detect.scorers.checks import Checked, StoredScorer
from flgpr.method.classifier import TrainingSet, check_entries, checked_names, feature_values
from flgpr.recipe.tables import DetectorTable
from flgpr.stages.too_few import Change, TooFewExamplesError, check_classes
from flgpr.types import AnyArray, Arrays, Entries, FloatArray

LARGEST_ODDS = 30.0
"""Of log odds: beyond it the probability no longer changes."""
LAYOUT = 2
"""Version of the layout of a trained estimator in a model.

The first was a file of skops, which could name what to call.
"""


def probability(odds: float) -> float:
    """Return the probability of log odds."""
    return 1 / (1 + math.exp(-min(max(odds, -LARGEST_ODDS), LARGEST_ODDS)))


@dataclass(frozen=True)
class TrainedEstimator:
    """What a fitted estimator scores with."""

    name: str  #: its name in recipes
    features: tuple[str, ...]  #: columns that it reads, in order
    centre: FloatArray  #: (feature,) is subtracted from the features
    scale: FloatArray  #: (feature,) divides them then
    scorer: StoredScorer
    notes: Entries = field(default_factory=dict)  #: what it was trained on
    unlike: bool = False  #: whether what is unlike the training examples scores high

    def confidence(self, features: pd.DataFrame) -> FloatArray:
        """Score alarms.

        Parameters
        ----------
        features : DataFrame
            A row per alarm, with all columns that the estimator reads.

        Returns
        -------
        (alarm,) ndarray
            Higher for what is more like a mine; NaN where a feature is missing.

        Raises
        ------
        ValueError
            If a column is missing.
        """
        values, complete = feature_values(features, self.features)
        confidence = np.full(len(values), np.nan)
        if complete.any():
            sign = 1 if self.unlike == find_estimator(self.name).outward else -1
            scaled = (values[complete] - self.centre) / self.scale
            confidence[complete] = sign * self.scorer(scaled)
        return confidence

    @property
    def linear_in_magnitude(self) -> bool:
        """Whether its scores are the log odds of a logistic regression on the magnitude alone."""
        # Where examples were weighted, the scores are the odds of other frequencies than theirs.
        unweighted = bool(getattr(self.scorer, "unweighted", False))
        return self.name == "logistic" and self.features == ("magnitude",) and unweighted

    @property
    def border(self) -> float:
        """Confidence that separates mines from clutter.

        It is PyOD's own threshold, and zero for all other estimators.
        """
        sign = 1 if self.unlike else -1
        return sign * self.scorer.threshold

    def contributions(self, features: pd.DataFrame) -> pd.DataFrame:
        """Return the confidences under the estimator's name.

        What is not linear cannot be split into what single features add.
        """
        confidence = self.confidence(features) if len(features) else np.zeros(0)
        return pd.DataFrame({self.name: confidence})

    def about(self) -> Entries:
        """Return the entries that a model's head holds of it."""
        return {
            "estimator": self.name,
            "layout": LAYOUT,
            "features": list(self.features),
            "unlike": self.unlike,
            "settings": self.scorer.settings(),
        }

    def arrays(self) -> Arrays:
        """Return the arrays that a model holds of it."""
        return {"centre": self.centre, "scale": self.scale, **self.scorer.arrays()}

    @classmethod
    def restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, AnyArray], notes: Entries
    ) -> TrainedEstimator:
        """Return the estimator of what :meth:`about` and :meth:`arrays` returned.

        Nothing but numbers is read.

        Raises
        ------
        ValueError
            If the layout is an earlier one, or an entry or array breaks a rule of the estimator.
        """
        name = about["estimator"]
        if about.get("layout") != LAYOUT:
            raise ValueError(
                f"its detector {str(name)[:60]!r} was written by an earlier version of flgpr, in a "
                "form that is no "
                "longer read: train it again with `flgpr.train`"
            )
        check_entries(about, ("estimator", "layout", "features", "unlike", "settings"))
        features = checked_names(about["features"])
        unlike = about.get("unlike")
        if type(unlike) is not bool:
            raise ValueError(f"detector.unlike must be true or false, got {str(unlike)[:60]!r}")
        checked = Checked(about["settings"], arrays)
        try:
            centre = checked.array("centre", (len(features),))
            scale = checked.array("scale", (len(features),))
            if not (scale > 0).all():
                raise ValueError(f"scale must be positive, got {float(scale.min()):g}")
            scorer = scorer_class(name).taken(checked, len(features))
            checked.done()
        except ValueError as error:
            raise ValueError(f"detector {str(name)[:60]!r}: {error}") from None
        return cls(name, features, centre, scale, scorer, notes, unlike)


def train_estimator(
    examples: TrainingSet, table: DetectorTable, features: Sequence[str]
) -> TrainedEstimator:
    """Train the estimator that a recipe names.

    Parameters
    ----------
    examples : TrainingSet
        Labelled alarms.
    table : DetectorTable
        The table ``detector`` of the recipe.
    features : sequence of str
        Columns that the estimator reads.

    Returns
    -------
    TrainedEstimator
        What scores alarms.

    Raises
    ------
    ValueError
        If a class has no example, the options do not fit the estimator, or with them it cannot be
        written as plain arrays.
    """
    values, _ = feature_values(examples.features, features)
    mines = examples.label == 1
    chosen = {"all": np.ones_like(mines), "mines": mines, "clutter": ~mines}[table.on]
    _check_examples(table, int(mines.sum()), int((~mines).sum()))

    X = values[chosen]
    centre = np.zeros(X.shape[1])
    scale = np.ones(X.shape[1])
    if table.scale == "standard":
        deviation = X.std(axis=0)
        centre = X.mean(axis=0)
        scale = np.where(deviation > 0, deviation, 1.0)
    scaled = (X - centre) / scale
    estimator = _make_estimator(table, features)
    if table.on == "all":
        estimator.fit(scaled, examples.label)
    else:
        estimator.fit(scaled)

    try:
        scorer = scorer_class(table.estimator).of(estimator)
    except ValueError as error:
        raise ValueError(f"detector {table.estimator} cannot be kept: {error}") from None
    notes = {
        "hits": int(mines.sum()),
        "false_alarms": int((~mines).sum()),
        "lanes": np.unique(examples.lane).tolist(),
    }
    unlike = table.on == "clutter"
    return TrainedEstimator(
        table.estimator, tuple(features), centre, scale, scorer, notes, unlike=unlike
    )


def _make_estimator(table: DetectorTable, features: Sequence[str]) -> Any:
    """Make the estimator that a recipe names, with its options, before it is fitted."""
    options: Entries = dict(table.options)
    if find_estimator(table.estimator).grouped:
        if "groups" in options:
            raise ValueError(
                f"detector.options of {table.estimator} must not hold groups, as every entry of "
                f"detector.features is one, got {options['groups']!r}"
            )
        entries = []
        for name in features:
            entries.append(
                next((entry for entry in table.features if fnmatchcase(name, entry)), name)
            )
        options["groups"] = tuple(len(list(group)) for _, group in groupby(entries))
    try:
        return trained_class(table.estimator)(**options)
    except TypeError as error:
        raise ValueError(f"detector.options do not fit {table.estimator}: {error}") from None


def _check_examples(table: DetectorTable, hits: int, false_alarms: int) -> None:
    """Refuse fewer examples than an estimator can be trained with."""
    check_classes(table.on, hits, false_alarms)
    shown = {"all": hits + false_alarms, "mines": hits, "clutter": false_alarms}[table.on]
    estimator = find_estimator(table.estimator)
    least = estimator.least
    neighbours = int(table.options.get("n_neighbors", estimator.neighbours))
    if estimator.neighbours:
        least = neighbours + 1
    if shown >= least:
        return
    changes = []
    if estimator.neighbours and shown > 1:
        changes = [Change("n_neighbors", shown - 1, neighbours, "[detector.options]")]
    needed = f"{least} examples or more for {table.estimator}, got {shown}"
    raise TooFewExamplesError(needed, changes=changes)
