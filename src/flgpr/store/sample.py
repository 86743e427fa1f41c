"""The packaged lane: full-wave data that no code of this project made."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent / "samples" / "lane-a"


def sample_lane() -> Path:
    """Return the folder of the packaged full-wave lane.

    Returns
    -------
    Path
        Folder with ``run.zarr``, ``truth.csv``, ``objects.csv`` (a rock and a post) and a README.
    """
    return _FOLDER
