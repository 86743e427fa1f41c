"""What is packaged to be looked at: full-wave lanes, and a simulated drive."""

from __future__ import annotations

from pathlib import Path

_SAMPLES = Path(__file__).parent / "samples"
SAMPLE_LANES = ("lane-a", *(f"full-wave-2-{number}" for number in range(1, 7)))
"""Names of the packaged full-wave lanes."""


def sample_lane(name: str = "lane-a") -> Path:
    """Return the folder of a packaged full-wave lane, whose fields no code of this project made.

    Parameters
    ----------
    name : str
        One of ``SAMPLE_LANES``: "lane-a", or "full-wave-2-1" to "full-wave-2-6".

    Returns
    -------
    Path
        Folder with ``run.zarr``, ``truth.csv``, ``objects.csv`` (rocks, stones and posts) and a
        README.

    Raises
    ------
    ValueError
        If no lane of that name is packaged.
    """
    if name not in SAMPLE_LANES:
        raise ValueError(f"name must be one of {', '.join(SAMPLE_LANES)}, got {name!r}")
    return _SAMPLES / name


def sample_drive() -> Path:
    """Return the folder of the packaged simulated drive.

    Returns
    -------
    Path
        Folder with the events of live detection (``drive.jsonl.gz``), ``truth.csv``, and the scene,
        the sensor and the recipe that they were made of.
    """
    return _SAMPLES / "drive"
