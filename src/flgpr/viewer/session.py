"""The viewer's sources: results, runs and live folders, read piece by piece.

All that is read of a result is checked against its digests.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.door import MOST_JSON, DoorError, Folder, listed_files, read_named
from flgpr.formats.reader import is_recording, recording_reader
from flgpr.json_text import parse_json
from flgpr.model.vehicle import Vehicle
from flgpr.store import (
    MOST_VERDICT_BYTES,
    check_verdicts,
    open_run,
    parse_verdicts,
    sha256,
    verdict_bytes,
    write_whole,
)
from flgpr.store.files import read_with_digest, taken_for
from flgpr.store.view_format import (
    VIEW_FORMAT,
    VIEW_SCORE,
    VIEW_VERSION,
    check_view_index,
    view_score_body,
)
from flgpr.types import Entries, PathLike, floats
from flgpr.viewer.scores import NO_IMAGES, IndexOnly, ScoreFiles, score_file

LIVE_FILE = "live.jsonl"
_MANIFEST = "manifest.json"
_LIVE_BYTES = 2**22
_MOST_LIVE = 2**40


class ViewError(ValueError):
    """What should be shown is missing, altered or of another version."""


class ResultFiles:
    """The viewer's files of a result folder; only the index stays in memory.

    Parameters
    ----------
    folder : path
        Result folder.
    score : path, optional
        Folder of its score, if that is not in the result.

    Raises
    ------
    ViewError
        If the folder is no result or its view is of another version.
    """

    def __init__(self, folder: PathLike, score: PathLike | None = None) -> None:
        self.folder = Path(folder).resolve()
        self.identity, self._files = _listed_by_manifest(self.folder)
        with _as_view_error():
            index = self._files.json("view/index.json")
        try:
            self.index = check_view_index(index)
        except ValueError as error:
            raise ViewError(f"{folder}: view/index.json cannot be shown: {error}") from None
        score_folder = None if score is None else Path(score).resolve()
        # None means the result itself.
        self._other_score = None if score_folder == self.folder else score_folder

    @property
    def title(self) -> str:
        """Name of the folder and of the run."""
        return f"{self.folder.name} ({self.index['title']})"

    def index_bytes(self) -> bytes:
        """Read the index as it was written."""
        with _as_view_error():
            return self._files.read("view/index.json", MOST_JSON)

    def score_bytes(self) -> bytes | None:
        """Return the score as JSON; None where the result was not scored.

        Raises
        ------
        ViewError
            If the score is altered or belongs to another result.
        """
        # The manifest is read again, for the result may have been scored meanwhile.
        other = self._other_score
        files = _listed_by_manifest(self.folder)[1] if other is None else Folder(other)
        if not files.has(VIEW_SCORE):
            return None
        with _as_view_error():
            files.refuse_unlisted(VIEW_SCORE)
            data = files.read(VIEW_SCORE, MOST_JSON)
        try:
            return view_score_body(data, self.identity)
        except ValueError as error:
            raise ViewError(f"{VIEW_SCORE} {error}; run `flgpr.score` again") from None

    def tile(self, layer: int, level: int, tile: int) -> bytes | None:
        """Return a tile, ``tile_rows`` rows of a layer; None if there is no such tile.

        It holds little-endian half floats, dB.
        """
        layers = self.index["layers"]
        if not 0 <= layer < len(layers):
            return None
        if not 0 <= level < len(layers[layer]["levels"]):
            return None
        entry = layers[layer]["levels"][level]
        first = tile * self.index["tile_rows"]
        if not 0 <= first < entry["rows"]:
            return None
        row_bytes = 2 * self.index["grid"]["nx"]
        rows = min(self.index["tile_rows"], entry["rows"] - first)
        return self._read_slice(entry["file"], first * row_bytes, rows * row_bytes)

    def evidence(self, detection: int, alarm: int) -> bytes | None:
        """Return what explains an alarm of a detection; None if nothing is stored.

        It holds little-endian half floats, dB.
        """
        detections = self.index["detections"]
        if not 0 <= detection < len(detections) or "evidence" not in detections[detection]:
            return None
        entry = detections[detection]["evidence"]
        if not 0 <= alarm < len(entry["start"]) - 1:
            return None
        first, end = entry["start"][alarm : alarm + 2]
        return self._read_slice(entry["file"], 2 * first, 2 * (end - first))

    def _read_slice(self, name: str, offset: int, length: int) -> bytes:
        """Return bytes of a file of the view, checked even if it changed since it was opened."""
        with _as_view_error():
            return self._files.read_part(f"view/{name}", offset, length)


def _listed_by_manifest(folder: Path) -> tuple[str, Folder]:
    """Return the identity of a result, and its files as its manifest lists them now."""
    try:
        manifest = read_with_digest(folder, _MANIFEST)
        return manifest["identity"], listed_files(folder, manifest)
    except FileNotFoundError:
        reason = "is missing"
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"cannot be read: {error}"
    raise ViewError(f"{folder}: not a result folder ({_MANIFEST} {reason})")


@contextmanager
def _as_view_error() -> Iterator[None]:
    """Turn errors of reading a file into a ViewError."""
    try:
        yield
    except FileNotFoundError as error:
        raise ViewError(f"{error.filename} is missing") from None
    except (OSError, ValueError) as error:
        raise ViewError(str(error)) from None


class RunFiles(IndexOnly):
    """A run without a result, or a recording: the track, and what was assumed on reading."""

    def __init__(self, path: PathLike) -> None:
        self.folder = Path(path).resolve()
        is_traces = self.folder.is_file()
        run = recording_reader(path).preview(self.folder) if is_traces else open_run(path)
        pose = floats(run["pose"].values)
        valid = np.asarray(run["valid"].values).reshape(len(pose), -1)
        scans: dict[str, list[Any]] = {}
        for i, name in enumerate(("x", "y", "z", "heading")):
            scans[name] = np.round(pose[:, i], 4).tolist()
        scans["masked"] = np.flatnonzero(~valid.all(axis=1)).tolist()
        low = pose[:, :2].min(axis=0) - 5
        high = pose[:, :2].max(axis=0) + 5
        frequency = run["frequency"].values
        self.title = f"{self.folder.name} ({'recording' if is_traces else 'run'})"
        self.index = {
            "format": VIEW_FORMAT,
            "version": VIEW_VERSION,
            "title": str(run.attrs.get("title", self.folder.stem)),
            "lane": {"x_min": low[0], "x_max": high[0], "y_min": low[1], "y_max": high[1]},
            **NO_IMAGES,
            "unit": "dB",
            "scans": scans,
            "georeference": run.attrs.get("georeference"),
            "detections": [],
            "run": {
                "polarizations": [str(label) for label in run["polarization"].values],
                "pairs": int(run.sizes["pair"]),
                "tones": len(frequency),
                "frequency_hz": [float(frequency[0]), float(frequency[-1])],
                "recording": is_traces,
                "notes": [str(note) for note in run.attrs.get("import_notes", [])],
            },
        }


class VerdictFile:
    """An analyst's verdicts: a file outside of the results that is only ever replaced completely.

    Parameters
    ----------
    path : path
        The file, which may not exist yet.
    sources : sequence of ViewSource
        What is shown; one must be a result.
    live_folders : sequence of Path
        Folders of live runs.

    Raises
    ------
    ViewError
        If there is no result, or the file lies in one or in no folder that exists.
    """

    def __init__(
        self, path: PathLike, sources: Sequence[ViewSource], live_folders: Sequence[Path] = ()
    ) -> None:
        self.path = Path(path).resolve()
        self._writing = threading.Lock()
        if not any(isinstance(source, ResultFiles) for source in sources):
            raise ViewError("verdicts need a result to judge, got none")
        shown = [source.folder for source in sources]
        if any(self.path.is_relative_to(folder) for folder in [*shown, *live_folders]):
            raise ViewError(f"verdicts must lie outside of the result, got {path}")
        if not self.path.parent.is_dir():
            raise ViewError(f"verdicts must lie in a folder that exists, got {path}")
        self.read()

    def read(self) -> Entries:
        """Return the notes, none where there is no file yet, and the digest of the file."""
        try:
            data = read_named(self.path, MOST_VERDICT_BYTES)
        except FileNotFoundError:
            return {"sha256": "", "notes": []}
        return {"sha256": sha256(data), "notes": parse_verdicts(data, self.path)}

    def write(self, body: bytes) -> Entries:
        """Replace the file by the notes of a page, and return its new digest.

        Raises
        ------
        ValueError
            If the notes are not valid or the file changed since the page read it.
        """
        content = parse_json(body)
        data = verdict_bytes(check_verdicts(content))
        if len(data) > MOST_VERDICT_BYTES:
            raise ValueError(
                f"verdicts must take at most {MOST_VERDICT_BYTES >> 20} MiB, got {len(data) >> 20}"
            )
        with self._writing:
            if content.get("before") != self.read()["sha256"]:
                raise ValueError(
                    f"{self.path.name} was changed by somebody else: "
                    "export yours, and load the page again"
                )
            write_whole(self.path, data)
        return {"sha256": sha256(data)}


class LiveFile:
    """Events of a live run: one JSON object per line in a ``*.jsonl``, only ever appended to.

    The file may appear later.
    """

    def __init__(self, path: PathLike) -> None:
        path = Path(path).resolve()
        if path.suffix == ".jsonl":
            self.folder = path.parent
            self._name = path.name
        else:
            self.folder = path
            self._name = LIVE_FILE

    def after(self, offset: int) -> Entries:
        """Return the events that came since a byte offset.

        Parameters
        ----------
        offset : int
            ``next`` of the last answer, 0 at first.

        Returns
        -------
        dict
            ``events``; ``next``, where they end; ``bad``, the number of lines that are no JSON
            object; ``restarted``, whether the file was begun anew; ``more``, whether there is more;
            ``age``, the time since detection last touched the file, s, None without a file; and
            ``now``, the time, s since 1970.
        """
        try:
            with Folder(self.folder).open(self._name, _MOST_LIVE) as file:
                status = os.fstat(file.fileno())
                age = max(time.time() - status.st_mtime, 0.0)
                restarted = offset > status.st_size
                start = 0 if restarted else offset
                file.seek(start)
                data = file.read(_LIVE_BYTES)
        except (OSError, DoorError):
            return {
                "events": [],
                "next": 0,
                "bad": 0,
                "restarted": offset > 0,
                "more": False,
                "age": None,
            }
        complete = data[: data.rfind(b"\n") + 1]
        if not complete and len(data) == _LIVE_BYTES:
            complete = data  # a line that is too long is passed over
        events = []
        bad = 0
        for line in complete.splitlines():
            try:
                event = parse_json(line, lambda _: None)
            except ValueError:
                event = None
            if isinstance(event, dict):
                events.append(_with_whole_vehicle(event))
            else:
                bad += bool(line.strip())
        return {
            "events": events,
            "next": start + len(complete),
            "bad": bad,
            "restarted": restarted,
            "more": len(data) == _LIVE_BYTES,
            "age": round(age, 3),
            "now": round(time.time(), 3),
        }


def _with_whole_vehicle(event: Entries) -> Entries:
    """Return an event; that of the start of an older run has the defaults of what it does not say.

    Runs of before 2026-11-28 state fewer numbers of their vehicle, and the page has none of its own.
    """
    if event.get("event") != "start" or not isinstance(event.get("vehicle", {}), dict):
        return event
    defaults = Vehicle().model_dump(exclude={"threshold"})
    return {**event, "vehicle": {**defaults, **event.get("vehicle", {})}}


ViewSource = ResultFiles | RunFiles | ScoreFiles


def open_sources(paths: Sequence[PathLike], score: PathLike | None = None) -> list[ViewSource]:
    """Open what is shown together.

    Together with the score of an alarm list, results are shown by their scores only.

    Parameters
    ----------
    paths : sequence of path
        Results, runs, recordings or scores.
    score : path, optional
        Folder of the first one's score if that is not in it.

    Returns
    -------
    list of ViewSource
        What is shown, in the order of the paths.

    Raises
    ------
    ViewError
        If a path is none of these, or a result that must be scored is not.
    """
    sources: list[ViewSource] = []
    for i, path in enumerate(paths):
        sources.append(open_source(path, score if i == 0 else None))
    if not any(isinstance(source, ScoreFiles) for source in sources):
        return sources
    return [_score_of(source) for source in sources]


def _score_of(source: ViewSource) -> ScoreFiles:
    """Return a source's score."""
    if isinstance(source, ScoreFiles):
        return source
    path = score_file(source.folder)
    if path is None:
        raise ViewError(
            f"{source.folder}: shown together with a score it must be scored, too: "
            "`flgpr.score` does it"
        )
    return ScoreFiles(path)


