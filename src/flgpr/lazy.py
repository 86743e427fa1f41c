"""Packages that load their public names when they are asked for.

The public names of a package are listed in its ``__init__.pyi``, which type checkers read, as
``x as x``. :func:`face` reads the same file, so that every name is listed once. Importing a package
then takes no time, and a command loads only what it uses.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any


def face(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, from its stub.

    ``file`` is the package's ``__file__``; the stub lies beside it. Names whose home is another
    top-level package are left out where that is not installed.
    """
    source: dict[str, tuple[str, str]] = {}
    stub = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    for node in ast.parse(stub).body:
        if isinstance(node, ast.ImportFrom) and node.module != "typing":
            module = node.module or ""
            if not _has_package(module.partition(".")[0]):
                continue
            for alias in node.names:
                source[alias.asname or alias.name] = (module, alias.name)
    names = sorted(source)

    def load(name: str) -> Any:
        """Return a public name, importing its module."""
        if name not in source:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, original = source[name]
        value = getattr(import_module(module), original)
        setattr(sys.modules[package], name, value)  # the next access does not come here
        return value

    def list_names() -> list[str]:
        """Return the public names."""
        return list(names)

    return load, list_names, names


@cache
def _has_package(name: str) -> bool:
    """Return whether a top-level package can be imported."""
    return name in sys.modules or find_spec(name) is not None


class Verb(ModuleType):
    """A package that can be called: ``flgpr.detect`` runs a detection.

    It shows the signature and the documentation of its function, which is loaded for that. What the
    package is for stands behind it.
    """

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Call the function."""
        return self._function()(*arguments, **options)

    def _function(self) -> Callable[..., Any]:
        """Load and return the function."""
        module, name = self.__dict__["__verb__"]
        function: Callable[..., Any] = getattr(import_module(module), name)
        return function

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self._function())

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        package_text = inspect.cleandoc(self.__dict__.get("__doc__") or "")
        called = f"{self.__name__}{self.__signature__}"
        documentation = inspect.getdoc(self._function()) or ""
        summary, _, rest = documentation.partition("\n")
        package = f"Notes\n-----\nAs a package: {package_text}"
        return f"{summary}\n\n``{called}``\n{rest}\n\n{package}\n"


class Verbs(ModuleType):
    """A package with callable packages; ``__verbs__`` names their functions."""

    def __setattr__(self, name: str, value: Any) -> None:
        verb = self.__dict__["__verbs__"].get(name)
        # The import system sets here a package that it has loaded.
        if verb is not None and type(value) is ModuleType:
            value.__class__ = Verb
            value.__verb__ = verb  # type: ignore[attr-defined]
        super().__setattr__(name, value)
