"""Recordings of a vehicle that are played as live scans."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from flgpr.commands.positions import PathLike, read_optional_anchor
from flgpr.formats.mapped import import_mapped
from flgpr.store.notes import log_note


def read_recorded(path: PathLike, anchor: PathLike | None = None) -> xr.Dataset:
    """Read the run of a recording that is named in place of a folder of scans.

    Parameters
    ----------
    path : path
        MCAP file with its mapping beside it, ``NAME.toml`` for ``NAME.mcap``; or the mapping of
        any recording.
    anchor : path, optional
        TOML that ties the lane to the Earth, for recordings with longitude and latitude.

    Returns
    -------
    Dataset
        The run.

    Raises
    ------
    ValueError
        If the file is neither, there is no mapping, or the recording does not fit it.
    """
    file = Path(path)
    lane_anchor = read_optional_anchor(anchor)
    if file.suffix == ".toml":
        imported = import_mapped(file, anchor=lane_anchor)
    elif file.suffix == ".mcap":
        mapping = file.with_suffix(".toml")
        if not mapping.is_file():
            raise ValueError(
                f"{file}: a recording is read by a mapping, {mapping}, which does not exist: "
                f"flgpr info {file} drafts one"
            )
        imported = import_mapped(mapping, file, anchor=lane_anchor)
    else:
        raise ValueError(
            "incoming must be a folder that a radar writes into, a recording (.mcap) or a mapping "
            f"of one (.toml), got {file}"
        )
    for note in imported.notes:
        log_note(note)
    return imported.run