def open_source(path: PathLike, score: PathLike | None = None) -> ViewSource:
    """Open a result folder (or its alarms.csv), a run store, a recording or a score (or its JSON).

    Parameters
    ----------
    path : path
        What is opened.
    score : path, optional
        Folder of a result's score if that is not in the result.

    Returns
    -------
    ViewSource
        What is shown.

    Raises
    ------
    FileNotFoundError
        If there is nothing at the path.
    ViewError
        If the path is none of these.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"nothing to view at {path}")
    if path.name == "alarms.csv":
        path = path.parent
    if is_recording(path):
        return RunFiles(path)
    folder = Folder(path)
    if folder.has(_MANIFEST):
        return ResultFiles(path, score)
    if folder.has("commit.json"):
        return RunFiles(path)
    scored = score_file(path)
    if scored is not None:
        return ScoreFiles(scored)
    if folder.has("sections.json"):
        sections = [entry.name for entry in path.glob("section-*") if entry.is_dir()]
        names = ", ".join(sorted(sections))
        raise ViewError(
            f"path must be one of the sections of this lane ({names}), "
            f"got the folder of all, {path}"
        )
    wanted = "path must be a result folder, a run, a recording or a score"
    raise ViewError(f"{wanted}, got {path}{taken_for(path)}")
