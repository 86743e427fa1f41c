"""Packages that load their public names when they are asked for.

The public names of a package are listed in its ``__init__.pyi``, which type checkers read, as
``x as x``. :func:`face` reads the same file, so that every name is listed once. Importing a package
then takes no time, and a command loads only what it uses.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
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


class Verb:
    """A package that can be called: ``flgpr.detect`` runs a detection.

    It stands where the package would, and what is asked of it is the package's own. It is no module
    itself, because ``help`` of a module lists all that is in it: of this it shows the function.
    """

    def __init__(self, package: ModuleType, function: tuple[str, str]) -> None:
        vars(self).update(package=package, function=function)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Call the function."""
        return self._load()(*arguments, **options)

    def _load(self) -> Callable[..., Any]:
        """Load and return the function."""
        module, name = vars(self)["function"]
        function: Callable[..., Any] = getattr(import_module(module), name)
        return function

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self)["package"], name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(vars(self)["package"], name, value)

    def __delattr__(self, name: str) -> None:
        delattr(vars(self)["package"], name)

    def __dir__(self) -> list[str]:
        return dir(vars(self)["package"])

    def __repr__(self) -> str:
        return f"<verb and package {self.__name__}>"

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self._load())

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        called = textwrap.fill(f"{self.__name__}{self.__signature__}", 90, subsequent_indent="    ")
        summary, _, rest = (inspect.getdoc(self._load()) or "").partition("\n")
        return f"{summary}\n\n{called}\n{rest}\n"


class Verbs(ModuleType):
    """A package with callable packages; ``__verbs__`` names their functions."""

    def __setattr__(self, name: str, value: Any) -> None:
        function = self.__dict__["__verbs__"].get(name)
        # The import system sets here a package that it has loaded.
        if function is not None and type(value) is ModuleType:
            value = Verb(value, function)
        super().__setattr__(name, value)
