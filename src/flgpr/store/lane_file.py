"""The TOML file of a lane, and where it lies beside a run."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from flgpr.door import read_named
from flgpr.model import Lane, as_lane
from flgpr.model.faults import faults_of
from flgpr.store.files import existing
from flgpr.toml_text import parse_toml


def read_lane(path: str | Path) -> Lane:
    """Read a lane from TOML with x_min, x_max, y_min and y_max, m.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Lane
        The lane.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ValueError
        If it is no such TOML; the error names the file.
    """
    path = existing(path, "lane file")
    with faults_of(path):
        return parse_lane(read_named(path))


def parse_lane(data: bytes) -> Lane:
    """Read a lane as :func:`read_lane` does from the bytes of a file."""
    return as_lane(parse_toml(data))


def lane_file_of(run: str | Path) -> Path:
    """Return where the lane of a run store lies that has one beside it: ``NAME-lane.toml``."""
    store = Path(run)
    return store.with_name(f"{store.stem}-lane.toml")


def lane_text(lane: Lane) -> str:
    """Return a lane as TOML, which :func:`read_lane` reads.

    Parameters
    ----------
    lane : Lane
        The lane.

    Returns
    -------
    str
        A line for each limit, m.
    """
    return "".join(f"{name} = {border!r}\n" for name, border in asdict(lane).items())
