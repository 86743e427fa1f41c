"""The classifier of Wang et al. 2007 (Sec. II-D).

It consists of labels, the duplication of hits, a histogram normaliser and a Fisher discriminant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

# The package, not its names: it loads scikit-learn only when a name is asked for, and a recipe
# without a model asks for none.
from flgpr import detect
from flgpr.detect.scorers.checks import Checked
from flgpr.model import Lane
from flgpr.screen import label_training_alarms
from flgpr.stages.too_few import check_classes
from flgpr.types import AnyArray, Arrays, BoolArray, Entries, FloatArray, IntArray

if TYPE_CHECKING:
    from flgpr.detect import FisherDiscriminant, HistogramNormalizer

CLASSIFIER_A = ("C_HH_F1",)
CLASSIFIER_B = ("C_HH_F1", "M_VV_F1", "P_alpha_F1")
"""The two classifiers of Wang et al. 2007, Fig. 14."""
SIMULANT_BETA = 0.5


# Name, alarms, features, truth and borders of a lane.
LaneOfAlarms = tuple[str, pd.DataFrame, pd.DataFrame, pd.DataFrame, Lane]


@dataclass(frozen=True)
class TrainingSet:
    """Labelled alarms of training lanes."""

    features: pd.DataFrame  #: a row per alarm
    label: IntArray  #: (alarm,) 1 for a hit, 0 for a false alarm
    weight: IntArray  #: (alarm,) how often the alarm counts in training
    lane: NDArray[np.str_]  #: (alarm,) name of its lane


@dataclass(frozen=True)
class Classifier:
    """A fitted histogram normaliser and Fisher discriminant."""

    features: tuple[str, ...]  #: columns that it reads, in order
    normalizer: HistogramNormalizer
    discriminant: FisherDiscriminant
    notes: Entries = field(default_factory=dict)  #: what it was trained on
    border = 0.0
    """Confidence that separates mines from clutter: the constant is subtracted already."""

    def contributions(self, features: pd.DataFrame) -> pd.DataFrame:
        """Split confidences into what each feature adds.

        Parameters
        ----------
        features : DataFrame
            A row per alarm.

        Returns
        -------
        DataFrame
            A column per feature, and ``threshold``, the discriminant's constant. They add up to the
            confidence.
        """
        names = list(self.features)
        if not len(features):
            return pd.DataFrame({name: np.zeros(0) for name in [*names, "threshold"]})
        values = self.normalizer.transform(features[names].to_numpy(dtype=np.float64))
        table = pd.DataFrame(values * self.discriminant.direction_, columns=names)
        return table.assign(threshold=-self.discriminant.threshold_)

    def about(self) -> Entries:
        """Return the entries that a model's head holds of it."""
        return {
            "estimator": "fisher",
            "features": list(self.features),
            "threshold": self.discriminant.threshold_,
        }

    def arrays(self) -> Arrays:
        """Return the arrays that a model holds of it."""
        arrays = {"direction": self.discriminant.direction_}
        for number, knots in enumerate(self.normalizer.knots_):
            arrays[f"knots-{number}"] = knots
        return arrays

    @classmethod
    def restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, AnyArray], notes: Entries
    ) -> Classifier:
        """Return the classifier of what :meth:`about` and :meth:`arrays` returned.

        Raises
        ------
        ValueError
            If an entry or an array breaks a rule; it names the rule.
        """
        check_entries(about, ("estimator", "features", "threshold"))
        names = checked_names(about["features"])
        checked = Checked({"threshold": about["threshold"]}, arrays)
        direction = checked.array("direction", (len(names),))
        threshold = checked.number("threshold")
        knots = [checked.array(f"knots-{number}", (2, None)) for number in range(len(names))]
        checked.done()
        for name, of_feature in zip(names, knots, strict=True):
            count = of_feature.shape[1]
            if count < 1 or not (np.diff(of_feature[0]) > 0).all():
                raise ValueError(
                    f"detector's knots of {name!r} must rise, one at least, got {count}"
                )
        normalizer = detect.HistogramNormalizer()
        normalizer.knots_ = knots
        discriminant = detect.FisherDiscriminant()
        discriminant.direction_ = direction
        discriminant.threshold_ = threshold
        normalizer.n_features_in_ = discriminant.n_features_in_ = len(names)
        discriminant.classes_ = np.array([0, 1])
        return cls(names, normalizer, discriminant, notes)

    def confidence(self, features: pd.DataFrame) -> FloatArray:
        """Score alarms.

        Parameters
        ----------
        features : DataFrame
            A row per alarm, with all columns that the classifier reads.

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
            normalized = self.normalizer.transform(values[complete])
            confidence[complete] = self.discriminant.decision_function(normalized)
        return confidence


def check_entries(about: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse entries of a detector that nothing reads.

    A model holds only what its scores depend on.
    """
    strange = sorted(set(about) - set(known))
    if strange:
        raise ValueError(f"detector must have {', '.join(known)} alone, got {strange[0][:60]!r}")


