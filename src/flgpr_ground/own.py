"""Detectors of one's own: a class of a module that is named on the command line, as MODULE:CLASS.

Nothing but what the user names is imported. Models, results and submissions hold no code.
"""

from __future__ import annotations

import fnmatch
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import check_alarms
from flgpr.store import sha256
from flgpr.types import FloatArray, floats
from flgpr_ground.ground import LaneData

FEATURES = ("[CMPR]_*",)
"""Columns that a class without ``features`` is given: Wang et al. 2007's ten in every sub-band."""
_NAME = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


@dataclass(frozen=True)
class OwnDetector:
    """A detector of one's own.

    It has ``fit``, and ``decision_function`` or ``predict_proba``, which take rows of features of
    alarms as scikit-learn's classifiers do; or ``detect``, and its ``fit`` and ``detect`` take lanes
    (:class:`flgpr_ground.ground.LaneData`).
    """

    path: str  #: "module:Class"
    make: Callable[[], Any] = field(repr=False)  #: returns a new one that has learnt nothing
    digest: str  #: of the sources that were imported for it
    recipe: str  #: name or file of the recipe whose features or images it reads; "" for C_HH's
    features: tuple[str, ...]  #: patterns of the columns that it reads
    takes_lanes: bool  #: whether it is given lanes in place of features
    method: str  #: what it is, in a line
    authors: tuple[str, ...]  #: by the ``__author__`` of its module

    @property
    def name(self) -> str:
        """The name of the class as that of an entry."""
        return own_name(self.path)

    def columns(self, known: Sequence[str]) -> list[str]:
        """Return those of the known columns that it reads; a pattern of none is a ValueError."""
        chosen: set[str] = set()
        for pattern in self.features:
            matching = fnmatch.filter(known, pattern)
            if not matching:
                raise ValueError(
                    f"features of {self.path} must be columns of the feature table, "
                    f"{', '.join(known)}, got {pattern!r}"
                )
            chosen.update(matching)
        return [name for name in known if name in chosen]

    def fitted(self, *examples: Any) -> Any:
        """Return one that has learnt: from features and labels of alarms, or from lanes."""
        detector = self.make()
        self._call(detector, "fit", *examples)
        return detector

    def scores(self, detector: Any, rows: pd.DataFrame) -> FloatArray:
        """Return the confidence of each alarm: the decision function, or else p of the last class."""
        if not len(rows):
            return np.zeros(0)
        method = "decision_function"
        if not hasattr(detector, method):
            method = "predict_proba"
        values = np.asarray(self._call(detector, method, rows))
        if method == "predict_proba" and values.ndim == 2:
            values = values[:, -1]
        if values.shape != (len(rows),) or not np.isfinite(floats(values)).all():
            raise ValueError(
                f"{method} of {self.path} must give a finite number for each of {len(rows)} alarms, "
                f"got an array of shape {values.shape} or values that are not finite"
                f"{_line_of(detector, method)}"
            )
        return values.astype(float)

    def detect(self, detector: Any, lane: LaneData) -> pd.DataFrame:
        """Return the alarms that it finds in a lane: ``x``, ``y`` (m) and ``confidence``."""
        found = self._call(detector, "detect", lane)
        if not isinstance(found, pd.DataFrame):
            raise ValueError(
                f"detect of {self.path} must return a DataFrame with the columns x, y (m) and "
                f"confidence, got {type(found).__name__}{_line_of(detector, 'detect')}"
            )
        try:
            return check_alarms(found)[["x", "y", "confidence"]]
        except ValueError as error:
            line = _line_of(detector, "detect")
            raise ValueError(f"detect of {self.path}: {error}{line}") from None

    def _call(self, detector: Any, method: str, *given: Any) -> Any:
        """Call a method; whatever it raises is told with the line in which that happened."""
        try:
            return getattr(detector, method)(*given)
        except Exception as error:
            fault = _told(error, self.path.partition(":")[0])
            raise ValueError(f"{method} of {self.path} must not fail, got {fault}") from error


def is_own(what: str | Path) -> bool:
    """Return whether a text names a class of a module, and no file."""
    return ":" in str(what) and not Path(what).exists()


def own_name(path: str) -> str:
    """Return the name of "module:MyEstimator" as that of an entry, ``my-estimator``."""
    borders = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|_+"
    return re.sub(borders, "-", path.partition(":")[2]).strip("-").lower()


