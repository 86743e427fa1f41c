"""Interface of scorers, and checks of arrays and settings from an untrusted file."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Self

import numpy as np

from flgpr.types import AnyArray, Entries, FloatArray

Arrays = Mapping[str, AnyArray]


class Checked:
    """Check the arrays and settings of a file by name, type, size and values.

    Each is taken once; nothing may be left.
    """

    def __init__(self, settings: Mapping[str, Any], arrays: Arrays) -> None:
        self._settings = dict(settings)
        self._arrays = dict(arrays)

    def array(
        self,
        name: str,
        shape: Sequence[int | None],
        *types: type[np.generic],
        finite: bool = True,
    ) -> AnyArray:
        """Return an array of one of several ``types``, by default float64, of finite numbers.

        None in ``shape`` allows any length of an axis. Without ``finite``, infinity may be among
        the numbers, but NaN may not.
        """
        if name not in self._arrays:
            raise ValueError(f"array {name!r} is missing")
        value = self._arrays.pop(name)
        allowed = [np.dtype(kind) for kind in types or (np.float64,)]
        if value.dtype not in allowed:
            names = " or ".join(map(str, allowed))
            raise ValueError(f"array {name!r} must hold {names}, got {value.dtype}")
        if not _shape_fits(value.shape, shape):
            described = ", ".join("any" if length is None else str(length) for length in shape)
            raise ValueError(f"array {name!r} must have the shape ({described}), got {value.shape}")
        bad = ~np.isfinite(value) if finite else np.isnan(value)
        if bad.any():
            rule = "be finite" if finite else "be numbers"
            raise ValueError(
                f"array {name!r} must {rule}, got {np.count_nonzero(bad)} that are not"
            )
        return value

    def take_all(self) -> None:
        """Take all arrays that are left, whatever they are."""
        self._arrays = {}

    def has(self, name: str) -> bool:
        """Return whether an array of this name is there and was not taken yet."""
        return name in self._arrays

    def number(self, name: str, low: float = -math.inf, high: float = math.inf) -> float:
        """Return a finite number from ``low`` to ``high``."""
        value = self._setting(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise ValueError(f"setting {name!r} must be a finite number, got {_short(value)}")
        if not low <= value <= high:
            raise ValueError(
                f"setting {name!r} must lie between {low:g} and {high:g}, got {value:g}"
            )
        return float(value)

    def whole(self, name: str, low: int, high: int) -> int:
        """Return a whole number from ``low`` to ``high``."""
        value = self._setting(name)
        if type(value) is not int or not low <= value <= high:
            raise ValueError(
                f"setting {name!r} must be a whole number from {low} to {high}, got {_short(value)}"
            )
        return value

    def flag(self, name: str) -> bool:
        """Return true or false."""
        value = self._setting(name)
        if type(value) is not bool:
            raise ValueError(f"setting {name!r} must be true or false, got {_short(value)}")
        return value

    def choice(self, name: str, options: Sequence[str]) -> str:
        """Return one of some words."""
        value = self._setting(name)
        if not isinstance(value, str) or value not in options:
            raise ValueError(
                f"setting {name!r} must be one of {', '.join(options)}, got {_short(value)}"
            )
        return value

    def done(self) -> None:
        """Refuse what was not taken: a model holds nothing that its scorer does not use."""
        for kind, remaining in (("array", self._arrays), ("setting", self._settings)):
            if remaining:
                first = sorted(map(str, remaining))[0]
                raise ValueError(f"{kind} {_short(first)} does not belong to it")

    def _setting(self, name: str) -> Any:
        """Take a setting out."""
        if name not in self._settings:
            raise ValueError(f"setting {name!r} is missing")
        return self._settings.pop(name)


def refuse_unless(fits: bool, rule: str, got: Any) -> None:
    """Refuse a value that does not fit, with the rule that it breaks."""
    if not fits:
        raise ValueError(f"{rule}, got {_short(got)}")


def _shape_fits(shape: tuple[int, ...], expected: Sequence[int | None]) -> bool:
    """Compare a shape with the one expected, in which None allows any length."""
    if len(shape) != len(expected):
        return False
    lengths = zip(shape, expected, strict=True)
    return all(allowed in (None, length) for length, allowed in lengths)


def _short(value: Any) -> str:
    """Return a value as text of at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class StoredScorer(ABC):
    """Scores of samples from named arrays and settings. Its subclasses are dataclasses.

    A file holds the fields without a default, those of a field that is a scorer's part as well.
    """

    threshold: float  #: score at which the estimator itself decides

    @abstractmethod
    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features) as the estimator does: (n_samples,)."""

    @classmethod
    @abstractmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted estimator."""

    @classmethod
    @abstractmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of settings and arrays for so many features, which may be more."""

    def arrays(self) -> dict[str, AnyArray]:
        """Return the arrays that the scores depend on."""
        return {name: value for name, value in held_fields(self) if isinstance(value, np.ndarray)}

    def settings(self) -> Entries:
        """Return the settings that the scores depend on, as JSON holds them."""
        return {
            name: value for name, value in held_fields(self) if not isinstance(value, np.ndarray)
        }

    @classmethod
    def restored(cls, settings: Mapping[str, Any], arrays: Arrays, features: int) -> Self:
        """Return the scorer of a file's settings and arrays for so many features.

        Raises
        ------
        ValueError
            If one breaks a rule, is missing or does not belong to the estimator.
        """
        checked = Checked(settings, arrays)
        scorer = cls.taken(checked, features)
        checked.done()
        return scorer


def held_fields(part: Any) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the fields that a file holds of a scorer, or of a part of one."""
    for field in fields(part):
        value = getattr(part, field.name)
        if is_dataclass(value):
            yield from held_fields(value)
        elif field.default is MISSING:
            yield field.name, value
