"""Estimators that a recipe may name as its detector, and their files: an allow-list, and no pickle."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.classifier import FloatArray, TrainingSet, feature_values
from flgpr.chain.recipe import DetectorTable

ALLOWED = {
    "rvm": "flgpr.detect.rvm.RelevanceVectorClassifier",
    "one-class-rvm": "flgpr.detect.one_class.OneClassRelevanceVectorMachine",
    "mixture": "flgpr.detect.one_class_mixture.GaussianMixtureNovelty",
    "svm": "sklearn.svm.SVC",
    "one-class-svm": "sklearn.svm.OneClassSVM",
    "logistic": "sklearn.linear_model.LogisticRegression",
    "lda": "sklearn.discriminant_analysis.LinearDiscriminantAnalysis",
    "random-forest": "sklearn.ensemble.RandomForestClassifier",
    "gradient-boosting": "sklearn.ensemble.HistGradientBoostingClassifier",
    "isolation-forest": "sklearn.ensemble.IsolationForest",
    "ecod": "pyod.models.ecod.ECOD",
    "copod": "pyod.models.copod.COPOD",
    "knn": "pyod.models.knn.KNN",
}
"""Estimators by the name that recipes use; what else a file holds is refused when it is read."""
_TRUSTED = (
    "flgpr.detect.",
    "sklearn.",
    "pyod.models.",
    "numpy.",
    "builtins.",
    "scipy.sparse.",
    "collections.OrderedDict",
)


def find_estimator(name: str) -> Any:
    """Give the class of an allowed estimator; without the library PyOD, where it is of that, a ModuleNotFoundError."""
    module, _, kind = ALLOWED[name].rpartition(".")
    try:
        return getattr(import_module(module), kind)
    except ModuleNotFoundError as error:
        if not module.startswith("pyod"):
            raise
        raise ModuleNotFoundError(f"estimator {name} needs PyOD: pip install 'flgpr[benchmark]'") from error


@dataclass(frozen=True)
class TrainedEstimator:
    """A fitted estimator, by its name in ``ALLOWED``, and the features it reads, columns in order.

    ``centre`` is subtracted from the features, which are then divided by ``scale``.
    """

    name: str
    features: tuple[str, ...]
    centre: FloatArray
    scale: FloatArray
    estimator: Any
    file: NDArray[np.uint8]  #: bytes of the estimator, as :meth:`arrays` gives them
    notes: dict[str, Any] = field(default_factory=dict)
    unlike: bool = False  #: whether what is unlike the training examples scores high

    def confidence(self, features: pd.DataFrame) -> FloatArray:
        """Score alarms: higher is more like a mine; NaN where a feature is missing."""
        values, whole = feature_values(features, self.features)
        result = np.full(len(values), np.nan)
        if whole.any():
            outward = ALLOWED[self.name].startswith("pyod.")  # whose scores grow with what is unlike
            sign = 1 if self.unlike == outward else -1
            result[whole] = sign * self._score((values[whole] - self.centre) / self.scale)
        return result

    @property
    def linear_in_magnitude(self) -> bool:
        """Whether its scores are the log odds of a logistic regression on the magnitude alone."""
        plain = getattr(self.estimator, "class_weight", None) is None  # weighted, they are odds of other frequencies
        return self.name == "logistic" and self.features == ("magnitude",) and plain

    @property
    def border(self) -> float:
        """Confidence where the estimator parts mines from clutter: PyOD's own threshold, zero of all others."""
        return (1 if self.unlike else -1) * float(getattr(self.estimator, "threshold_", 0.0))

    def _score(self, X: FloatArray) -> FloatArray:
        for method in ("decision_function", "score_samples"):
            if hasattr(self.estimator, method):
                return np.asarray(getattr(self.estimator, method)(X), dtype=np.float64)
        p = self.estimator.predict_proba(X)[:, 1]
        return np.asarray(np.log(np.maximum(p, 1e-12)) - np.log(np.maximum(1 - p, 1e-12)))

    def contributions(self, features: pd.DataFrame) -> pd.DataFrame:
        """Give the confidences under the estimator's name: what is not linear has no shares of single features."""
        return pd.DataFrame({self.name: self.confidence(features) if len(features) else np.zeros(0)})

    def about(self) -> dict[str, Any]:
        """Tell what JSON can hold of it."""
        return {"estimator": self.name, "features": list(self.features), "unlike": self.unlike}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give its arrays."""
        return {"centre": self.centre, "scale": self.scale, "estimator": self.file}

    @classmethod
    def restored(
        cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], notes: dict[str, Any]
    ) -> TrainedEstimator:
        """Put together what :meth:`about` and :meth:`arrays` gave; types that are not trusted are refused."""
        from skops.io import get_untrusted_types, loads  # slow to import, and seldom used

        data = arrays["estimator"].astype(np.uint8).tobytes()
        types = get_untrusted_types(data=data)
        foreign = [one for one in types if not one.startswith(_TRUSTED)]
        if foreign or about["estimator"] not in ALLOWED:
            raise ValueError(f"it holds what is not allowed: {', '.join(foreign) or about['estimator']}")
        estimator = loads(data, trusted=types)
        if type(estimator) is not find_estimator(about["estimator"]):
            raise ValueError(f"it must hold a {about['estimator']}, got {type(estimator).__name__}")
        names = tuple(str(name) for name in about["features"])
        told = arrays["centre"], arrays["scale"], estimator, arrays["estimator"], notes, bool(about.get("unlike"))
        return cls(about["estimator"], names, *told)


def _dumped(estimator: Any) -> NDArray[np.uint8]:
    """Write an estimator, the same one as the same bytes: neither the clock nor the memory's addresses enter."""
    from skops.io import dumps

    out = io.BytesIO()
    seen: dict[str, int] = {}

    def numbered(match: re.Match[str]) -> str:
        return f'"__id__": {seen.setdefault(match[1], len(seen) + 1)}'

    with zipfile.ZipFile(io.BytesIO(dumps(estimator))) as source, zipfile.ZipFile(out, "w") as target:
        files = {name: source.read(name) for name in source.namelist()}
        schema = re.sub(r'"__id__": (\d+)', numbered, files.pop("schema.json").decode())
        # Arrays are named after addresses, too.
        names = {name: f"{number}.{name.rpartition('.')[2]}" for number, name in enumerate(files, 1)}
        for name, new in names.items():
            schema = schema.replace(f'"{name}"', f'"{new}"')
        for name, data in [("schema.json", schema.encode()), *((names[name], files[name]) for name in files)]:
            target.writestr(zipfile.ZipInfo(name), data)
    return np.frombuffer(out.getvalue(), np.uint8)


