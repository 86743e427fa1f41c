"""The model of a recipe: what all its learning stages have learnt, in one folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flgpr
from flgpr.door import Folder
from flgpr.engine import bundle_groups
from flgpr.json_text import check_format
from flgpr.method.classifier import Classifier
from flgpr.method.estimators import TrainedEstimator
from flgpr.method.unlike import TrainingGround
from flgpr.recipe.radar_setup import radar_setup
from flgpr.recipe.schema import Recipe
from flgpr.store import Bundle, check_free_folder, sha256, write_bundle
from flgpr.store.files import taken_for
from flgpr.store.outputs import atomic_output
from flgpr.types import AnyArray, Arrays, Entries, PathLike

FORMAT = "flgpr-model"
VERSION = 1
MODEL_FILE = "model.bundle"
DETECTOR = "detector"
"""Name of the group of the detector's arrays, beside those of the stages."""
Detector = Classifier | TrainedEstimator
_SAME_ARRAY = 0.2  # share by which figures of arrays that count as one may differ
_HEAD = ("format", "version", "flgpr", "detector", "stages", "notes")
"""Entries of a model's head, in their order."""


@dataclass(frozen=True)
class Model:
    """What was learnt from training lanes."""

    detector: Detector | None = None  #: scores the alarms
    #: arrays of the stages, by the names that these have in the recipe
    stages: dict[str, Arrays] = field(default_factory=dict)
    notes: Entries = field(default_factory=dict)  #: what it was made of, and counts
    #: what tells whether ground is unlike that of training; None in models of older versions
    ground: TrainingGround | None = None


def as_model(model: Model | Detector | None) -> Model:
    """Return a model, or a detector as a model that holds nothing else."""
    if isinstance(model, Model):
        return model
    return Model(model)


def unlearnt(recipe: Recipe, model: Model, training: bool = False) -> list[str]:
    """List the recipe's stages that have not learnt yet.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    model : Model
        What has been learnt.
    training : bool
        Whether stages may lack what they learn, as they are being trained.

    Returns
    -------
    list of str
        Names of the stages, in the order in which they learn.

    Raises
    ------
    ValueError
        If a stage lacks what it learns without ``training``, or the model has a detector and the
        recipe has no features for it.
    """
    if model.detector is not None and not (recipe.features or recipe.columns or recipe.detector):
        raise ValueError("model needs a recipe with the table features, got one without")
    names = [name for name in recipe.learning() if name not in model.stages]
    if names and not training:
        raise ValueError(
            f"recipe {recipe.name!r} learns ({', '.join(recipe.learning())}) and needs a model: "
            f"make one with `flgpr.train` on runs with truth, "
            "and give it as `model`"
        )
    return names


def trained_on(model: Model | None, store_sha256: str) -> bool:
    """Return whether a model was trained on the run of this digest, by its own notes.

    A model that was made by another program may have no such note; it counts as not trained on it.
    """
    if model is None:
        return False
    runs = model.notes.get("runs", [])
    return isinstance(runs, list) and store_sha256 in runs


def array_of(run: xr.Dataset) -> dict[str, float]:
    """Return the figures of a run's array that a model depends on: band, Hz; width and height, m."""
    setup = radar_setup(run)
    return {
        "lowest_hz": float(setup.tones[0]),
        "highest_hz": float(setup.tones[-1]),
        "width_m": float(np.ptp([setup.tx[:, 0], setup.rx[:, 0]])),
        "height_m": setup.height,
    }


def of_another_array(model: Model | None, run: xr.Dataset) -> str:
    """Return a sentence where a model was trained with another array than a run's, else ""."""
    trained = None if model is None else model.notes.get("array")
    if not isinstance(trained, dict):
        return ""
    own = array_of(run)
    if set(trained) != set(own):
        return ""
    arrays = [[float(array[name]) for name in own] for array in (trained, own)]
    if np.allclose(arrays[0], arrays[1], rtol=_SAME_ARRAY, atol=_SAME_ARRAY / 2):
        return ""
    told = []
    for low, high, width, height in arrays:
        told.append(
            f"{low / 1e9:.3g} to {high / 1e9:.3g} GHz, {width:.3g} m wide, {height:.3g} m high"
        )
    return (
        f"the model was trained with another array ({told[0]}) than this run's ({told[1]}): its "
        "confidences do not hold; train on lanes of this array"
    )


def save_model(
    model: Model | Detector, folder: PathLike, notes: Mapping[str, Any] | None = None
) -> Path:
    """Write a model as a folder with one bundle of arrays and JSON. A stop leaves no part of it.

    Parameters
    ----------
    model : Model or its detector
        What was learnt.
    folder : str or path
        Made, or replaced if it holds a model.
    notes : mapping, optional
        Added to the model's own.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If the folder holds anything but a model.
    """
    model = as_model(model)
    folder = check_free_model(folder)
    groups: dict[str, Mapping[str, AnyArray]] = dict(model.stages)
    detector_notes: Entries = {}
    if model.detector is not None:
        groups[DETECTOR] = model.detector.arrays()
        detector_notes = model.detector.notes
    head = {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "detector": None if model.detector is None else model.detector.about(),
        "stages": list(model.stages),
        "notes": {**model.notes, **detector_notes, **(notes or {})},
    }
    if model.ground is not None:
        head["ground"] = model.ground.model_dump(mode="json")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(folder, replace=True) as partial:
        partial.mkdir()
        write_bundle(partial / MODEL_FILE, bundle_groups(groups, "."), head, lasting=True)
    return folder


