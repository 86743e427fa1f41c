"""The model of a recipe: what all its learning stages have learnt, in one folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

import flgpr
from flgpr.chain.classifier import Classifier
from flgpr.chain.engine import Arrays
from flgpr.chain.estimators import TrainedEstimator
from flgpr.chain.recipe import Recipe
from flgpr.door import Folder
from flgpr.store import Bundle, check_free_folder, sha256, write_bundle
from flgpr.store.outputs import whole_output

FORMAT = "flgpr-model"
VERSION = 1
MODEL_FILE = "model.bundle"
DETECTOR = "detector"
"""Under which name the detector's arrays are kept, beside those of the stages."""
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


def unlearnt(recipe: Recipe, model: Model, training: bool = False) -> list[str]:
    """List the recipe's stages that have not learnt yet; but for training that is an error, as is a vain detector."""
    if model.detector is not None and not (recipe.features or recipe.columns or recipe.detector):
        raise ValueError("model needs a recipe with the table features, got one without")
    names = [name for name in recipe.learning() if name not in model.stages]
    if names and not training:
        raise ValueError(
            f"recipe {recipe.name!r} learns ({', '.join(recipe.learning())}) and needs a model: "
            "make one with "
            f"`flgpr train RUN --truth TRUTH --recipe {recipe.name} -o MODEL` and give it with "
            "--model"
        )
    return names


def save_model(
    model: Model | Detector, folder: str | Path, notes: Mapping[str, Any] | None = None
) -> Path:
    """Write a model, a folder with one bundle of arrays and words; whole or not at all.

    ``folder`` is made or, if it holds a model, replaced; anything else there is a FileExistsError.
    ``notes`` are added to its own.
    """
    model = as_model(model)
    folder = check_free_model(folder)
    groups: dict[str, Mapping[str, NDArray[Any]]] = dict(model.stages)
    own: dict[str, Any] = {}
    if model.detector is not None:
        groups[DETECTOR] = model.detector.arrays()
        own = model.detector.notes
    about = {
        "format": FORMAT,
        "version": VERSION,
        "flgpr": flgpr.__version__,
        "detector": None if model.detector is None else model.detector.about(),
        "stages": list(model.stages),
        "notes": {**model.notes, **own, **(notes or {})},
    }
    arrays = {
        f"{stage}.{name}": array for stage, group in groups.items() for name, array in group.items()
    }
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_output(folder, replace=True) as made:
        made.mkdir()
        write_bundle(made / MODEL_FILE, arrays, about, lasting=True)
    return folder


def _stage_names(about: Mapping[str, Any]) -> list[str]:
    """Take the names of the stages out of a model's words."""
    names = about["stages"]
    texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not texts or len({*names, DETECTOR}) <= len(names):
        raise ValueError(f"stages must be a list of different names, got {str(names)[:60]}")
    return list(names)


def check_free_model(folder: str | Path) -> Path:
    """Make sure that a model may be written at a place: nothing, or another model, lies there."""
    return check_free_folder(folder, (MODEL_FILE,), "model")


def read_model(folder: str | Path) -> bytes:
    """Read a model's file, whose SHA-256 stands for the model; a ValueError if it is missing or no regular file."""
    try:
        return Folder(folder).read(MODEL_FILE)
    except FileNotFoundError as error:
        raise ValueError(
            f"model {folder}: not a whole model: {error.filename} is missing"
        ) from None
    except NotADirectoryError:
        raise ValueError(f"model {folder}: not a whole model: it is no folder") from None


def load_model(folder: str | Path, digest: str | None = None) -> Model:
    """Read a model of :func:`save_model`; a ValueError if it is none, altered, or of another ``digest`` (SHA-256)."""
    path = Path(folder) / MODEL_FILE
    data = read_model(folder)
    if digest not in (None, sha256(data)):
        raise ValueError(f"model {folder}: {MODEL_FILE} differs from what was written")
    try:
        bundle = Bundle(path, data)
        about = bundle.about
        if (about.get("format"), about.get("version")) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        groups: dict[str, Arrays] = {name: {} for name in [*_stage_names(about), DETECTOR]}
        for name, array in bundle.items():
            stage, _, which = name.rpartition(".")
            groups[stage][which] = array
        own = groups.pop(DETECTOR)
        notes = dict(about["notes"])
        detector: Detector | None = None
        if about["detector"] is not None:
            kind = Classifier if about["detector"]["estimator"] == "fisher" else TrainedEstimator
            detector = kind.restored(about["detector"], own, notes)
        elif own:
            raise ValueError(f"it holds {len(own)} arrays of a detector that it does not name")
    except ValueError as error:
        raise ValueError(f"model {folder}: {error}") from None
    except Exception as error:  # parsers raise whatever they stumble over
        raise ValueError(f"model {folder}: it cannot be read ({error!r})") from None
    return Model(detector, groups, notes)


def describe_model(folder: str | Path) -> dict[str, Any]:
    """Return what a model holds by its head alone: none of its arrays is read, and nothing is made of them.

    Returns
    -------
    dict
        ``path``, ``format``, ``version``, ``flgpr`` (that wrote it), ``detector`` (its words, or
        None), ``stages``, ``notes``, ``arrays`` (name, dtype, shape, bytes of each) and ``bytes``
        of all.

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
        about = bundle.about
        if (about.get("format"), about.get("version")) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        told = {
            name: about.get(name)
            for name in ("format", "version", "flgpr", "detector", "stages", "notes")
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"model {folder}: {error}") from None
    arrays = bundle.listed()
    return {
        "path": str(path),
        **told,
        "arrays": arrays,
        "bytes": sum(one["bytes"] for one in arrays),
    }
