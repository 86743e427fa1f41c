"""A trained detector together with the image chips it looks at, and its file."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.detect.linear_quadratic import LinearQuadraticForm

_FORMAT = "flgpr chip detector"
_VERSION = 2
_ARRAYS = ("strength", "vectors", "linear", "offset")


@dataclass(frozen=True)
class ChipDetector:
    """Linear-quadratic forms on raw image chips, whitening included.

    Attributes
    ----------
    forms : tuple of LinearQuadraticForm
        The score is the largest of their values.
    channels : tuple of str
        Names of the image channels in the order of the features, such as ("HH", "VV").
    shape : (int, int)
        Pixels of a chip down-track and cross-track; (28, 1) is the paper's range cut.
    spacing : (float, float)
        Pixel spacing down-track and cross-track, m.
    notes : dict
        How it was trained; anything JSON can hold.
    """

    forms: tuple[LinearQuadraticForm, ...]
    channels: tuple[str, ...]
    shape: tuple[int, int]
    spacing: tuple[float, float]
    notes: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.forms:
            raise ValueError("forms must hold at least one form, got none")
        features = len(self.channels) * self.shape[0] * self.shape[1]
        if any(form.linear.size != features for form in self.forms):
            sizes = [form.linear.size for form in self.forms]
            raise ValueError(f"forms must have {features} features for these channels and chips, got {sizes}")
        if not all(step > 0 for step in self.spacing):
            raise ValueError(f"spacing must be positive, got {self.spacing}")

    def likelihood(
        self, image: NDArray[Any], channels: tuple[str, ...] | None = None, spacing: tuple[float, float] | None = None
    ) -> NDArray[np.float32]:
        """Score the chip around every pixel (the "likelihood map" of Cosgrove et al. 2004, Sec. IV-B).

        Parameters
        ----------
        image : (channel, y, x) ndarray
            Image; not finite where nothing was imaged.
        channels : tuple of str, optional
            Names of the image's channels, compared with the detector's when given.
        spacing : (float, float), optional
            Pixel spacing down-track and cross-track, m, compared with the detector's when given. A chip one pixel wide
            fits any cross-track spacing.

        Returns
        -------
        (y, x) ndarray of float32
            Scores; NaN where the chip leaves the image or touches a pixel that is not finite.

        Raises
        ------
        ValueError
            If the image has other channels or pixels than the detector was trained for.
        """
        if channels is not None and tuple(channels) != self.channels:
            raise ValueError(f"channels must be {self.channels}, got {tuple(channels)}")
        axes = [axis for axis in (0, 1) if self.shape[axis] > 1]
        if spacing is not None and not all(np.isclose(spacing[k], self.spacing[k], rtol=1e-3) for k in axes):
            raise ValueError(f"spacing must be {self.spacing} m, got {spacing}")
        maps = [form.likelihood(image, self.shape) for form in self.forms]
        return maps[0] if len(maps) == 1 else np.asarray(np.max(maps, axis=0))

    def save(self, path: str | Path) -> Path:
        """Write a folder of model.json and one npy file per array.

        Parameters
        ----------
        path : path
            Folder to make; a detector's folder that is already there is replaced.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        FileExistsError
            If something that is no detector's folder lies at the path.
        """
        target = Path(path)
        if target.exists() and not (target / "model.json").is_file():
            raise FileExistsError(f"{target} exists and is no saved detector")
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
        try:
            for number, form in enumerate(self.forms):
                for name in _ARRAYS:
                    np.save(folder / f"form{number}-{name}.npy", getattr(form, name), allow_pickle=False)
            files = {file.name: _digest(file.read_bytes()) for file in sorted(folder.iterdir())}
            (folder / "model.json").write_bytes(_sealed({**self._description(), "files": files}))
            folder.chmod(0o755)
            if target.exists():
                shutil.rmtree(target)
            os.replace(folder, target)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        return target

    def _description(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "version": _VERSION,
            "channels": list(self.channels),
            "shape": list(self.shape),
            "spacing_m": list(self.spacing),
            "constants": [float(form.constant) for form in self.forms],
            "notes": self.notes,
        }


def load_detector(path: str | Path) -> ChipDetector:
    """Read a detector that :meth:`ChipDetector.save` wrote.

    Parameters
    ----------
    path : path
        Its folder.

    Returns
    -------
    ChipDetector
        The detector.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    ValueError
        If the folder holds something else, or arrays that do not fit each other.
    """
    folder = Path(path)
    data = (folder / "model.json").read_bytes()
    try:
        told = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{folder / 'model.json'} is not valid JSON: {error}") from None
    if not isinstance(told, dict) or told.get("format") != _FORMAT or told.get("version") != _VERSION:
        raise ValueError(f"{folder} must hold a '{_FORMAT}' of version {_VERSION}")
    if _sealed({name: value for name, value in told.items() if name != "sha256"}) != data:
        raise ValueError(f"{folder / 'model.json'} differs from what was written")
    try:
        for name, digest in told["files"].items():
            if Path(name).name != name or _digest((folder / name).read_bytes()) != digest:
                raise ValueError(f"{folder / name} differs from what was written")
        shape, spacing = (int(told["shape"][0]), int(told["shape"][1])), told["spacing_m"]
        forms = tuple(_read_form(folder, number, float(k)) for number, k in enumerate(told["constants"]))
        return ChipDetector(forms, tuple(told["channels"]), shape, (spacing[0], spacing[1]), told["notes"])
    except (KeyError, IndexError, TypeError, AttributeError, EOFError) as error:
        raise ValueError(f"{folder / 'model.json'} lacks or garbles an entry: {error}") from None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _sealed(content: dict[str, Any]) -> bytes:
    """Write a description with its own digest, in the one form that is taken back."""
    own = _digest(json.dumps(content, sort_keys=True, allow_nan=False).encode())
    return json.dumps({**content, "sha256": own}, indent=2, allow_nan=False).encode() + b"\n"


def _read_form(folder: Path, number: int, constant: float) -> LinearQuadraticForm:
    try:
        arrays = {name: np.load(folder / f"form{number}-{name}.npy", allow_pickle=False) for name in _ARRAYS}
    except Exception as error:  # the parser raises whatever it stumbles over
        raise ValueError(f"arrays of form {number} in {folder} cannot be read ({error!r})") from None
    shapes = {name: array.shape for name, array in arrays.items()}
    rank, features = arrays["strength"].size, arrays["linear"].size
    wanted = {"strength": (rank,), "vectors": (rank, features), "linear": (features,), "offset": (rank,)}
    if shapes != wanted:
        raise ValueError(f"arrays of form {number} in {folder} do not fit each other: {shapes}")
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise ValueError(f"arrays of form {number} in {folder} must be finite")
    return LinearQuadraticForm(constant=constant, **arrays)