def checked_names(names: Any) -> tuple[str, ...]:
    """Return the names of columns in a model's head; refuse any but different texts."""
    are_texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not are_texts or not names or len(set(names)) < len(names):
        raise ValueError(
            f"detector.features must be a list of different names, got {str(names)[:60]!r}"
        )
    return tuple(names)


def feature_values(features: pd.DataFrame, names: Sequence[str]) -> tuple[FloatArray, BoolArray]:
    """Return columns of a feature table, and which alarms have all of them.

    Parameters
    ----------
    features : DataFrame
        A row per alarm.
    names : sequence of str
        Columns.

    Returns
    -------
    values : (alarm, feature) ndarray
        The columns in this order.
    complete : (alarm,) ndarray of bool
        Whether none of an alarm's values is missing.

    Raises
    ------
    ValueError
        If there is no such column.
    """
    missing = [name for name in names if name not in features.columns]
    if missing:
        raise ValueError(
            f"features must hold the columns the model reads; missing: "
            f"{', '.join(missing)}; is it the model of another recipe?"
        )
    values = features[list(names)].to_numpy(dtype=np.float64)
    return values, np.isfinite(values).all(axis=1)


def label_lanes(lanes: Sequence[LaneOfAlarms], label_radius: float = 1.0) -> pd.DataFrame:
    """Label the alarms of lanes with their truth (Wang et al. 2007, Sec. II-B).

    Parameters
    ----------
    lanes : sequence of tuple
        Name, alarms, features, truth and borders of every lane; features are not looked at.
    label_radius : float
        r_label, m.

    Returns
    -------
    DataFrame
        A row per alarm, lane after lane: ``lane``, ``label`` ("hit", "false", "neither"),
        ``target`` (number of the target hit, counted through all lanes, or -1), ``distance`` (m)
        and ``beta`` (0.5 for hits on simulants).

    Raises
    ------
    ValueError
        If there is no lane.
    """
    if not lanes:
        raise ValueError("lanes must hold at least one lane, got none")
    tables = []
    targets_before = 0
    for name, alarms, _, truth, lane in lanes:
        table = label_training_alarms(alarms, truth, lane, label_radius)
        hit = (table["label"] == "hit").to_numpy()
        # An alarm that hit no target has the number -1, which picks the empty kind at the end.
        kinds = np.append(truth["kind"].to_numpy(dtype=object), "")
        kind = kinds[table["target"].to_numpy()]
        table["beta"] = np.where(hit & (kind == "simulant"), SIMULANT_BETA, 1.0)
        table["target"] = np.where(hit, table["target"] + targets_before, -1)
        tables.append(table.assign(lane=name))
        targets_before += len(truth)
    return pd.concat(tables, ignore_index=True)


def count_mines(truths: Iterable[pd.DataFrame]) -> int:
    """Return the number of actual mines in truth tables: simulants do not count."""
    return sum(int((truth["kind"] != "simulant").sum()) for truth in truths)


