"""What is open in the viewer: results, runs and live folders, read piece by piece and checked against their digests."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.door import MOST_JSON, DoorError, Folder, parse_json, read_named
from flgpr.formats import is_gpr, preview_run
from flgpr.store import (
    MOST_VERDICT_BYTES,
    canonical_json,
    check_verdicts,
    open_run,
    parse_verdicts,
    sha256,
    verdict_bytes,
    write_whole,
)
from flgpr.store.files import listed_files, read_sealed
from flgpr.viewer.scores import IndexOnly, ScoreFiles, score_file

VIEW_FORMAT = "flgpr-view"
VIEW_VERSION = 1
LIVE_FILE = "live.jsonl"
_MANIFEST = "manifest.json"
_SCORE = "view/score.json"
_LIVE_BYTES = 2**22
_MOST_LIVE = 2**40


class ViewError(ValueError):
    """What should be shown is missing, altered or of another version."""


class ResultFiles:
    """The viewer's files of a result folder, or with the score of another; nothing stays in memory but the index."""

    def __init__(self, folder: str | Path, score: str | Path | None = None) -> None:
        self.folder = Path(folder).resolve()
        try:
            manifest = read_sealed(self.folder, _MANIFEST)
            self.identity: str = manifest["identity"]
            self._files = listed_files(self.folder, manifest)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            why = (
                "is missing" if isinstance(error, FileNotFoundError) else f"cannot be read: {error}"
            )
            raise ViewError(f"{folder}: not a result folder ({_MANIFEST} {why})") from None
        with _as_view_error():
            self.index: dict[str, Any] = self._files.json("view/index.json")
        if self.index.get("format") != VIEW_FORMAT or self.index.get("version") != VIEW_VERSION:
            raise ViewError(f"{folder}: view must be {VIEW_FORMAT} version {VIEW_VERSION}")
        home = None if score is None else Path(score).resolve()
        self._score_home = None if home == self.folder else home

    @property
    def title(self) -> str:
        """Name of the folder and of the run."""
        return f"{self.folder.name} ({self.index['title']})"

    def index_bytes(self) -> bytes:
        """Read the index as it was written."""
        with _as_view_error():
            return self._files.read("view/index.json", MOST_JSON)

    def score_bytes(self) -> bytes | None:
        """Read the score, JSON; None where the result was not scored, an error where it is altered or another's."""
        files = self._score_folder()
        if not files.has(_SCORE):
            return None
        with _as_view_error():
            files.refuse_unlisted(_SCORE)
            data = files.read(_SCORE, MOST_JSON)
        try:
            stored = parse_json(data)
            body = canonical_json(stored["content"])
            digest = stored.get("sha256")
            identity = stored["content"]["result_sha256"]
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ViewError(f"{_SCORE} cannot be read") from None
        if sha256(body) != digest:
            raise ViewError(f"{_SCORE} differs from what was written")
        if identity != self.identity:
            raise ViewError(f"{_SCORE} belongs to another result; run flgpr score again")
        return body

    def _score_folder(self) -> Folder:
        """Give the folder of the score; the result's own manifest is read anew, for it may have been scored since."""
        if self._score_home is not None:
            return Folder(self._score_home)
        try:
            return listed_files(self.folder, read_sealed(self.folder, _MANIFEST))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ViewError(f"{self.folder}: {_MANIFEST} cannot be read: {error}") from None

    def tile(self, layer: int, level: int, tile: int) -> bytes | None:
        """Read a tile, ``tile_rows`` rows of a layer: little-endian half floats, dB; None if there is none."""
        layers = self.index["layers"]
        if not (0 <= layer < len(layers) and 0 <= level < len(layers[layer]["levels"])):
            return None
        entry = layers[layer]["levels"][level]
        first = tile * self.index["tile_rows"]
        if not 0 <= first < entry["rows"]:
            return None
        width = 2 * self.index["grid"]["nx"]
        rows = min(self.index["tile_rows"], entry["rows"] - first)
        return self._part(entry["file"], first * width, rows * width)

    def evidence(self, detection: int, alarm: int) -> bytes | None:
        """Read what explains an alarm of a detection: little-endian half floats, dB; None if nothing is stored."""
        detections = self.index["detections"]
        if not 0 <= detection < len(detections) or "evidence" not in detections[detection]:
            return None
        entry = detections[detection]["evidence"]
        if not 0 <= alarm < len(entry["start"]) - 1:
            return None
        first, end = entry["start"][alarm : alarm + 2]
        return self._part(entry["file"], 2 * first, 2 * (end - first))

    def _part(self, name: str, offset: int, length: int) -> bytes:
        """Read part of a file of the view; what is sent is proven, whatever became of the file since it was opened."""
        with _as_view_error():
            return self._files.read_part(f"view/{name}", offset, length)


