"""The packaged lane: full-wave data that no code of this project made."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent / "samples" / "lane-a"


def sample_lane() -> Path:
    """Folder of the packaged full-wave lane: ``run.zarr``, ``truth.csv``, ``objects.csv`` (rock, post), README."""
    return _FOLDER
