"""The classifier of Wang et al. 2007: labels, duplication, histogram normaliser and Fisher discriminant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr import (
    detect,
)  # what it offers loads scikit-learn, which only what has learnt or learns needs
from flgpr.chain.too_few import check_classes
from flgpr.detect.scorers.checks import Checked
from flgpr.model import Lane
from flgpr.screen import label_alarms

if TYPE_CHECKING:
    from flgpr.detect import FisherDiscriminant, HistogramNormalizer

CLASSIFIER_A = ("C_HH_F1",)
CLASSIFIER_B = ("C_HH_F1", "M_VV_F1", "P_alpha_F1")
"""The two classifiers of Wang et al. 2007, Fig. 14."""
SIMULANT_BETA = 0.5
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrainingSet:
    """Labelled alarms: their features, label (1 hit, 0 false alarm), weight in training, and the lane each lies in."""

    features: pd.DataFrame
    label: NDArray[np.int64]
    weight: NDArray[np.int64]
    lane: NDArray[np.str_]


@dataclass(frozen=True)
class Classifier:
    """A fitted normaliser and discriminant for some features, in order; ``notes`` say what it was trained on."""

    features: tuple[str, ...]
    normalizer: HistogramNormalizer
    discriminant: FisherDiscriminant
    notes: dict[str, Any] = field(default_factory=dict)
    border = 0.0
    """Confidence where it parts mines from clutter: the discriminant's constant is subtracted already."""

    def contributions(self, features: pd.DataFrame) -> pd.DataFrame:
        """Split confidences into what each feature adds, and ``threshold``, the discriminant's constant."""
        names = list(self.features)
        if not len(features):
            return pd.DataFrame({name: np.zeros(0) for name in [*names, "threshold"]})
        values = self.normalizer.transform(features[names].to_numpy(dtype=np.float64))
        table = pd.DataFrame(values * self.discriminant.direction_, columns=names)
        return table.assign(threshold=-self.discriminant.threshold_)

    def about(self) -> dict[str, Any]:
        """Return what JSON can hold of it."""
        return {
            "estimator": "fisher",
            "features": list(self.features),
            "threshold": self.discriminant.threshold_,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return its arrays."""
        knots = {f"knots-{i}": one for i, one in enumerate(self.normalizer.knots_)}
        return {"direction": self.discriminant.direction_} | knots

    @classmethod
    def restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], notes: dict[str, Any]
    ) -> Classifier:
        """Put together what :meth:`about` and :meth:`arrays` gave; what breaks a rule is a ValueError that names it."""
        check_words(about, ("estimator", "features", "threshold"))
        names = checked_names(about["features"])
        checked = Checked({"threshold": about["threshold"]}, arrays)
        direction = checked.array("direction", (len(names),))
        threshold = checked.number("threshold")
        knots = [checked.array(f"knots-{i}", (2, None)) for i in range(len(names))]
        checked.done()
        for name, one in zip(names, knots, strict=True):
            if one.shape[1] < 1 or not (np.diff(one[0]) > 0).all():
                raise ValueError(
                    f"detector's knots of {name!r} must rise, one at least, got {one.shape[1]}"
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
        """Score alarms: higher is more like a mine; NaN where a feature is missing; all columns must be there."""
        values, whole = feature_values(features, self.features)
        result = np.full(len(values), np.nan)
        if whole.any():
            result[whole] = self.discriminant.decision_function(
                self.normalizer.transform(values[whole])
            )
        return result


def check_words(about: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse words of a detector that nothing reads: a model holds what its scores depend on alone."""
    strange = sorted(set(about) - set(known))
    if strange:
        raise ValueError(f"detector must have {', '.join(known)} alone, got {strange[0][:60]!r}")


def checked_names(names: Any) -> tuple[str, ...]:
    """Take names of columns from a model's words: different texts, at least one."""
    texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not texts or not names or len(set(names)) < len(names):
        raise ValueError(
            f"detector.features must be a list of different names, got {str(names)[:60]!r}"
        )
    return tuple(names)


def feature_values(
    features: pd.DataFrame, names: Sequence[str]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Take columns out of a feature table: values (alarm, feature), and which alarms have all of them."""
    missing = [name for name in names if name not in features.columns]
    if missing:
        raise ValueError(
            f"features must hold the columns the model reads; missing: {', '.join(missing)}"
        )
    values = features[list(names)].to_numpy(dtype=np.float64)
    return values, np.isfinite(values).all(axis=1)


def label_lanes(
    lanes: Sequence[tuple[str, pd.DataFrame, pd.DataFrame, Lane]], label_radius: float = 1.0
) -> pd.DataFrame:
    """Label the alarms of lanes with their truth (Wang et al. 2007, Sec. II-B).

    One row per alarm, lane after lane: ``lane``, ``label`` ("hit", "false", "neither"), ``target``
    (number of the target hit, counted through all lanes, or -1), ``distance`` (m) and ``beta`` (0.5
    for hits on simulants). ``label_radius`` is r_label, m.
    """
    if not lanes:
        raise ValueError("lanes must hold at least one lane, got none")
    parts = []
    targets = 0
    for name, alarms, truth, lane in lanes:
        part = label_alarms(alarms, truth, lane, label_radius)
        hit = (part["label"] == "hit").to_numpy()
        kind = np.append(truth["kind"].to_numpy(dtype=object), "")[part["target"].to_numpy()]
        part["beta"] = np.where(hit & (kind == "simulant"), SIMULANT_BETA, 1.0)
        part["target"] = np.where(hit, part["target"] + targets, -1)
        parts.append(part.assign(lane=name))
        targets += len(truth)
    return pd.concat(parts, ignore_index=True)


def count_mines(truths: Iterable[pd.DataFrame]) -> int:
    """Count the actual mines of truth tables: simulants are none."""
    return sum(int((truth["kind"] != "simulant").sum()) for truth in truths)


def duplication(labels: pd.DataFrame, mines: int, label_radius: float = 1.0) -> NDArray[np.int64]:
    """Weigh labelled alarms (alarm,) by Eq. 18 and 19 of Wang et al. 2007.

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
    """
    W0 = float((labels["label"] == "false").sum() / max(mines, 1))
    return detect.hit_weights(
        labels["target"], labels["distance"].fillna(0.0), W0, labels["beta"], label_radius
    )


def make_training_set(
    lanes: Sequence[tuple[str, pd.DataFrame, pd.DataFrame, pd.DataFrame, Lane]],
    label_radius: float = 1.0,
    columns: Sequence[str] | None = None,
    spent: Sequence[pd.DataFrame] = (),
) -> TrainingSet:
    """Label and weigh the alarms of lanes, each (name, alarms, features, truth, lane).

    Left out are those that are neither hit nor false, that lack one of the ``columns`` (default
    all), and hits on the rows of each lane's truth that are ``spent``, as they made templates or
    thresholds.
    """
    labels = label_lanes(
        [(name, alarms, truth, lane) for name, alarms, _, truth, lane in lanes], label_radius
    )
    table = pd.concat([features for _, _, features, _, _ in lanes], ignore_index=True)
    known = np.isfinite(table[list(columns or table.columns)].to_numpy(dtype=np.float64)).all(
        axis=1
    )
    keep = known & (labels["label"] != "neither").to_numpy()
    if spent:
        used = np.concatenate(
            [truth.index.isin(one.index) for (*_, truth, _), one in zip(lanes, spent, strict=True)]
        )
        keep &= ~np.append(used, False)[
            labels["target"].to_numpy()
        ]  # those that hit nothing have the number -1
    labels = labels[keep]
    weight = duplication(labels, count_mines(truth for *_, truth, _ in lanes), label_radius)
    label = (labels["label"] == "hit").to_numpy().astype(np.int64)
    return TrainingSet(
        table[keep].reset_index(drop=True), label, weight, labels["lane"].to_numpy(dtype=str)
    )


def train(
    examples: TrainingSet, features: Sequence[str] = CLASSIFIER_B, duplicate: bool = True
) -> Classifier:
    """Train a classifier on some columns; without ``duplicate`` every hit counts once. Each class needs an example."""
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
