"""The folder of a lane that was processed in sections.

It holds a result folder for each section, ``alarms.csv`` with all alarms ranked together,
``lane.toml``, and ``sections.json``, which lists them with their digests.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import DoorError, Folder, listed_files
from flgpr.json_text import check_format
from flgpr.model import Lane
from flgpr.results.manifest import MANIFEST, ResultError, listing, read_result_manifest, reading
from flgpr.store import json_with_digest, lane_text, write_table
from flgpr.store.files import read_with_digest, write_whole
from flgpr.store.lane_file import parse_lane
from flgpr.store.tables import parse_own_table
from flgpr.types import PathLike

FORMAT = "flgpr-sections"
VERSION = 1
SECTIONS = "sections.json"
"""File that lists the result folders of a lane that was processed in sections."""
_JOINT_FILES = ("alarms.csv", "lane.toml")


@dataclass(frozen=True)
class Sections:
    """A folder of sections whose list and manifests were checked."""

    files: Folder  #: files of all sections together
    names: tuple[str, ...]  #: the sections' folders, in their order
    identity: Mapping[str, Any]  #: run, recipe and model that they come from

    @property
    def homes(self) -> list[Path]:
        """The result folders."""
        return [self.files.path(name) for name in self.names]

    def alarms(self) -> pd.DataFrame:
        """Read the alarms of all sections, ranked together."""
        data = self.files.read("alarms.csv")
        return parse_own_table(data, "alarms", self.files.root / "alarms.csv")

    def lane(self) -> Lane:
        """Read the lane that the sections cover."""
        return parse_lane(self.files.read("lane.toml"))


def join_results(
    folder: Path, names: Sequence[str], lane: Lane, identity: Mapping[str, Any]
) -> None:
    """Write the table of all alarms, the lane and the list of the sections of a lane.

    Parameters
    ----------
    folder : Path
        Folder that holds the results of the sections.
    names : sequence of str
        Their folders, in their order.
    lane : Lane
        The lane.
    identity : mapping
        Run, recipe and model that they come from.
    """
    tables = []
    for name in names:
        # Nothing else of a result is read, which holds its run-views.
        files = listed_files(folder / name, read_result_manifest(folder / name))
        table = parse_own_table(files.read("alarms.csv"), "alarms", folder / name / "alarms.csv")
        table["alarm_id"] = [f"{name}/{alarm}" for alarm in table["alarm_id"]]
        tables.append(table)
    # Columns of tables without rows would change the types of the others.
    filled = [table for table in tables if len(table)] or tables[:1]
    alarms = pd.concat(filled, ignore_index=True)
    alarms = alarms.sort_values("confidence", ascending=False, kind="stable")
    write_table(alarms, folder / "alarms.csv")
    write_whole(folder / "lane.toml", lane_text(lane))
    write_sections(folder, names, identity)


def write_sections(folder: Path, names: Sequence[str], identity: Mapping[str, Any]) -> None:
    """Write the list of sections with their digests, after all other files.

    Parameters
    ----------
    folder : Path
        Folder that holds the sections' folders and their joint files.
    names : sequence of str
        The sections' folders, in their order.
    identity : mapping
        Run, recipe and model that they come from.
    """
    listed = listing(folder, _JOINT_FILES)
    for name in names:
        listed["files"][f"{name}/{MANIFEST}"] = _identity(folder / name)
    content = {
        "format": FORMAT,
        "version": VERSION,
        "identity": identity,
        "sections": list(names),
        **listed,
    }
    write_whole(folder / SECTIONS, json_with_digest(content))


def read_sections(folder: PathLike) -> Sections:
    """Read the list of a folder of sections.

    Raises
    ------
    ResultError
        If the list, a joint file or a section's manifest is missing or altered.
    """
    folder = Path(folder)
    with reading(folder, SECTIONS, "folder of sections"):
        content = read_with_digest(folder, SECTIONS)
        check_format(content, FORMAT, VERSION)
        digests = {name: content["files"][name] for name in _JOINT_FILES}
        files = listed_files(folder, {"files": digests, "sizes": content.get("sizes", {})})
        sections = Sections(files, tuple(content["sections"]), content["identity"])
        for name in _JOINT_FILES:
            files.check(name)
        for name, home in zip(sections.names, sections.homes, strict=True):
            differs = ResultError(f"{folder}: {name}/{MANIFEST} differs from what was written")
            try:
                identity = _identity(home)
            except DoorError:
                raise
            except (KeyError, TypeError, ValueError):
                raise differs from None
            if identity != content["files"][f"{name}/{MANIFEST}"]:
                raise differs
    return sections


def _identity(home: Path) -> str:
    """Return the identity of a result, which does not change when pages and scores are added."""
    return str(read_with_digest(home, MANIFEST)["identity"])


def sections_at(folder: PathLike) -> Sections | None:
    """Return the sections of a lane's folder; None of a result in one piece.

    Raises
    ------
    ResultError
        As of :func:`read_sections`.
    """
    return read_sections(folder) if Folder(folder).has(SECTIONS) else None


def results_at(folder: PathLike) -> list[Path]:
    """Return the result folders of a lane: the folder itself, or those of its sections in order."""
    sections = sections_at(folder)
    return [Path(folder)] if sections is None else sections.homes


def section_names(count: int) -> list[str]:
    """Return the names of the folders of a lane's sections, which sort as they are numbered."""
    width = max(2, len(str(count)))
    return [f"section-{number:0{width}d}" for number in range(1, count + 1)]