def load_own(path: str) -> OwnDetector:
    """Import a detector from the current folder or an installed package.

    Parameters
    ----------
    path : str
        "module:Class". What it names may also be a function without parameters that returns a
        detector.

    Returns
    -------
    OwnDetector
        The detector.

    Raises
    ------
    ValueError
        If there is no such module or attribute, importing fails, or it has not the methods.
    """
    module_name, _, attribute = path.partition(":")
    if not _NAME.fullmatch(path) or module_name.endswith(".py"):
        raise ValueError(
            f"a detector of one's own must be named MODULE:CLASS without .py, such as "
            f"my_package:MyEstimator, got {path!r}"
        )
    module = _import(module_name)
    make = getattr(module, attribute, None)
    if make is None:
        members = vars(module).values()
        classes = [
            of.__name__ for of in members if isinstance(of, type) and of.__module__ == module_name
        ]
        raise ValueError(
            f"module {module_name} ({module.__file__}) must have {attribute}, got one with "
            f"{', '.join(classes) or 'no class'}"
        )
    if not callable(make):
        raise ValueError(
            f"{path} must be a class, or a function without parameters that returns a detector, got "
            f"{type(make).__name__}"
        )
    try:
        detector = make()
    except Exception as error:
        fault = _told(error, module_name)
        raise ValueError(f"{path} must be made without arguments, got {fault}") from error
    takes_lanes = hasattr(detector, "detect")
    scoring = ("decision_function", "predict_proba", "detect")
    missing = [] if hasattr(detector, "fit") else ["fit"]
    if not any(hasattr(detector, name) for name in scoring):
        missing.append("decision_function, predict_proba or detect")
    if missing:
        raise ValueError(
            f"{path} must have fit, and decision_function, predict_proba or detect, got a "
            f"{type(detector).__name__} without {' and without '.join(missing)}{_line_of(make)}"
        )
    author = getattr(module, "__author__", "")
    features = getattr(detector, "features", FEATURES)
    return OwnDetector(
        path=path,
        make=make,
        digest=_digest_of(module),
        recipe=str(getattr(detector, "recipe", "")),
        features=(features,) if isinstance(features, str) else tuple(features),
        takes_lanes=takes_lanes,
        method=((make.__doc__ or "").strip() or path).splitlines()[0],
        authors=(author,) if isinstance(author, str) and author else (),
    )


def _import(name: str) -> ModuleType:
    """Import a module, the current folder before what is installed."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        # One that the module itself imports is another fault.
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise ValueError(
                f"module {name} must be in the current folder, {here}, or an installed package, got "
                "none there"
            ) from None
        raise ValueError(f"module {name} must import, got {_told(error, name)}") from error
    except Exception as error:
        raise ValueError(f"module {name} must import, got {_told(error, name)}") from error


def _told(error: Exception, module: str) -> str:
    """Return an error with the last line of the user's own sources that led to it."""
    text = f"{type(error).__name__}: {error}"
    top = sys.modules.get(module.partition(".")[0])
    home = Path(getattr(top, "__file__", None) or Path.cwd() / "_").parent
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        # What is installed beside the user's sources, as in a folder .venv, is not theirs.
        if file.is_relative_to(home) and "site-packages" not in file.relative_to(home).parts:
            return f"{text} ({file.name}, line {frame.lineno})"
    return text


def _line_of(made: Any, method: str = "") -> str:
    """Return file and line of a class, or of a method of its instance, in brackets; "" if unknown."""
    try:
        source = getattr(made, method) if method else made
        file, line = inspect.getsourcefile(source), inspect.getsourcelines(source)[1]
    except (OSError, TypeError):  # not written in Python, or in no file
        return ""
    return f" ({Path(file or '').name}, line {line})"


def _digest_of(module: ModuleType) -> str:
    """Return a digest of the sources of a module, and of those beside it that are imported."""
    top = sys.modules[module.__name__.partition(".")[0]]
    home = Path(top.__file__ or module.__file__ or "").parent
    files = {Path(source.__file__ or "") for source in (module, top)}
    # Beside a single module of a folder of installed packages stand those of others.
    if home.name != "site-packages":
        for loaded in list(sys.modules.values()):
            file = Path(getattr(loaded, "__file__", None) or "")
            if file.is_relative_to(home) and "site-packages" not in file.relative_to(home).parts:
                files.add(file)
    sources = sorted(file for file in files if file.suffix == ".py" and file.is_file())
    return sha256(b"\0".join(file.read_bytes() for file in sources))
