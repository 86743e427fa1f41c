"""The results of a survey: many lanes, each read when it is asked for."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, overload

from flgpr.door import Folder
from flgpr.results.result import Result, read_lane_result

SURVEY = "survey.json"
"""Name of the list of the lanes of a survey."""
_COLUMNS = ("lane", "scans", "area_m2", "alarms", "sections")


class Survey(Sequence[Result]):
    """The results of several lanes, in the order of their runs.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the survey, with ``survey.json``.
    folders : sequence of pathlib.Path
        Result folders of the lanes, or folders of their sections.
    """

    def __init__(self, folder: Path, folders: Sequence[Path]) -> None:
        self.folder = folder
        self.folders = list(folders)

    def __len__(self) -> int:
        return len(self.folders)

    @overload
    def __getitem__(self, number: int) -> Result: ...
    @overload
    def __getitem__(self, number: slice) -> list[Result]: ...
    def __getitem__(self, number: int | slice) -> Result | list[Result]:
        if isinstance(number, slice):
            return [read_lane_result(folder) for folder in self.folders[number]]
        return read_lane_result(self.folders[number])

    def __iter__(self) -> Iterator[Result]:
        return (read_lane_result(folder) for folder in self.folders)

    def lanes(self) -> list[dict[str, Any]]:
        """Return a row for each lane: run, counts of scans and alarms, searched area (m²)."""
        return list(Folder(self.folder).json(SURVEY))

    def __repr__(self) -> str:
        return f"survey of {len(self)} lanes in {self.folder}"

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in _COLUMNS)
        rows = []
        for lane in self.lanes():
            cells = "".join(f"<td>{html.escape(str(lane[name]))}</td>" for name in _COLUMNS)
            rows.append(f"<tr>{cells}</tr>")
        return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
