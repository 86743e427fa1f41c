"""Opens run stores by ``xarray.open_dataset(path, engine="flgpr")``, checked as by ``open_run``.

Plain ``xarray.open_zarr`` opens them, too, and checks nothing: of a damaged store it returns fill
values without a word.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr
from xarray.backends import BackendEntrypoint

from flgpr.store.run_store import open_run, read_manifest
from flgpr.store.store_layout import MAX_MEMORY


class RunStoreBackend(BackendEntrypoint):
    """Engine ``flgpr`` of xarray: run stores, their scans read when they are asked for."""

    description = "Run stores of flgpr: raw stepped-frequency radar data, every chunk verified"
    open_dataset_parameters = ("filename_or_obj", "drop_variables", "max_memory")

    def open_dataset(  # type: ignore[override]
        self,
        filename_or_obj: str | os.PathLike[str],
        *,
        drop_variables: str | Iterable[str] | None = None,
        max_memory: int = MAX_MEMORY,
    ) -> xr.Dataset:
        """Open a run store as a dataset whose variables have units and names.

        Parameters
        ----------
        filename_or_obj : path
            Folder of the store.
        drop_variables : str or iterable of str, optional
            Variables that are left out.
        max_memory : int
            Memory that the run's small arrays and a few of its scans may take, bytes.

        Returns
        -------
        Dataset
            The run, see :func:`flgpr.model.make_run`.

        Raises
        ------
        FileNotFoundError
            If there is no folder.
        RunStoreError
            If the store was not committed, is damaged, leads out of its folder or breaks a rule.
        """
        run = open_run(Path(filename_or_obj), max_memory)
        if drop_variables is None:
            return run
        dropped = [drop_variables] if isinstance(drop_variables, str) else list(drop_variables)
        return run.drop_vars(dropped, errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Return whether a path holds a committed run store."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        root = Path(filename_or_obj)
        try:
            read_manifest(root)
        except (OSError, ValueError):
            return False
        return True
