"""What is packaged to be looked at: a full-wave lane, and a simulated drive."""

from __future__ import annotations

from pathlib import Path

_SAMPLES = Path(__file__).parent / "samples"


def sample_lane() -> Path:
    """Return the folder of the packaged full-wave lane, which no code of this project made.

    Returns
    -------
    Path
        Folder with ``run.zarr``, ``truth.csv``, ``objects.csv`` (a rock and a post) and a README.
    """
    return _SAMPLES / "lane-a"


def sample_drive() -> Path:
    """Return the folder of the packaged simulated drive.

    Returns
    -------
    Path
        Folder with the events of live detection (``drive.jsonl.gz``), ``truth.csv``, and the scene,
        the sensor and the recipe that they were made of.
    """
    return _SAMPLES / "drive"
