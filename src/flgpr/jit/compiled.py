"""numba's ``njit`` with a cache of compiled code that every copy of the same sources shares.

numba stores compiled code beside the source or under a name made of the source's path, so that
another virtual environment or clone would compile everything again. Here the folder is named by a
digest of the sources.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import llvmlite.binding
import numba
from numba.core import caching, config
from numba.core.compiler_lock import global_compiler_lock
from numba.misc.appdirs import AppDirs

from flgpr import system

_UNUSED_DAYS = 60  # after which folders of other sources or machines are removed
# Seconds for which a process waits for what another compiles, which may have been stopped.
_PATIENCE = 120


@cache
def _text(source: Path) -> bytes:
    """Return the text of a module, read once: the file may change while the process runs."""
    return source.read_bytes()


def _modules(source: Path) -> set[Path]:
    """Return a module and those behind it whose text enters its compiled code.

    numba inlines their kernels and freezes their constants. They are the modules of the module's
    own folder, of ``flgpr.kernels`` and of ``flgpr.jit``.
    """
    package = _package_of(source)
    folders = (source.parent, package / "kernels", package / "jit")
    modules = {source}
    unread = [source]
    while unread:
        text = _text(unread.pop()).decode()
        for name in re.findall(r"^from flgpr\.([\w.]+) import", text, re.MULTILINE):
            module = package.joinpath(*name.split(".")).with_suffix(".py")
            holds_kernels = module.parent in folders
            if holds_kernels and module.is_file() and module not in modules:
                modules.add(module)
                unread.append(module)
    return modules


def _package_of(source: Path) -> Path:
    """Return the package's folder that a module belongs to, in whatever copy of the sources."""
    for folder in source.parents:
        if folder.name == "flgpr":
            return folder
    return source.parents[1]


@cache
def cache_folder(source: Path) -> Path:
    """Return the folder of a module's compiled code.

    The processor enters its name: unlike machines may share a home folder.
    """
    features = llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(
        f"{numba.__version__} {llvmlite.binding.get_host_cpu_name()} {features}".encode()
    )
    package = _package_of(source)
    for path in sorted(_modules(source)):
        # With its folder: compiled code names the modules that it was made of, and a module that
        # has moved is not found by its former name.
        digest.update(f"\0{path.relative_to(package).as_posix()}\0".encode() + _text(path))
    # A folder of ours in either case: old ones in it are removed.
    cache_home = (
        Path(config.CACHE_DIR, "flgpr")
        if config.CACHE_DIR
        else Path(AppDirs("flgpr", False).user_cache_dir)
    )
    return cache_home / f"{source.stem}-{digest.hexdigest()[:20]}"


@cache
def _use(folder: Path) -> None:
    """Set the time of a folder in use; before a new one is made, remove those long unused."""
    with contextlib.suppress(OSError):  # read only, or another process was quicker
        if folder.exists():
            os.utime(folder)
            return
        for other in folder.parent.glob("*-" + 20 * "[0-9a-f]"):
            if time.time() - other.lstat().st_mtime > _UNUSED_DAYS * 86400:
                shutil.rmtree(other, ignore_errors=True)


_UserWide: Any = getattr(caching, "UserWideCacheLocator", None) or caching._UserWideCacheLocator


class _BySource(_UserWide):  # type: ignore[misc]
    """Tells numba the folder, for this package's functions alone."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        self._py_file = py_file
        self._lineno = py_func.__code__.co_firstlineno
        self._folder = cache_folder(Path(py_file))

    def get_cache_path(self) -> str:
        """Return the folder of compiled code."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what tells compiled code of other sources apart."""
        return self._folder.name

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Return the locator of a function of this package that lies in a file, else None."""
        if not (py_func.__module__.startswith("flgpr.") and Path(py_file).exists()):
            return None
        _use(cache_folder(Path(py_file)))
        return super().from_function(py_func, py_file)


_implementation = getattr(caching, "CacheImpl", None) or caching._CacheImpl
_implementation._locator_classes = [_BySource, *_implementation._locator_classes]


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile as ``numba.njit`` does, not for calls from C; without a cache if it has no folder."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            kernel = numba.njit(no_cfunc_wrapper=True, **options)(function)
        except RuntimeError:  # neither the user's folder, nor the source's
            return numba.njit(no_cfunc_wrapper=True, **options | {"cache": False})(function)
        if file := getattr(getattr(kernel, "_cache", None), "_cache_file", None):
            # numba only numbers the files: of two processes, one could leave its code where the
            # other's index points.
            file._data_name = lambda _: (
                f"{file._index_name.removesuffix('.nbi')}.{uuid4().hex[:12]}.nbc"
            )
            kernel.compile = _once(kernel.compile, Path(file._index_path).with_suffix(".lock"))
        return kernel

    return compiled


def _once(compile_kernel: Callable[[Any], Any], path: Path) -> Callable[[Any], Any]:
    """Let one process at a time compile a kernel: those that wait find what it has left on disk."""

    def alone(signature: Any) -> Any:
        # numba's own lock first, as it is held when a kernel that is being compiled calls for
        # another one.
        with global_compiler_lock, _held(path):
            return compile_kernel(signature)

    return alone


@contextlib.contextmanager
def _held(path: Path) -> Iterator[None]:
    """Hold a file's lock, if this can be had: without it a kernel is compiled twice, no more."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            file = stack.enter_context(path.open("ab"))
            end = time.monotonic() + _PATIENCE
            while not _lock_taken(file) and time.monotonic() < end:
                time.sleep(0.02)
            # Closing is not enough: a fork of this process may have the file open as well.
            stack.callback(system.unlock, file)
        yield


def _lock_taken(file: BinaryIO) -> bool:
    """Return whether the lock of a file was free and is now held by this process."""
    try:
        system.lock(file)
    except BlockingIOError:
        return False
    return True
