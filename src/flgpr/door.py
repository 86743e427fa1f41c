"""The one door to files that somebody else made: regular, inside their folder, listed, of the size and digest listed.

A result, store, model, score or work folder may come from an enemy. Nothing of it is opened but
through here:

- no symbolic link below the folder is followed, and no pipe, socket or device is opened: opening
  never waits;
- a name that the folder's list (its manifest) does not have is not read;
- the size is checked on the open file before anything is read, against the list and against a
  limit;
- what is given back are the very bytes whose digest was checked: no file is opened a second time to
  be parsed.

Files that users name on the command line may be links, see :func:`read_named`.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

MOST_BYTES = 256 * 2**20
"""Largest file that is read as a whole."""
MOST_CHECKED = 4 * 2**30
"""Largest file of which the digest is taken."""
MOST_JSON = 64 * 2**20
"""Largest file of JSON that is parsed."""
MOST_VALUES = 8_000_000
"""Most values in a file of JSON: each takes up to 100 bytes of memory."""
MOST_NESTING = 100
"""Deepest nesting of JSON; Python itself gives up at about ten times that."""
_MOST_EXPANSION = 200
_SMALL = 64 * 2**20
"""What decodes into more than the second number of bytes may take this many times its room in the file, not more."""
MOST_TOML = 16 * 2**20
"""Longest file of TOML that is parsed, characters."""
_TOML_TEXT = re.compile(
    r"""
    "{3}(?:[^"\\]|\\.|"(?!""))*+(?:"{3})?  # where the end is missing it takes all that is left,
    | '{3}(?:[^']|'(?!''))*+(?:'{3})?      # so that no place is looked at twice
    | "(?:[^"\\\n]|\\[^\n])*+"?
    | '[^'\n]*+'?
    | \#[^\n]*+
    """,
    re.VERBOSE | re.DOTALL,
)
"""Strings and comments of TOML."""
_TOML_MARKS = re.compile(r"[=,{}\[\]\n]")
"""What a key of TOML does not have outside its strings."""
_BLOCK = 2**15
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY
_FOLDER = os.O_RDONLY | os.O_DIRECTORY
_KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class DoorError(ValueError):
    """A file is not what its folder may hold."""


@dataclass(frozen=True)
class Listed:
    """What a list says of a file: digests of which it must have one, and sizes likewise, where it tells any."""

    digests: tuple[str, ...]  #: SHA-256, hexadecimal
    sizes: tuple[int, ...] = ()  #: bytes
    optional: bool = False  #: whether it may be absent, as while it is being written


class Folder:
    """A folder of files, read by their names with forward slashes.

    ``listed`` tells which files there are; a name that it does not have is a DoorError. None is for folders whose
    files prove themselves. The folder itself may be a symbolic link, for users name it; nothing below may.
    """

    def __init__(self, root: str | Path, listed: Mapping[str, Listed] | None = None) -> None:
        self.root = Path(root)
        self.listed = listed
        self.proven: set[str] = (
            set()
        )  #: names of listed files whose digest was right when they were read
        self._blocks: dict[str, list[bytes]] = {}

    @contextmanager
    def open(self, name: str, most: int = MOST_BYTES) -> Iterator[BufferedReader]:
        """Open a regular file of at most ``most`` bytes, and of a listed size, but with its digest unchecked.

        A file that is not there is a FileNotFoundError, anything else against a rule a DoorError.
        """
        with os.fdopen(self._handle(name, most), "rb") as file:
            yield file

    def read(self, name: str, most: int = MOST_BYTES) -> bytes:
        """Read a file as a whole and check its digest, if it is listed."""
        with os.fdopen(self._handle(name, most), "rb", buffering=0) as file:
            data = _read_all(file, f"{self.root}: {name}")
        self._compare(name, hashlib.sha256(data).hexdigest() if self.listed is not None else "")
        return data

    def read_if_listed(self, name: str, most: int = MOST_BYTES) -> bytes | None:
        """Read a file that may be absent; None if it is, a DoorError if it is there and not listed.

        A file that the list does not have is not believed. It is refused rather than passed over, because whoever put
        it there wants it to be read.
        """
        if self.listed is not None and name not in self.listed:
            self.refuse_unlisted(name)
            return None
        try:
            return self.read(name, most)
        except FileNotFoundError:
            if self.listed is None or self.listed[name].optional:
                return None
            raise

    def refuse_unlisted(self, name: str) -> None:
        """Raise a DoorError if a file is there that the list does not have."""
        if (
            self.listed is not None
            and name not in self.listed
            and os.path.lexists(self.root / name)
        ):
            raise DoorError(
                f"{self.root}: {name} is not among the files that were written: take it away"
            )

    def check(self, name: str) -> None:
        """Check a file's size and digest without keeping it in memory; an optional one may be absent."""
        try:
            with self.open(name, MOST_CHECKED) as file:
                self._compare(name, hashlib.file_digest(file, "sha256").hexdigest())
        except FileNotFoundError:
            entry = self._entry(name)
            if entry is None or not entry.optional:
                raise

    def check_size(self, name: str) -> None:
        """Check that a file is there, regular and of the size listed, without reading it."""
        folders, last = _parts(self.root, name)
        at = _open_folders(self.root, name, folders)
        try:
            self._check_state(name, _regular_state(at, last, self.root, name), MOST_CHECKED)
        finally:
            os.close(at)

    def read_part(self, name: str, offset: int, length: int) -> bytes:
        """Read part of a listed file: what is given back is proven, however the file changes between two calls.

        The first call takes the digest of the whole file and, in the same pass, of each of its blocks; later ones
        read the blocks that they need and compare these. Time stamps play no part: they can be set to anything.
        """
        if min(offset, length) < 0 or length > MOST_BYTES:
            raise DoorError(
                f"{self.root}: part of {name} must be within a file, got {length} bytes at {offset}"
            )
        with self.open(name, MOST_CHECKED) as file:
            if name not in self._blocks:
                self._blocks[name] = self._prove_blocks(name, file)
            proven = self._blocks[name]
            first = offset // _BLOCK
            stop = min(-(-(offset + length) // _BLOCK), len(proven))
            file.seek(first * _BLOCK)
            blocks = [file.read(_BLOCK) for _ in range(first, stop)]
        if [hashlib.sha256(block).digest() for block in blocks] != proven[first:stop]:
            raise DoorError(f"{self.root}: {name} differs from what was written")
        start = offset - first * _BLOCK
        return b"".join(blocks)[start : start + length]

    def json(self, name: str, most: int = MOST_JSON) -> Any:
        """Read a file of JSON, see :func:`parse_json`."""
        data = self.read(name, most)
        try:
            return parse_json(data)
        except ValueError as error:
            raise DoorError(f"{self.root}: {name} cannot be read: {error}") from None

    def has(self, name: str) -> bool:
        """Tell whether something lies under a name, be it of the right kind or not: reading it says so."""
        _parts(self.root, name)
        return os.path.lexists(self.root / name)

    def path(self, name: str) -> Path:
        """Give the path of a folder inside; one that is a link, or lies behind one, is a DoorError."""
        folders, last = _parts(self.root, name)
        os.close(_open_folders(self.root, name, [*folders, last]))
        return self.root / name

    def _handle(self, name: str, most: int) -> int:
        handle = _open_inside(self.root, name)
        try:
            self._check_state(name, os.fstat(handle), most)
        except DoorError:
            os.close(handle)
            raise
        return handle

    def _check_state(self, name: str, state: os.stat_result, most: int) -> None:
        entry = self._entry(name)
        size = state.st_size
        if entry is not None and entry.sizes and size not in entry.sizes:
            wanted = " or ".join(map(str, entry.sizes))
            raise DoorError(
                f"{self.root}: {name} differs from what was written ({size} bytes against {wanted})"
            )
        if size > most:
            raise DoorError(
                f"{self.root}: {name} must hold at most {most / 2**20:g} MiB, got {size / 2**20:.4g}"
            )

    def _entry(self, name: str) -> Listed | None:
        if self.listed is None:
            return None
        if name not in self.listed:
            raise DoorError(f"{self.root}: {name} is not among the files that were written")
        return self.listed[name]

    def _compare(self, name: str, digest: str) -> None:
        entry = self._entry(name)
        if entry is not None and digest not in entry.digests:
            raise DoorError(
                f"{self.root}: {name} differs from what was written (its SHA-256 is another)"
            )
        self.proven.add(name)

    def _prove_blocks(self, name: str, file: BinaryIO) -> list[bytes]:
        whole = hashlib.sha256()
        proven = []
        while block := file.read(_BLOCK):
            whole.update(block)
            proven.append(hashlib.sha256(block).digest())
        self._compare(name, whole.hexdigest())
        return proven


def read_named(path: str | Path, most: int = MOST_BYTES) -> bytes:
    """Read a file that a user named: it may be a link, but must be regular and of at most ``most`` bytes.

    A pipe, a socket or a device is a DoorError at once; it is never waited for. No file is a FileNotFoundError.
    """
    with open_named(path, most) as file:
        return _read_all(file, str(path))


@contextmanager
def open_named(path: str | Path, most: int | None = None) -> Iterator[BufferedReader]:
    """Open a file that a user named, as :func:`read_named` reads one; None is no limit."""
    with open(path, "rb", opener=open_at_once) as file:
        size = os.fstat(file.fileno()).st_size
        if most is not None and size > most:
            raise DoorError(
                f"{path} must hold at most {most / 2**20:g} MiB, got {size / 2**20:.4g}"
            )
        yield file


def open_at_once(path: str, flags: int) -> int:
    """Open a file for ``open``, links followed; what is not regular is a DoorError, and never waited for."""
    return _opened_regular(path, flags)


def open_own(path: str, flags: int) -> int:
    """Open a file of a folder for ``open``, to be written, too; a link is a DoorError as is what is not regular."""
    try:
        return _opened_regular(path, flags | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise DoorError(f"{path} must be a regular file, got a symbolic link") from None


def _opened_regular(path: str, flags: int) -> int:
    try:
        handle = os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY, 0o666)
    except OSError as error:
        if error.errno != errno.ENXIO:  # a socket, or a pipe that nobody reads
            raise
        raise DoorError(f"{path} must be a regular file, got {_kind(os.stat(path))}") from None
    return _regular(handle, path)


def parse_json(data: bytes | str, constant: Callable[[str], Any] | None = None) -> Any:
    """Parse JSON of at most :data:`MOST_VALUES` values, nested at most :data:`MOST_NESTING` deep; else a ValueError.

    ``constant`` gives what stands for NaN and infinity, by default these numbers.
    """
    marks: tuple[Any, ...] = (",", "[", "{") if isinstance(data, str) else (b",", b"[", b"{")
    if sum(data.count(mark) for mark in marks) > MOST_VALUES:
        raise ValueError(f"it must hold at most {MOST_VALUES} values, got more")
    try:
        value = json.loads(data, parse_constant=constant)
    except RecursionError:
        raise ValueError(f"it must be nested at most {MOST_NESTING} deep, got more") from None
    level = [value]
    for _ in range(MOST_NESTING + 1):
        level = [inner for one in level for inner in _inside(one) if isinstance(inner, dict | list)]
        if not level:
            return value
    raise ValueError(f"it must be nested at most {MOST_NESTING} deep, got more")


def parse_toml(data: bytes | str) -> dict[str, Any]:
    """Parse TOML in UTF-8 of at most :data:`MOST_TOML` characters; what is not valid is a ValueError.

    So are keys of more than :data:`MOST_NESTING` parts, for which the parser takes time that grows
    with their square, and values in values so deep that it gives up.
    """
    text = data if isinstance(data, str) else data.decode("utf-8")
    if len(text) > MOST_TOML:
        raise ValueError(f"it must have at most {MOST_TOML} characters, got {len(text)}")
    without_text = _TOML_TEXT.sub("", text)
    if any(part.count(".") >= MOST_NESTING for part in _TOML_MARKS.split(without_text)):
        raise ValueError(f"its keys must have at most {MOST_NESTING} parts, got more")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _inside(value: Any) -> Any:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def check_expansion(name: str, size: int, room: int) -> None:
    """Refuse what decodes into far more than the file holds: no measurement does."""
    if size > _SMALL and size > _MOST_EXPANSION * room:
        raise ValueError(
            f"{name} takes {room} bytes of the file and would expand to {size}: no data do"
        )


def _parts(root: Path, name: str) -> tuple[list[str], str]:
    """Take a name apart into folders and what lies in the last of them; one that leads out is a DoorError."""
    parts = name.split("/")
    if "\0" in name or "\\" in name or any(part in ("", ".", "..") for part in parts):
        raise DoorError(f"{root}: names must be relative and stay inside, got {name!r}")
    return parts[:-1], parts[-1]


def _open_inside(root: Path, name: str) -> int:
    """Open a regular file below a folder, from folder to folder, so that no link is followed."""
    folders, last = _parts(root, name)
    at = _open_folders(root, name, folders)
    try:
        _regular_state(
            at, last, root, name
        )  # looked at before, for opening a device may already do something
        return _regular(os.open(last, _FILE, dir_fd=at), f"{root}: {name}")
    except FileNotFoundError as error:
        raise FileNotFoundError(error.errno, error.strerror, str(root / name)) from None
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise DoorError(f"{root}: {name} must be a regular file, got a symbolic link") from None
    finally:
        os.close(at)


def _regular_state(at: int, last: str, root: Path, name: str) -> os.stat_result:
    try:
        state = os.stat(last, dir_fd=at, follow_symlinks=False)
    except FileNotFoundError as error:
        raise FileNotFoundError(error.errno, error.strerror, str(root / name)) from None
    if not stat.S_ISREG(state.st_mode):
        raise DoorError(f"{root}: {name} must be a regular file, got {_kind(state)}")
    return state


def _open_folders(root: Path, name: str, parts: Sequence[str]) -> int:
    """Open a folder below another; a link on the way is a DoorError that names the file that was asked for."""
    try:
        at = os.open(root, _FOLDER)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise type(error)(error.errno, error.strerror, str(root / name)) from None
    for part in parts:
        try:
            below = os.open(part, _FOLDER | os.O_NOFOLLOW, dir_fd=at)
        except FileNotFoundError as error:
            raise FileNotFoundError(error.errno, error.strerror, str(root / name)) from None
        except OSError as error:
            if error.errno not in (errno.ELOOP, errno.ENOTDIR):
                raise
            kind = _kind(os.stat(part, dir_fd=at, follow_symlinks=False))
            raise DoorError(
                f"{root}: {name} must lie in folders of its own, got {kind} at {part}"
            ) from None
        finally:
            os.close(at)
        at = below
    return at


def _regular(handle: int, path: str | Path) -> int:
    state = os.fstat(handle)
    if stat.S_ISREG(state.st_mode):
        return handle
    os.close(handle)
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise DoorError(f"{path} must be a regular file, got {_kind(state)}")


def kind_of(path: str | Path) -> str:
    """Name what lies at a path, links followed: "a file", "a folder", "a pipe" and so on."""
    return _kind(os.stat(path))


def _kind(state: os.stat_result) -> str:
    return _KINDS.get(stat.S_IFMT(state.st_mode), "a file")


def _read_all(file: BinaryIO, what: str) -> bytes:
    """Read a file of which one call may give a part; one that changes its size meanwhile is a DoorError."""
    size = os.fstat(file.fileno()).st_size
    data = file.read(size + 1)
    while 0 < len(data) < size and (more := file.read(size + 1 - len(data))):
        data += more
    if len(data) != size:
        raise DoorError(f"{what} must stay as it is while it is read, got another size")
    return data