@contextmanager
def _as_view_error() -> Iterator[None]:
    """Say in a ViewError what is wrong with a file."""
    try:
        yield
    except ViewError:
        raise
    except FileNotFoundError as error:
        raise ViewError(f"{error.filename} is missing") from None
    except (OSError, ValueError) as error:
        raise ViewError(str(error)) from None


class RunFiles(IndexOnly):
    """A run without a result, or a recording: where the vehicle went, and what was assumed on reading."""

    def __init__(self, path: str | Path) -> None:
        self.folder = Path(path).resolve()
        recording = self.folder.is_file()
        run = preview_run(path) if recording else open_run(path)
        pose = np.asarray(run["pose"].values, dtype=np.float64)
        masked = np.flatnonzero(~np.asarray(run["valid"].values).reshape(len(pose), -1).all(axis=1))
        low = pose[:, :2].min(axis=0) - 5
        high = pose[:, :2].max(axis=0) + 5
        frequency = run["frequency"].values
        self.title = f"{self.folder.name} ({'recording' if recording else 'run'})"
        self.index = {
            "format": VIEW_FORMAT,
            "version": VIEW_VERSION,
            "title": str(run.attrs.get("title", self.folder.stem)),
            "lane": {"x_min": low[0], "x_max": high[0], "y_min": low[1], "y_max": high[1]},
            "grid": None,
            "tile_rows": 0,
            "unit": "dB",
            "channel": ["", ""],
            "layers": [],
            "scans": {
                name: np.round(pose[:, i], 4).tolist()
                for i, name in enumerate(("x", "y", "z", "heading"))
            }
            | {"masked": masked.tolist()},
            "georeference": run.attrs.get("georeference"),
            "detections": [],
            "run": {
                "polarizations": [str(label) for label in run["polarization"].values],
                "pairs": int(run.sizes["pair"]),
                "tones": len(frequency),
                "frequency_hz": [float(frequency[0]), float(frequency[-1])],
                "recording": recording,
                "notes": [str(note) for note in run.attrs.get("import_notes", [])],
            },
        }


class VerdictFile:
    """An analyst's verdicts, a file beside the results: read when it is there, and only ever replaced as a whole."""

    def __init__(
        self, path: str | Path, sources: Sequence[Source], more: Sequence[Path] = ()
    ) -> None:
        self.path = Path(path).resolve()
        self._writing = threading.Lock()
        if not any(isinstance(source, ResultFiles) for source in sources):
            raise ViewError("verdicts need a result to judge, got none")
        if any(
            self.path.is_relative_to(folder)
            for folder in (*(source.folder for source in sources), *more)
        ):
            raise ViewError(f"verdicts must lie beside the result, not in it, got {path}")
        if not self.path.parent.is_dir():
            raise ViewError(f"verdicts must lie in a folder that exists, got {path}")
        self.read()

    def read(self) -> dict[str, Any]:
        """Read the notes, none where there is no file yet, with the digest of what was read."""
        try:
            data = read_named(self.path, MOST_VERDICT_BYTES)
        except FileNotFoundError:
            return {"sha256": "", "notes": []}
        return {"sha256": sha256(data), "notes": parse_verdicts(data, self.path)}

    def write(self, body: bytes) -> dict[str, Any]:
        """Replace the file by the notes of a page, unless it changed since the page read it: a ValueError says so."""
        told = parse_json(body)
        data = verdict_bytes(check_verdicts(told))
        if len(data) > MOST_VERDICT_BYTES:
            raise ValueError(
                f"verdicts must take at most {MOST_VERDICT_BYTES >> 20} MiB, got {len(data) >> 20}"
            )
        with self._writing:
            if told.get("before") != self.read()["sha256"]:
                raise ValueError(
                    f"{self.path.name} was changed by somebody else: export yours, and load the page again"
                )
            write_whole(self.path, data)
        return {"sha256": sha256(data)}


