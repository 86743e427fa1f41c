"""The folder of a lane that was taken in sections: a result folder each, and what all of them are together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import DoorError, Folder
from flgpr.model import Lane
from flgpr.results.errors import ResultError
from flgpr.store import seal, sha256
from flgpr.store.files import listed_files, read_sealed, write_whole
from flgpr.store.tables import parse_lane, parse_own_table

FORMAT = "flgpr-sections"
VERSION = 1
SECTIONS = "sections.json"
"""What lists the result folders of a lane that was taken in sections."""
_OWN = ("alarms.csv", "lane.toml")
_MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Sections:
    """A folder of sections, of which the list and every section's manifest were checked."""

    files: Folder  #: what lies beside the sections
    names: tuple[str, ...]  #: the sections' folders, in their order
    identity: Mapping[str, Any]  #: what they were made of

    @property
    def homes(self) -> list[Path]:
        """The result folders."""
        return [self.files.path(name) for name in self.names]

    def alarms(self) -> pd.DataFrame:
        """Read all alarms, ranked together."""
        return parse_own_table(
            self.files.read("alarms.csv"), "alarms", self.files.root / "alarms.csv"
        )

    def lane(self) -> Lane:
        """Read the whole lane."""
        return parse_lane(self.files.read("lane.toml"))


def write_sections(folder: Path, names: Sequence[str], identity: Mapping[str, Any]) -> None:
    """List the sections of a folder with their digests, when all else is written."""
    own = {name: Folder(folder).read(name) for name in _OWN}
    digests = {name: sha256(data) for name, data in own.items()}
    manifests = {f"{name}/{_MANIFEST}": _identity(folder / name) for name in names}
    content = {
        "format": FORMAT,
        "version": VERSION,
        "identity": identity,
        "sections": list(names),
        "files": digests | manifests,
        "sizes": {name: len(data) for name, data in own.items()},
    }
    write_whole(folder / SECTIONS, seal(content))


def read_sections(folder: str | Path) -> Sections:
    """Read the list of a folder of sections; one that is missing, altered or not true is a ResultError."""
    folder = Path(folder)
    try:
        content = read_sealed(folder, SECTIONS)
        if content["format"] != FORMAT or content["version"] != VERSION:
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        own = {name: content["files"][name] for name in _OWN}
        files = listed_files(folder, {"files": own, "sizes": content.get("sizes", {})})
        sections = Sections(files, tuple(content["sections"]), content["identity"])
        for name in _OWN:
            files.check(name)
        for name, home in zip(sections.names, sections.homes, strict=True):
            _check_section(folder, home, name, content["files"][f"{name}/{_MANIFEST}"])
    except OSError as error:
        raise ResultError(
            f"{folder}: not a whole folder of sections: {error.filename} is missing"
        ) from None
    except DoorError as error:
        raise ResultError(str(error)) from None
    except ResultError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ResultError(f"{folder}: {SECTIONS} is altered: {error}") from None
    return sections


def _check_section(folder: Path, home: Path, name: str, identity: str) -> None:
    try:
        actual = _identity(home)
    except DoorError:
        raise
    except (KeyError, TypeError, ValueError):
        actual = ""
    if actual != identity:
        raise ResultError(f"{folder}: {name}/{_MANIFEST} differs from what was written")


def _identity(home: Path) -> str:
    """Identity of a result, which stays when pages and scores are added to it."""
    return str(read_sealed(home, _MANIFEST)["identity"])
