"""The instrument without the packages beside it: they cannot be found, and they offer nothing.

``FLGPR_ALONE=1 pytest tests/recipe tests/stages`` runs tests of the instrument so. The tests of the
packages beside it are then left out, and those that :func:`needs` marks.
"""

import importlib.metadata
import os
import sys

import pytest

IS_ALONE = bool(os.environ.get("FLGPR_ALONE"))
BESIDE = {
    "flgpr_exchange": ("exchange",),
    "flgpr_ground": ("ground",),
    "flgpr_papers": ("papers",),
    "flgpr_trials": ("trials",),
}
"""Packages beside the instrument, each with the folders of its tests."""


class _Hiding:
    """A finder of modules that does not find the packages beside the instrument."""

    def __init__(self, finder):
        self._finder = finder

    def find_spec(self, name, path=None, target=None):
        """Find a module, but for those that are hidden."""
        if name.partition(".")[0] in BESIDE:
            return None
        return self._finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self._finder, name)


def hide_packages_beside():
    """Hide the packages beside the instrument from this process."""
    sys.meta_path[:] = [_Hiding(finder) for finder in sys.meta_path]
    offered = importlib.metadata.Distribution.entry_points.fget

    def entry_points(distribution):
        kept = (one for one in offered(distribution) if one.module.partition(".")[0] not in BESIDE)
        return importlib.metadata.EntryPoints(kept)

    importlib.metadata.Distribution.entry_points = property(entry_points)


def needs(package):
    """Mark a test of the instrument that takes something of a package beside it for an example."""
    return pytest.mark.skipif(IS_ALONE, reason=f"needs {package}, which lies beside the instrument")