def check_free_model(folder: PathLike) -> Path:
    """Return a folder in which a model may be written.

    Raises
    ------
    FileExistsError
        If anything but another model lies there.
    """
    return check_free_folder(folder, (MODEL_FILE,), "model")


def read_model(folder: PathLike) -> bytes:
    """Return the bytes of a model's file, whose SHA-256 stands for the model.

    Raises
    ------
    ValueError
        If the file is missing, or is no regular file.
    """
    try:
        return Folder(folder).read(MODEL_FILE)
    except FileNotFoundError as error:
        raise ValueError(
            f"model {folder}: not a whole model: {error.filename} is missing{taken_for(folder)}"
        ) from None
    except NotADirectoryError:
        raise ValueError(
            f"model {folder}: not a whole model: it is no folder{taken_for(folder)}"
        ) from None


def load_model(folder: PathLike, digest: str | None = None) -> Model:
    """Read a model that :func:`save_model` wrote. Nothing in the file can run.

    Parameters
    ----------
    folder : str or path
        The model's folder.
    digest : str, optional
        SHA-256 that the file must have.

    Returns
    -------
    Model
        What was learnt.

    Raises
    ------
    ValueError
        If the folder holds no model of this version, or one that was altered, or the file has
        another digest.
    """
    data = read_model(folder)
    if digest not in (None, sha256(data)):
        raise ValueError(f"model {folder}: {MODEL_FILE} differs from what was written")
    return parse_model(data, folder)


def parse_model(data: bytes, folder: PathLike) -> Model:
    """Return the model of the bytes that :func:`read_model` read from a folder.

    Parameters
    ----------
    data : bytes
        Content of the model's file.
    folder : str or path
        The folder, for what is said of a fault.

    Returns
    -------
    Model
        What the stages have learnt.

    Raises
    ------
    ValueError
        If they are no model of this version, or one that was altered.
    """
    try:
        bundle = Bundle(Path(folder) / MODEL_FILE, data)
        head = bundle.about
        check_format(head, FORMAT, VERSION)
        groups: dict[str, Arrays] = {name: {} for name in [*_stage_names(head), DETECTOR]}
        for name, array in bundle.items():
            stage, _, array_name = name.rpartition(".")
            groups[stage][array_name] = array
        detector_arrays = groups.pop(DETECTOR)
        notes = dict(head["notes"])
        detector: Detector | None = None
        if head["detector"] is not None:
            kind = Classifier if head["detector"]["estimator"] == "fisher" else TrainedEstimator
            detector = kind.restored(head["detector"], detector_arrays, notes)
        elif detector_arrays:
            raise ValueError(
                f"it holds {len(detector_arrays)} arrays of a detector that it does not name"
            )
        ground = head.get("ground")
        known = None if ground is None else TrainingGround.model_validate(ground)
        return Model(detector, groups, notes, known)
    except ValueError as error:
        raise ValueError(f"model {folder}: {error}") from None
    except Exception as error:  # parsers raise whatever they stumble over
        raise ValueError(f"model {folder}: it cannot be read ({error!r})") from None


def _stage_names(head: Mapping[str, Any]) -> list[str]:
    """Return the names of the stages in a model's head."""
    names = head["stages"]
    are_texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not are_texts or len({*names, DETECTOR}) <= len(names):
        raise ValueError(f"stages must be a list of different names, got {str(names)[:60]}")
    return list(names)


def describe_model(folder: PathLike) -> Entries:
    """Return what a model holds by its head alone: none of its arrays is read.

    Returns
    -------
    dict
        ``path``, ``format``, ``version``, ``flgpr`` (that wrote it), ``detector`` (its settings,
        or None), ``stages``, ``notes``, ``arrays`` (name, dtype, shape, bytes of each) and
        ``bytes`` of all.

    Raises
    ------
    ValueError
        If the file is missing, or is no model or none of this version.
    """
    path = Path(folder) / MODEL_FILE
    if not path.is_file():
        raise ValueError(f"model {folder}: {MODEL_FILE} is missing")
    try:
        bundle = Bundle(path)
        head = bundle.about
        check_format(head, FORMAT, VERSION)
        entries = {name: head.get(name) for name in _HEAD}
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"model {folder}: {error}") from None
    arrays = bundle.listed()
    total = sum(array["bytes"] for array in arrays)
    return {"path": str(path), **entries, "arrays": arrays, "bytes": total}
