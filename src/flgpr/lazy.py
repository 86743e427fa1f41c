"""Faces of packages that load what is behind them when it is asked for.

A package's ``__init__.pyi`` tells its face: type checkers read it, for which it says ``x as x``, and so does
:func:`face`, so that every name stands in one place. Importing a package costs nothing then, and a command pays only
for what it uses.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


def face(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Make a package's ``__getattr__``, ``__dir__`` and ``__all__``; its stub lies beside its ``__file__``."""
    source: dict[str, tuple[str, str]] = {}
    for node in ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module != "typing":
            source |= {
                alias.asname or alias.name: (node.module or "", alias.name) for alias in node.names
            }

    def load(name: str) -> Any:
        if name not in source:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, original = source[name]
        value = getattr(import_module(module), original)
        setattr(sys.modules[package], name, value)  # the next look finds it without coming here
        return value

    return load, lambda: sorted(source), sorted(source)


class Verb(ModuleType):
    """A package that is named as what it does: calling ``flgpr.detect`` runs a detection."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Do it."""
        module, name = self.__dict__["__verb__"]
        return getattr(import_module(module), name)(*arguments, **options)


class Verbs(ModuleType):
    """A package some of whose packages are verbs as well: ``__verbs__`` tells the function of each."""

    def __setattr__(self, name: str, value: Any) -> None:
        verb = self.__dict__["__verbs__"].get(name)
        if (
            verb is not None and type(value) is ModuleType
        ):  # the import system hands over a package it has loaded
            value.__class__ = Verb
            value.__verb__ = verb  # type: ignore[attr-defined]
        super().__setattr__(name, value)