def duplication(labels: pd.DataFrame, mines: int, label_radius: float = 1.0) -> IntArray:
    """Return how often each labelled alarm counts in training (Wang et al. 2007, Eq. 18 and 19).

    W0 is "the ratio between the number of FAs and the number of actual targets"; simulants are not
    counted among these (:func:`count_mines`), as the paper speaks of an "actual mine" or a simulant
    where it defines β.

    Parameters
    ----------
    labels : DataFrame
        Rows of :func:`label_lanes`.
    mines : int
        Number of actual mines in the lanes of these alarms.
    label_radius : float
        r_label, m.

    Returns
    -------
    (alarm,) ndarray of int
        The weights; 1 for false alarms.
    """
    W0 = float((labels["label"] == "false").sum() / max(mines, 1))
    return detect.hit_weights(
        labels["target"], labels["distance"].fillna(0.0), W0, labels["beta"], label_radius
    )


def make_training_set(
    lanes: Sequence[LaneOfAlarms],
    label_radius: float = 1.0,
    columns: Sequence[str] | None = None,
    spent: Sequence[pd.DataFrame] = (),
) -> TrainingSet:
    """Label and weigh the alarms of lanes.

    Left out are alarms that are neither hit nor false or lack a column, and hits on targets that
    made templates or thresholds.

    Parameters
    ----------
    lanes : sequence of tuple
        Name, alarms, features, truth and borders of every lane.
    label_radius : float
        r_label, m.
    columns : sequence of str, optional
        Columns that every example must have; by default all.
    spent : sequence of DataFrame, optional
        The rows of each lane's truth that stages have learnt from.

    Returns
    -------
    TrainingSet
        The examples.
    """
    truths = [truth for *_, truth, _ in lanes]
    labels = label_lanes(lanes, label_radius)
    table = pd.concat([features for _, _, features, _, _ in lanes], ignore_index=True)
    _, complete = feature_values(table, list(columns or table.columns))
    keep = complete & (labels["label"] != "neither").to_numpy()
    if spent:
        flags = []
        for truth, used in zip(truths, spent, strict=True):
            flags.append(truth.index.isin(used.index))
        is_spent = np.concatenate(flags)
        # Alarms that hit nothing have the number -1, which picks the False at the end.
        keep &= ~np.append(is_spent, False)[labels["target"].to_numpy()]
    labels = labels[keep]
    weight = duplication(labels, count_mines(truths), label_radius)
    label = (labels["label"] == "hit").to_numpy().astype(np.int64)
    return TrainingSet(
        table[keep].reset_index(drop=True), label, weight, labels["lane"].to_numpy(dtype=str)
    )


def train(
    examples: TrainingSet, features: Sequence[str] = CLASSIFIER_B, duplicate: bool = True
) -> Classifier:
    """Train a classifier (Wang et al. 2007, Sec. II-D).

    Parameters
    ----------
    examples : TrainingSet
        Labelled alarms.
    features : sequence of str
        Columns that it reads.
    duplicate : bool
        Whether hits count by their weights; otherwise each counts once.

    Returns
    -------
    Classifier
        The trained classifier.

    Raises
    ------
    ValueError
        If a column is missing, or a class has no example.
    """
    missing = [name for name in features if name not in examples.features.columns]
    if missing:
        raise ValueError(f"features must be columns of the feature table, got {', '.join(missing)}")
    check_classes("all", int((examples.label == 1).sum()), int((examples.label == 0).sum()))
    values = examples.features[list(features)].to_numpy(dtype=np.float64)
    weight = examples.weight if duplicate else np.ones_like(examples.weight)
    normalizer = detect.HistogramNormalizer().fit(values, sample_weight=weight)
    discriminant = detect.FisherDiscriminant().fit(
        normalizer.transform(values), examples.label, sample_weight=weight
    )
    notes = {
        "hits": int(examples.label.sum()),
        "false_alarms": int((examples.label == 0).sum()),
        "lanes": [str(name) for name in np.unique(examples.lane)],
        "duplication": duplicate,
    }
    return Classifier(tuple(features), normalizer, discriminant, notes)
