"""Trained classifiers: histogram normaliser and Fisher discriminant, kept as JSON and npy files."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import flgpr
from flgpr.detect import FisherDiscriminant, HistogramNormalizer, hit_weights
from flgpr.io import check_free_folder, inside, read_limited, replace_folder, seal, sha256, unseal, write_whole
from flgpr.model import Lane
from flgpr.screen import label_alarms

FORMAT, VERSION = "flgpr-classifier", 2
CLASSIFIER_A = ("C_HH_F1",)
CLASSIFIER_B = ("C_HH_F1", "M_VV_F1", "P_alpha_F1")
"""The two classifiers of Wang et al. 2007, Fig. 14."""
SIMULANT_BETA = 0.5
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrainingSet:
    """Labelled alarms of one or several lanes.

    Attributes
    ----------
    features : DataFrame
        One row per alarm.
    label : (alarm,) ndarray of int
        1 for hits, 0 for false alarms.
    weight : (alarm,) ndarray of int
        How often each counts in training.
    lane : (alarm,) ndarray of str
        The lane it lies in.
    """

    features: pd.DataFrame
    label: NDArray[np.int64]
    weight: NDArray[np.int64]
    lane: NDArray[np.str_]


@dataclass(frozen=True)
class Classifier:
    """A normaliser and a discriminant for some features.

    Attributes
    ----------
    features : tuple of str
        Columns it reads, in order.
    normalizer : HistogramNormalizer
        Fitted.
    discriminant : FisherDiscriminant
        Fitted.
    notes : dict
        What it was trained on.
    """

    features: tuple[str, ...]
    normalizer: HistogramNormalizer
    discriminant: FisherDiscriminant
    notes: dict[str, Any] = field(default_factory=dict)

    def confidence(self, features: pd.DataFrame) -> FloatArray:
        """Score alarms.

        Parameters
        ----------
        features : DataFrame
            Feature table that holds the columns in ``features``.

        Returns
        -------
        (alarm,) ndarray
            Higher is more like a mine; NaN where a feature is missing.

        Raises
        ------
        ValueError
            If a column is missing.
        """
        missing = [name for name in self.features if name not in features.columns]
        if missing:
            raise ValueError(f"features must hold the columns the model reads; missing: {', '.join(missing)}")
        values = features[list(self.features)].to_numpy(dtype=np.float64)
        result = np.full(len(values), np.nan)
        whole = np.isfinite(values).all(axis=1)
        if whole.any():
            result[whole] = self.discriminant.decision_function(self.normalizer.transform(values[whole]))
        return result


def label_lanes(
    lanes: Sequence[tuple[str, pd.DataFrame, pd.DataFrame, Lane]], label_radius: float = 1.0
) -> pd.DataFrame:
    """Label the alarms of lanes with their truth (Wang et al. 2007, Sec. II-B).

    Parameters
    ----------
    lanes : sequence of (name, alarms, truth, lane)
        What was found in each lane and what is there.
    label_radius : float
        r_label, m.

    Returns
    -------
    DataFrame
        One row per alarm, lane after lane: ``lane``, ``label`` ("hit", "false", "neither"), ``target`` (number of the
        target hit, counted through all lanes, or -1), ``distance`` (m) and ``beta`` (0.5 for hits on simulants).

    Raises
    ------
    ValueError
        If a truth table is not valid or there is no lane.
    """
    if not lanes:
        raise ValueError("lanes must hold at least one lane, got none")
    parts, targets = [], 0
    for name, alarms, truth, lane in lanes:
        part = label_alarms(alarms, truth, lane, label_radius)
        hit = (part["label"] == "hit").to_numpy()
        kind = np.append(truth["kind"].to_numpy(dtype=object), "")[part["target"].to_numpy()]
        part["beta"] = np.where(hit & (kind == "simulant"), SIMULANT_BETA, 1.0)
        part["target"] = np.where(hit, part["target"] + targets, -1)
        parts.append(part.assign(lane=name))
        targets += len(truth)
    return pd.concat(parts, ignore_index=True)


def duplication(labels: pd.DataFrame, targets: int, label_radius: float = 1.0) -> NDArray[np.int64]:
    """Weigh labelled alarms (Wang et al. 2007, Eq. 18 and 19), W0 being false alarms over targets.

    Parameters
    ----------
    labels : DataFrame
        Rows of :func:`label_lanes` that are trained on.
    targets : int
        Number of targets there, simulants included.
    label_radius : float
        r_label, m.

    Returns
    -------
    (alarm,) ndarray of int
        W.
    """
    w0 = float((labels["label"] == "false").sum() / max(targets, 1))
    return hit_weights(labels["target"], labels["distance"].fillna(0.0), w0, labels["beta"], label_radius)


def make_training_set(
    lanes: Sequence[tuple[str, pd.DataFrame, pd.DataFrame, pd.DataFrame, Lane]],
    label_radius: float = 1.0,
    columns: Sequence[str] | None = None,
) -> TrainingSet:
    """Label and weigh the alarms of lanes.

    Parameters
    ----------
    lanes : sequence of (name, alarms, features, truth, lane)
        What was found in each lane and what is there.
    label_radius : float
        r_label, m.
    columns : sequence of str, optional
        Features that must be known; alarms that lack one are left out. Default: all.

    Returns
    -------
    TrainingSet
        Hits and false alarms; alarms that are neither are left out.

    Raises
    ------
    ValueError
        If a truth table is not valid or there is no lane.
    """
    labels = label_lanes([(name, alarms, truth, lane) for name, alarms, _, truth, lane in lanes], label_radius)
    table = pd.concat([features for _, _, features, _, _ in lanes], ignore_index=True)
    known = np.isfinite(table[list(columns or table.columns)].to_numpy(dtype=np.float64)).all(axis=1)
    keep = known & (labels["label"] != "neither").to_numpy()
    labels = labels[keep]
    weight = duplication(labels, sum(len(truth) for *_, truth, _ in lanes), label_radius)
    label = (labels["label"] == "hit").to_numpy().astype(np.int64)
    return TrainingSet(table[keep].reset_index(drop=True), label, weight, labels["lane"].to_numpy(dtype=str))


def train(examples: TrainingSet, features: Sequence[str] = CLASSIFIER_B, duplicate: bool = True) -> Classifier:
    """Train a classifier.

    Parameters
    ----------
    examples : TrainingSet
        Labelled alarms.
    features : sequence of str
        Columns to use.
    duplicate : bool
        Whether hits count as often as their weight says.

    Returns
    -------
    Classifier
        The classifier.

    Raises
    ------
    ValueError
        If a column is missing or a class has no example.
    """
    missing = [name for name in features if name not in examples.features.columns]
    if missing:
        raise ValueError(f"features must be columns of the feature table, got {', '.join(missing)}")
    values = examples.features[list(features)].to_numpy(dtype=np.float64)
    weight = examples.weight if duplicate else np.ones_like(examples.weight)
    normalizer = HistogramNormalizer().fit(values, sample_weight=weight)
    discriminant = FisherDiscriminant().fit(normalizer.transform(values), examples.label, sample_weight=weight)
    notes = {
        "hits": int(examples.label.sum()),
        "false_alarms": int((examples.label == 0).sum()),
        "lanes": [str(name) for name in np.unique(examples.lane)],
        "duplication": duplicate,
    }
    return Classifier(tuple(features), normalizer, discriminant, notes)


def save_classifier(classifier: Classifier, folder: str | Path, notes: dict[str, Any] | None = None) -> Path:
    """Write a classifier: ``model.json``, ``direction.npy`` and one ``knots-N.npy`` per feature; whole or not at all.

    Parameters
    ----------
    classifier : Classifier
        The classifier.
    folder : str or Path
        Folder to make or, if it holds a classifier, to replace.
    notes : dict, optional
        More to remember, such as what it was trained on.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If something else lies there.
    """
    folder = check_free_model(folder)
    partial = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    arrays = {"direction.npy": classifier.discriminant.direction_}
    arrays |= {f"knots-{i}.npy": knots for i, knots in enumerate(classifier.normalizer.knots_)}
    content = {name: _npy(array) for name, array in arrays.items()}
    for name, data in content.items():
        write_whole(partial / name, data)
    model = {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "features": list(classifier.features),
        "threshold": classifier.discriminant.threshold_,
        "notes": classifier.notes | (notes or {}),
        "files": {name: sha256(data) for name, data in content.items()},
    }
    write_whole(partial / "model.json", seal(model))
    replace_folder(partial, folder)
    return folder


def check_free_model(folder: str | Path) -> Path:
    """Make sure that a classifier may be written at a place.

    Parameters
    ----------
    folder : str or Path
        The place.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    FileExistsError
        If something that is no classifier lies there.
    """
    return check_free_folder(folder, ("model.json",), "model")


def load_classifier(folder: str | Path) -> Classifier:
    """Read a classifier.

    Parameters
    ----------
    folder : str or Path
        Folder of :func:`save_classifier`.

    Returns
    -------
    Classifier
        The classifier.

    Raises
    ------
    ValueError
        If it is no classifier, or a file is missing or altered.
    """
    folder = Path(folder)
    try:
        model = _read_model(folder)
        arrays = {name: _checked(inside(folder, name), digest) for name, digest in model["files"].items()}
        names = tuple(str(name) for name in model["features"])
        normalizer, discriminant = HistogramNormalizer(), FisherDiscriminant()
        normalizer.knots_ = [arrays[f"knots-{i}.npy"] for i in range(len(names))]
        discriminant.direction_, discriminant.threshold_ = arrays["direction.npy"], float(model["threshold"])
        notes = dict(model["notes"])
    except FileNotFoundError as error:
        raise ValueError(f"model {folder}: not a whole model: {error.filename} is missing") from None
    except (KeyError, TypeError, AttributeError, OSError, EOFError, MemoryError, OverflowError) as error:
        raise ValueError(f"model {folder}: it cannot be read ({error})") from None
    except ValueError as error:
        raise ValueError(f"model {folder}: {str(error).removeprefix(f'model {folder}: ')}") from None
    normalizer.n_features_in_ = discriminant.n_features_in_ = len(names)
    discriminant.classes_ = np.array([0, 1])
    return Classifier(names, normalizer, discriminant, notes)


def _read_model(folder: Path) -> dict[str, Any]:
    data = read_limited(folder / "model.json")
    try:
        model = unseal(data)
        if (model["format"], model["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        return model
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"model {folder}: model.json is altered: {error}") from None


def _npy(array: FloatArray) -> bytes:
    buffer = BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def _checked(path: Path, digest: str) -> FloatArray:
    data = path.read_bytes()
    if sha256(data) != digest:
        raise ValueError(f"model {path.parent}: {path.name} differs from what was written")
    try:
        return np.asarray(np.load(BytesIO(data), allow_pickle=False), dtype=np.float64)
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ValueError(f"{path.name} cannot be read ({error!r})") from None
