"""The model of a recipe: what all its learning stages have learnt, in one folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flgpr
from flgpr.chain.classifier import Classifier
from flgpr.chain.estimators import TrainedEstimator
from flgpr.chain.passes import Arrays
from flgpr.io import check_free_folder, inside, read_limited, replace_folder, seal, sha256, unseal, write_whole

FORMAT, VERSION = "flgpr-model", 1
Detector = Classifier | TrainedEstimator


@dataclass(frozen=True)
class Model:
    """What was learnt: the alarms' detector, arrays of the stages by their names in the recipe, and notes."""

    detector: Detector | None = None
    stages: dict[str, Arrays] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)


def as_model(model: Model | Detector | None) -> Model:
    """Take a detector as a model that has nothing else."""
    return model if isinstance(model, Model) else Model(model)


def save_model(model: Model | Detector, folder: str | Path, notes: Mapping[str, Any] | None = None) -> Path:
    """Write a model: ``model.json`` and one ``STAGE.NAME.npy`` per array; whole or not at all.

    ``folder`` is made or, if it holds a model, replaced; anything else there is a FileExistsError. ``notes`` are
    added to its own.
    """
    model, folder = as_model(model), check_free_model(folder)
    partial = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    groups: dict[str, Mapping[str, NDArray[Any]]] = dict(model.stages)
    if model.detector is not None:
        groups["detector"] = model.detector.arrays()
    content = {f"{stage}.{name}.npy": _npy(array) for stage, group in groups.items() for name, array in group.items()}
    for name, data in content.items():
        write_whole(partial / name, data)
    own = {} if model.detector is None else model.detector.notes
    about = {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "detector": None if model.detector is None else model.detector.about(),
        "stages": list(model.stages),
        "notes": {**model.notes, **own, **(notes or {})},
        "files": {name: sha256(data) for name, data in content.items()},
    }
    write_whole(partial / "model.json", seal(about))
    replace_folder(partial, folder)
    return folder


def check_free_model(folder: str | Path) -> Path:
    """Make sure that a model may be written at a place: nothing, or another model, lies there."""
    return check_free_folder(folder, ("model.json",), "model")


def load_model(folder: str | Path) -> Model:
    """Read a model of :func:`save_model`; a ValueError if it is none, or a file is missing or altered."""
    folder = Path(folder)
    try:
        about = _about(folder)
        arrays = {name: _checked(inside(folder, name), digest) for name, digest in about["files"].items()}
        groups: dict[str, Arrays] = {str(name): {} for name in [*about["stages"], "detector"]}
        for name, array in arrays.items():
            stage, _, which = name.removesuffix(".npy").rpartition(".")
            groups[stage][which] = array
        own, notes = groups.pop("detector"), dict(about["notes"])
        detector: Detector | None = None
        if about["detector"] is not None:
            kind = Classifier if about["detector"]["estimator"] == "fisher" else TrainedEstimator
            detector = kind.restored(about["detector"], own, notes)
    except FileNotFoundError as error:
        raise ValueError(f"model {folder}: not a whole model: {error.filename} is missing") from None
    except ValueError as error:
        raise ValueError(f"model {folder}: {str(error).removeprefix(f'model {folder}: ')}") from None
    except Exception as error:  # parsers raise whatever they stumble over
        raise ValueError(f"model {folder}: it cannot be read ({error!r})") from None
    return Model(detector, groups, notes)


def _about(folder: Path) -> dict[str, Any]:
    data = read_limited(folder / "model.json")
    try:
        about = unseal(data)
        if (about["format"], about["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        return about
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"model {folder}: model.json is altered: {error}") from None


def _npy(array: NDArray[Any]) -> bytes:
    buffer = BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def _checked(path: Path, digest: str) -> NDArray[Any]:
    data = path.read_bytes()
    if sha256(data) != digest:
        raise ValueError(f"model {path.parent}: {path.name} differs from what was written")
    try:
        return np.asarray(np.load(BytesIO(data), allow_pickle=False))
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ValueError(f"{path.name} cannot be read ({error!r})") from None