def train_estimator(examples: TrainingSet, table: DetectorTable, features: Sequence[str]) -> TrainedEstimator:
    """Train the estimator that a recipe names on some columns of labelled alarms.

    A class without an example, or options that do not fit the estimator, are a ValueError.
    """
    values, _ = feature_values(examples.features, features)
    mines = examples.label == 1
    wanted = {"all": np.ones_like(mines), "mines": mines, "clutter": ~mines}[table.on]
    if (table.on != "clutter" and not mines.any()) or (table.on != "mines" and mines.all()):
        raise ValueError(f"training needs hits and false alarms, got {int(mines.sum())} and {int((~mines).sum())}")
    X = values[wanted]
    centre, scale = np.zeros(X.shape[1]), np.ones(X.shape[1])
    if table.scale == "standard":
        spread = X.std(axis=0)
        centre, scale = X.mean(axis=0), np.where(spread > 0, spread, 1.0)
    try:
        estimator = find_estimator(table.estimator)(**table.options)
    except TypeError as error:
        raise ValueError(f"detector.options do not fit {table.estimator}: {error}") from None
    estimator.fit((X - centre) / scale, *((examples.label,) if table.on == "all" else ()))
    notes = {"hits": int(mines.sum()), "false_alarms": int((~mines).sum()), "lanes": np.unique(examples.lane).tolist()}
    unlike = table.on == "clutter"
    return TrainedEstimator(
        table.estimator, tuple(features), centre, scale, estimator, _dumped(estimator), notes, unlike
    )
