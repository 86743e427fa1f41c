"""The sources under test: the instrument, and the packages beside it that enter by entry points."""

from pathlib import Path

import flgpr

ROOT = Path(flgpr.__file__).parent
BESIDE = sorted(path for path in ROOT.parent.glob("flgpr_*") if path.is_dir())
"""Folders of the packages beside the instrument."""


def modules_of(*folders, stubs=False):
    """Return the modules below folders, and their stubs if these are asked for."""
    patterns = ("*.py", "*.pyi") if stubs else ("*.py",)
    return sorted(
        path for folder in folders for pattern in patterns for path in folder.rglob(pattern)
    )


def place(path):
    """Return where a module lies: below the instrument, or with the package beside it."""
    return path.relative_to(ROOT if path.is_relative_to(ROOT) else ROOT.parent).as_posix()
