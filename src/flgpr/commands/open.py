"""``flgpr open``: what files hold, which questions are open, and a picture."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import OneOrMorePaths, OptionalOutput, one_or_more
from flgpr.commands.shell import Arguments, command
from flgpr.model.printable import printable

if TYPE_CHECKING:
    from flgpr.formats.draft_roles import Roles


@dataclass(frozen=True)
class Opened:
    """What files hold, and what to do next."""

    answer: str  #: one sentence
    questions: tuple[str, ...]  #: entries of the mapping that are guesses, each with its comment
    lines: tuple[str, ...]  #: what the files hold
    next: str  #: the exact next command
    mapping: Path | None = None  #: that was written
    picture: Path | None = None

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        paths = {name: getattr(self, name) for name in ("mapping", "picture")}
        return {**asdict(self), **{name: path and str(path) for name, path in paths.items()}}


def _lines(opened: Opened, _: Arguments) -> Iterator[str | Path]:
    """Yield the answer, the questions, what the files hold, what was written, and what is next."""
    yield printable(opened.answer)
    yield ""
    for number, question in enumerate(opened.questions, 1):
        yield f"  {number}. {printable(question)}"
    if opened.questions:
        yield ""
    for line in opened.lines:
        yield f"  {printable(line)}"
    for path in (opened.mapping, opened.picture):
        if path is not None:
            yield path
    yield f"next: {printable(opened.next)}"


@command(lines=_lines, as_json=True, quiet=False)
def open_files(
    paths: OneOrMorePaths,
    output: OptionalOutput = None,
) -> Opened:
    """Say what files hold, which questions are open before they can be imported, and what is next.

    A mapping is drafted and a picture drawn; without an output they lie in the folder where the
    command is given, under the name of the first file.

    Parameters
    ----------
    paths
        File of any format, or all files of one measurement.
    output
        mapping, TOML; the picture lies beside it as .png

    Returns
    -------
    Opened
        ``answer``, one sentence; ``questions``; and ``next``, the exact next command.

    Raises
    ------
    ValueError
        If a file cannot be read.
    FileExistsError
        If another file is at the output.
    """
    files = [Path(path) for path in one_or_more(paths)]
    first = files[0]
    folders = [path for path in files if path.is_dir()]
    if folders and (len(files) > 1 or output is not None):
        beside = f"{len(files) - 1} others" if len(files) > 1 else f"the output {output}"
        raise ValueError(f"a folder must be opened by itself, got {folders[0]} and {beside}")
    if folders:
        return _opened_run(first)
    again = [path for path, count in Counter(path.resolve() for path in files).items() if count > 1]
    if again:
        raise ValueError(f"paths must name every file once, got {again[0]} again")
    mapping = Path(first.with_suffix(".toml").name) if output is None else Path(output)
    if mapping.suffix != ".toml":
        raise ValueError(f"output must end in .toml, got {mapping}")
    from flgpr.commands.importing import check_parent_folder
    from flgpr.formats.reader import is_recording

    check_parent_folder(mapping)
    logs = [path for path in files if _is_log(path)]
    if len(logs) > 1 and len(files) > len(logs):
        names = ", ".join(path.name for path in logs)
        raise ValueError(f"arrays must come with one log of their track, got {names}")
    if logs and len(files) > len(logs):
        arrays = [path for path in files if path not in logs]
        return _opened_arrays(arrays, mapping, logs)
    if len(files) == 1 and is_recording(first):
        return _opened_recording(first, mapping.with_suffix(".png"))
    return _opened_arrays(files, mapping)


def _opened_run(path: Path) -> Opened:
    """Describe a folder: a run store is ready."""
    from flgpr.store import open_run

    sizes = open_run(path).sizes
    counted = ", ".join(f"{sizes[name]} {name}s" for name in ("scan", "pair"))
    answer = f"{path} is a run of {counted}: nothing is open, check it before you detect."
    return Opened(answer, (), (), _command("check", path))


def _opened_recording(path: Path, picture: Path) -> Opened:
    """Describe the recording of a commercial radar, and draw its traces."""
    from flgpr.commands.image import image
    from flgpr.formats.explain import explain_file

    described = explain_file(path)
    image(path, picture)
    *lines, last = described.lines
    before, _, following = last.partition("to import it: ")
    if before:  # it says why the recording is not imported
        answer = f"{path.name} is a {described.kind}, which can be looked at and not imported."
        return Opened(answer, (), (*lines, last), _command("view", path), picture=picture)
    questions = [line for line in lines if line.startswith("trace spacing unknown")]
    asked = "; 1 question is open" if questions else ""
    answer = f"{path.name} is a {described.kind}: it is read without a mapping{asked}."
    return Opened(answer, tuple(questions), tuple(lines), following, picture=picture)


def _opened_arrays(files: Sequence[Path], mapping: Path, logs: Sequence[Path] = ()) -> Opened:
    """Describe files of arrays, write the draft of their mapping, and draw their signal.

    With the log of a satellite receiver the draft has no poses, and the height of the receiver's
    antenna above the ground is asked for: that of the log is over the sea.
    """
    from flgpr.formats.array_file import LIMIT
    from flgpr.formats.draft_arrays import group_files
    from flgpr.formats.draft_roles import Roles
    from flgpr.formats.explain import explain_file, explain_files
    from flgpr.store.outputs import write_new

    several = len(files) > 1
    described = explain_files(files, mapping=mapping) if several else explain_file(files[0])
    if not described.mapping:
        needs = "no signal" if described.needs_mapping else "what is read without a mapping"
        answer = f"{files[0].name}, a {described.kind}, holds {needs}."
        return Opened(answer, (), tuple(described.lines), _command("info", *files))
    roles = Roles(group_files(list(files), LIMIT))
    text = described.mapping
    if not several:  # its file is named relative to the mapping
        text = explain_files(files, mapping=mapping).mapping
    following = _command("import", "mapped", mapping, "-o", mapping.with_suffix(".zarr"))
    questions = []
    if logs:
        text = re.sub(r"\n\[pose\].*?(?=\n\[|\Z)", "", text, flags=re.DOTALL)
        following += f" --track {shlex.quote(str(logs[0]))}"
        following += " --anchor-from-track --above-ground HEIGHT"
        questions = [
            f"how high is the antenna of {logs[0].name} above the ground, m? --above-ground"
        ]
    elif "geodetic" in text:
        following += " --anchor-from-track"
    questions = [*_questions(text), *questions]
    write_new(mapping, text)
    picture = _draw(roles, mapping.with_suffix(".png"))
    count = len(questions)
    asked = (
        f"{count} question{'s are' if count > 1 else ' is'} open: answer in {mapping}, then import"
    )
    held = _holdings(roles, roles.data.opened.kind if several else described.kind, logs)
    answer = f"{held}; {asked if questions else 'nothing is open: import it'}."
    return Opened(answer, tuple(questions), tuple(described.lines), following, mapping, picture)


def _holdings(roles: Roles, kind: str, logs: Sequence[Path]) -> str:
    """Return in words how many files hold the signal, and which are the track."""
    signal = roles.data.paths
    tracks = [*logs]
    if roles.places is not None and roles.places.group is not roles.data:
        tracks += roles.places.group.paths
    held = f"{len(signal)} files hold a signal"
    if len(signal) == 1:
        held = f"{signal[0].name}, a {kind}, holds a signal"
    return f"{held}, {' and '.join(path.name for path in tracks)} the track" if tracks else held


def _is_log(path: Path) -> bool:
    """Return whether a file is a log of NMEA sentences."""
    from flgpr.store.files import existing

    with existing(path).open("rb") as file:
        return file.read(7)[:3] in (b"$GP", b"$GN", b"$GL")


def _questions(mapping: str) -> Iterator[str]:
    """Yield the entries of a draft that are guesses, each with its table and comment."""
    table = ""
    for line in mapping.splitlines():
        heading = re.match(r"\[(\w+)\]", line)
        if heading:
            table = f"{heading[1]}: "
        elif '?"' in line and not line.startswith("#"):
            yield table + line


def _draw(roles: Roles, picture: Path) -> Path | None:
    """Draw the array that seems to be the signal; where it is too large, nothing."""
    from flgpr.report.images import opened_figure
    from flgpr.report.kit import figure_png
    from flgpr.store.outputs import write_new

    signal = roles.data.opened.read(roles.signal.name)
    if signal.ndim == 0 or not signal.size or signal.dtype.kind not in "fciu":
        return None
    write_new(picture, figure_png(opened_figure(signal, roles.signal.name)))
    return picture


def _command(*words: object) -> str:
    """Return a command as it is typed."""
    return shlex.join(["flgpr", *map(str, words)])
