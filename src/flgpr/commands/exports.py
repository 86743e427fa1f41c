"""Writers of other programs' formats, which packages offer by entry points.

An entry point of the group "flgpr.exports" is named as ``flgpr export --to`` names its format; its
object takes a :class:`Wish` and returns the path that it wrote.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from flgpr.commands.options import PathLike

GROUP = "flgpr.exports"


@dataclass(frozen=True)
class Wish:
    """What is to be exported, and how: the options of ``flgpr export``."""

    source: PathLike  #: result folder, table, run store or folder of a live run
    output: PathLike
    to: str
    anchor: PathLike | None = None
    kind: str | None = None  #: what a table holds; by default truth
    time: str | None = None  #: of the observation, ISO 8601
    detection: str | None = None  #: of a result; by default the main one
    score: PathLike | None = None  #: folder of the result's score
    columns: str | None = None  #: columns of a table that have other names
    organisation: str | None = None
    replace: bool = False  #: whether a file at the output is replaced


def export_formats() -> list[str]:
    """Return the names of all formats, sorted."""
    return sorted(entry_points(group=GROUP).names)


def write_export(wish: Wish) -> Path:
    """Write an export by the writer of its format.

    Parameters
    ----------
    wish : Wish
        What is to be written.

    Returns
    -------
    pathlib.Path
        The file or folder.

    Raises
    ------
    ValueError
        If nobody writes the format, or the writer refuses the wish.
    """
    found = [one for one in entry_points(group=GROUP) if one.name == wish.to]
    if not found:
        raise ValueError(f"to must be one of {', '.join(export_formats())}, got {wish.to!r}")
    writer: Callable[[Wish], Path] = found[0].load()
    return writer(wish)


def map_bytes(result: Path, anchor: Path | None, score: Path | None) -> bytes:
    """Return the map of a result for QGIS, a zip, for the viewer.

    Parameters
    ----------
    result : Path
        Result folder.
    anchor : Path or None
        TOML that ties the lane to the Earth.
    score : Path or None
        Folder of the result's score.

    Returns
    -------
    bytes
        Content of the zip.
    """
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{result.name}-map.zip"
        return write_export(Wish(result, target, "qgis", anchor, score=score)).read_bytes()