class LiveFile:
    """Events of a live run: one JSON object per line in a ``*.jsonl``, there now or later, only ever appended to."""

    def __init__(self, path: str | Path) -> None:
        whole = Path(path).resolve()
        self.folder, self._name = (
            (whole.parent, whole.name) if whole.suffix == ".jsonl" else (whole, LIVE_FILE)
        )

    def after(self, offset: int) -> dict[str, Any]:
        """Read ``events`` that came since a byte offset, where the last answer's ``next`` ended.

        ``bad`` counts lines that were no JSON object; a file begun anew is ``restarted``; ``more`` tells that there is
        more; ``age``, s, since detection last touched the file, None without one; ``now`` is the time, s since 1970.
        """
        try:
            with Folder(self.folder).open(self._name, _MOST_LIVE) as file:
                state = os.fstat(file.fileno())
                size = state.st_size
                age = max(time.time() - state.st_mtime, 0.0)
                restarted = offset > size
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
        whole = data[: data.rfind(b"\n") + 1]
        if not whole and len(data) == _LIVE_BYTES:
            whole = data
        events = []
        bad = 0
        for line in whole.splitlines():
            try:
                event = parse_json(line, lambda _: None)
            except ValueError:
                event = None
            if isinstance(event, dict):
                events.append(event)
            else:
                bad += bool(line.strip())
        more = len(data) == _LIVE_BYTES
        told = {
            "events": events,
            "next": start + len(whole),
            "bad": bad,
            "restarted": restarted,
            "more": more,
        }
        return told | {"age": round(age, 3), "now": round(time.time(), 3)}


Source = ResultFiles | RunFiles | ScoreFiles


def open_sources(paths: Sequence[str | Path], score: str | Path | None = None) -> list[Source]:
    """Open what is shown together; beside the score of an alarm list a result is shown by its own score, too.

    ``score`` is the folder of the first one's score if that is not in it.
    """
    sources = [open_source(path, score if i == 0 else None) for i, path in enumerate(paths)]
    if not any(isinstance(one, ScoreFiles) for one in sources):
        return sources
    return [one if isinstance(one, ScoreFiles) else _score_of(one) for one in sources]


def _score_of(source: Source) -> ScoreFiles:
    place = score_file(source.folder)
    if place is None:
        raise ViewError(
            f"{source.folder}: beside a score it must be scored, too: flgpr score RESULT --truth TRUTH"
        )
    return ScoreFiles(place)


def open_source(path: str | Path, score: str | Path | None = None) -> Source:
    """Open a result folder (or its alarms.csv), a run store, a recording or a score (or its JSON).

    ``score`` is the folder of a result's score if that is not in the result.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"nothing to view at {path}")
    if path.name == "alarms.csv":
        path = path.parent
    if path.is_file() and is_gpr(path):
        return RunFiles(path)
    inside = Folder(path)
    if inside.has(_MANIFEST):
        return ResultFiles(path, score)
    if inside.has("commit.json"):
        return RunFiles(path)
    scored = score_file(path)
    if scored is not None:
        return ScoreFiles(scored)
    if inside.has("sections.json"):
        names = ", ".join(sorted(home.name for home in path.glob("section-*") if home.is_dir()))
        raise ViewError(
            f"path must be one of the sections of this lane ({names}), got the folder of all, {path}"
        )
    raise ViewError(f"path must be a result folder, a run, a recording or a score, got {path}")
