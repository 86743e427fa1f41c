"""The only way to open files that somebody else made.

A result, store, model, score or work folder may come from an enemy. All of its files are opened
here, by these rules:

- no symbolic link below the folder is followed, and no pipe, socket or device is opened: opening
  never waits;
- a name that the folder's list (its manifest) does not have is not read;
- the size is checked on the open file before anything is read, against the list and against a
  limit;
- the bytes that are returned are those whose digest was checked: no file is opened a second time to
  be parsed.

Files that users name on the command line may be links, see :func:`read_named`.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

from flgpr import system
from flgpr.json_text import parse_json

MOST_BYTES = 256 * 2**20
"""Largest file that is read as a whole."""
MOST_CHECKED = 4 * 2**30
"""Largest file of which the digest is taken."""
MOST_JSON = 64 * 2**20
"""Largest file of JSON that is parsed."""
_MOST_EXPANSION = 200  # bytes decoded to bytes in the file
_SMALL = 64 * 2**20  # bytes decoded up to which any expansion is allowed
_BLOCK = 2**15
_FILE = os.O_RDONLY | system.NO_LINK | system.AT_ONCE | system.PLAIN
_FOLDER = os.O_RDONLY | system.DIRECTORY
_LEADS_ELSEWHERE = (0xA0000003, 0xA000000C)
"""Tags of junctions and symbolic links on Windows ([MS-FSCC] 2.1.2.1)."""
_KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


# Digest and size of a file; None for no file, and a size of None where it is not known.
Version = tuple[str | None, int | None]


class DoorError(ValueError):
    """A file breaks a rule of its folder."""


@dataclass(frozen=True)
class Listed:
    """What a list says of a file."""

    digests: tuple[str, ...]  #: SHA-256, hexadecimal, of which the file must have one
    sizes: tuple[int, ...] = ()  #: bytes, of which the file must have one; none if not known
    optional: bool = False  #: whether it may be absent, as while it is being written


class Folder:
    """A folder of files, read by their names with forward slashes.

    The folder itself may be a symbolic link, because users name it; nothing below may be one.

    Parameters
    ----------
    root : str or Path
        The folder.
    listed : mapping of str to Listed, optional
        The files that there are; another name is a DoorError. None is for folders whose files carry
        their own digests.
    """

    def __init__(self, root: str | Path, listed: Mapping[str, Listed] | None = None) -> None:
        self.root = Path(root)
        self.listed = listed
        #: names of listed files whose digest was right when they were read
        self.proven: set[str] = set()
        self._blocks: dict[str, list[bytes]] = {}

    @contextmanager
    def open(self, name: str, most: int = MOST_BYTES) -> Iterator[BufferedReader]:
        """Open a regular file without checking its digest.

        Its size must be at most ``most`` bytes, and as listed. A missing file is a
        FileNotFoundError, anything else against a rule a DoorError.
        """
        with os.fdopen(self._handle(name, most), "rb") as file:
            yield file

    def read(self, name: str, most: int = MOST_BYTES) -> bytes:
        """Read a file and check its digest, if it is listed."""
        with os.fdopen(self._handle(name, most), "rb", buffering=0) as file:
            data = _read_all(file, f"{self.root}: {name}")
        digest = "" if self.listed is None else hashlib.sha256(data).hexdigest()
        self._compare(name, digest)
        return data

    def read_if_listed(self, name: str, most: int = MOST_BYTES) -> bytes | None:
        """Read a file that may be absent, in which case None is returned.

        A file that exists and is not listed is a DoorError. It is refused rather than passed over,
        because whoever put it there wants it to be read.
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
        """Raise a DoorError if a file exists that the list does not have."""
        is_unlisted = self.listed is not None and name not in self.listed
        if is_unlisted and os.path.lexists(self.root / name):
            raise DoorError(
                f"{self.root}: {name} is not among the files that were written: take it away"
            )

    def check(self, name: str) -> None:
        """Check a file's size and digest, block by block; an optional one may be absent."""
        try:
            with self.open(name, MOST_CHECKED) as file:
                self._compare(name, hashlib.file_digest(file, "sha256").hexdigest())
        except FileNotFoundError:
            entry = self._entry(name)
            if entry is None or not entry.optional:
                raise

    def check_size(self, name: str) -> None:
        """Check that a file is there, regular and of the size listed, without reading it."""
        folders, last = _split_name(self.root, name)
        if not system.OPENS_FOLDERS:
            path = _folder_by_path(self.root, name, folders) / last
            self._check_state(name, _regular_state(path, self.root, name), MOST_CHECKED)
            return
        folder = _open_folders(self.root, name, folders)
        try:
            state = _regular_state(last, self.root, name, folder)
            self._check_state(name, state, MOST_CHECKED)
        finally:
            os.close(folder)

    def read_part(self, name: str, offset: int, length: int) -> bytes:
        """Read part of a listed file, verified however the file changes between two calls.

        The first call takes the digest of the whole file and, in the same pass, of each of its
        blocks. Later calls read the blocks that they need and compare their digests. Time stamps
        are not used, because they can be set to anything.
        """
        if min(offset, length) < 0 or length > MOST_BYTES:
            raise DoorError(
                f"{self.root}: part of {name} must be within a file, got {length} bytes at {offset}"
            )
        with self.open(name, MOST_CHECKED) as file:
            if name not in self._blocks:
                digest_of_file = hashlib.sha256()
                digests = []
                while block := file.read(_BLOCK):
                    digest_of_file.update(block)
                    digests.append(hashlib.sha256(block).digest())
                self._compare(name, digest_of_file.hexdigest())
                self._blocks[name] = digests
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
        """Read a file of JSON, see ``parse_json`` (``json_text.py``)."""
        data = self.read(name, most)
        try:
            return parse_json(data)
        except ValueError as error:
            raise DoorError(f"{self.root}: {name} cannot be read: {error}") from None

    def has(self, name: str) -> bool:
        """Return whether something of any kind has a name; reading it checks the kind."""
        _split_name(self.root, name)
        return os.path.lexists(self.root / name)

    def path(self, name: str) -> Path:
        """Return the path of a folder inside; one behind a link is a DoorError."""
        folders, last = _split_name(self.root, name)
        if not system.OPENS_FOLDERS:
            return _folder_by_path(self.root, name, [*folders, last])
        os.close(_open_folders(self.root, name, [*folders, last]))
        return self.root / name

    def _handle(self, name: str, most: int) -> int:
        """Return the descriptor of an open file of an allowed size."""
        handle = _open_inside(self.root, name)
        try:
            self._check_state(name, os.fstat(handle), most)
        except DoorError:
            os.close(handle)
            raise
        return handle

    def _check_state(self, name: str, state: os.stat_result, most: int) -> None:
        """Refuse a file of another size than listed, or of more than ``most`` bytes."""
        entry = self._entry(name)
        size = state.st_size
        if entry is not None and entry.sizes and size not in entry.sizes:
            sizes = " or ".join(map(str, entry.sizes))
            raise DoorError(
                f"{self.root}: {name} differs from what was written ({size} bytes against {sizes})"
            )
        _check_size(f"{self.root}: {name}", size, most)

    def _entry(self, name: str) -> Listed | None:
        """Return what the list says of a file; None for a folder without a list."""
        if self.listed is None:
            return None
        if name not in self.listed:
            raise DoorError(f"{self.root}: {name} is not among the files that were written")
        return self.listed[name]

    def _compare(self, name: str, digest: str) -> None:
        """Refuse a file with another digest than listed."""
        entry = self._entry(name)
        if entry is not None and digest not in entry.digests:
            raise DoorError(
                f"{self.root}: {name} differs from what was written (its SHA-256 is another)"
            )
        self.proven.add(name)


def listed_files(folder: str | Path, manifest: Mapping[str, Any]) -> Folder:
    """Return the files of a folder as its manifest lists them, by name.

    ``files`` of the manifest holds one digest per file. ``added`` holds several, of which one must
    match; a None among them says that the file may be absent. ``sizes`` and ``added_sizes`` hold
    bytes likewise, unless the manifest is of an older version.

    Parameters
    ----------
    folder : str or path
        The folder.
    manifest : mapping
        Its manifest.

    Returns
    -------
    Folder
        The folder, of which only listed files are read.

    Raises
    ------
    ValueError
        If the list cannot be read.
    """
    try:
        sizes = manifest.get("sizes", {})
        listed: dict[str, Listed] = {}
        for name, digest in manifest["files"].items():
            listed[name] = _listed([(digest, sizes.get(name))])
        for name, versions in added_versions(manifest).items():
            listed[name] = _listed(versions)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{folder}: its list of files cannot be read ({error!r})") from None
    return Folder(folder, listed)


def added_versions(manifest: Mapping[str, Any]) -> dict[str, list[Version]]:
    """Return the versions that each file which was added to a folder may have, by name.

    There are several while a file is written. Manifests of an older version have no sizes.
    """
    sizes = manifest.get("added_sizes", {})
    added = {}
    for name, digests in manifest.get("added", {}).items():
        unknown: list[int | None] = [None] * len(digests)
        added[name] = list(zip(digests, sizes.get(name, unknown), strict=True))
    return added


def _listed(versions: Sequence[Version]) -> Listed:
    """Return what a manifest says of a file: digest and size of each version that it may have."""
    digests = [digest for digest, _ in versions if digest is not None]
    if not digests or not all(isinstance(digest, str) for digest in digests):
        raise ValueError(f"every file must have a digest, got {versions}")
    sizes = [size for digest, size in versions if digest is not None and size is not None]
    # Where the size of one version is not known, that of another must not keep it out.
    if len(sizes) < len(digests):
        sizes = []
    return Listed(tuple(digests), tuple(sizes), len(digests) < len(versions))


def _check_size(label: str, size: int, most: int) -> None:
    """Refuse a file of more than ``most`` bytes."""
    if size > most:
        raise DoorError(f"{label} must hold at most {most / 2**20:g} MiB, got {size / 2**20:.4g}")


def read_named(path: str | Path, most: int = MOST_BYTES) -> bytes:
    """Read a file that a user named, which may be a link.

    It must be regular and of at most ``most`` bytes. A pipe, a socket or a device is a DoorError at
    once; it is never waited for. A missing file is a FileNotFoundError.
    """
    with open_named(path, most) as file:
        return _read_all(file, str(path))


@contextmanager
def open_named(path: str | Path, most: int | None = None) -> Iterator[BufferedReader]:
    """Open a file that a user named, as :func:`read_named` reads one; None is no limit."""
    with open(path, "rb", opener=open_at_once) as file:
        if most is not None:
            _check_size(str(path), os.fstat(file.fileno()).st_size, most)
        yield file


def open_at_once(path: str, flags: int) -> int:
    """Return a descriptor for ``open``, links followed.

    What is not regular is a DoorError, and never waited for.
    """
    try:
        handle = os.open(path, flags | system.AT_ONCE, 0o666)
    except OSError as error:
        if error.errno != errno.ENXIO:  # a socket, or a pipe that nobody reads
            raise
        raise DoorError(f"{path} must be a regular file, got {_kind(os.stat(path))}") from None
    return _regular(handle, path)


def open_own(path: str, flags: int) -> int:
    """Return a descriptor for ``open``, also to write, of a file in a folder.

    A link is a DoorError, as is what is not regular.
    """
    try:
        if not system.NO_LINK and os.path.lexists(path) and _is_link(os.lstat(path)):
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
        return open_at_once(path, flags | system.NO_LINK)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise DoorError(f"{path} must be a regular file, got a symbolic link") from None


def check_expansion(name: str, size: int, room: int) -> None:
    """Refuse data that decode into far more bytes than the file holds: no measurement does."""
    if size > _SMALL and size > _MOST_EXPANSION * room:
        raise ValueError(
            f"{name} takes {room} bytes of the file and would expand to {size}: no data do"
        )


def _split_name(root: Path, name: str) -> tuple[list[str], str]:
    """Return the folders of a name and its last component; one that leads out is a DoorError."""
    components = name.split("/")
    has_bad_character = "\0" in name or "\\" in name
    if not system.OPENS_FOLDERS:  # on Windows a colon leads to another drive or stream
        has_bad_character |= ":" in name
    if has_bad_character or any(component in ("", ".", "..") for component in components):
        raise DoorError(f"{root}: names must be relative and stay inside, got {name!r}")
    return components[:-1], components[-1]


@contextmanager
def _naming(root: Path, name: str) -> Iterator[None]:
    """Make an error about something that is missing name the file that was asked for."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError) as error:
        raise type(error)(error.errno, error.strerror, str(root / name)) from None


def _open_inside(root: Path, name: str) -> int:
    """Open a regular file below a folder, from folder to folder, so that no link is followed."""
    folders, last = _split_name(root, name)
    if not system.OPENS_FOLDERS:
        return _open_by_path(root, name, folders, last)
    folder = _open_folders(root, name, folders)
    try:
        # Checked before it is opened, because opening a device may already do something.
        _regular_state(last, root, name, folder)
        with _naming(root, name):
            return _regular(os.open(last, _FILE, dir_fd=folder), f"{root}: {name}")
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise DoorError(f"{root}: {name} must be a regular file, got a symbolic link") from None
    finally:
        os.close(folder)


def _open_by_path(root: Path, name: str, folders: Sequence[str], last: str) -> int:
    """Open a regular file below a folder where folders cannot be opened, as on Windows.

    Every component is looked at before the file is opened and again after, and the open file must
    be the one that was seen.
    """
    path = _folder_by_path(root, name, folders) / last
    _regular_state(path, root, name)
    handle = os.open(path, _FILE)
    try:
        _folder_by_path(root, name, folders)
        if not os.path.samestat(os.fstat(handle), _regular_state(path, root, name)):
            raise DoorError(f"{root}: {name} must stay as it is while it is opened")
    except BaseException:
        os.close(handle)
        raise
    return _regular(handle, f"{root}: {name}")


def _folder_by_path(root: Path, name: str, folders: Sequence[str]) -> Path:
    """Return the path of a folder below another; a link on the way is a DoorError."""
    if not root.is_dir():
        error = errno.ENOTDIR if root.exists() else errno.ENOENT
        kind = NotADirectoryError if root.exists() else FileNotFoundError
        raise kind(error, os.strerror(error), str(root / name))
    folder = root
    for component in folders:
        folder = folder / component
        with _naming(root, name):
            state = os.lstat(folder)
        if _is_link(state) or not stat.S_ISDIR(state.st_mode):
            raise DoorError(
                f"{root}: {name} must lie in folders of its own, got {_kind(state)} at {component}"
            )
    return folder


def refuse_links(*paths: Path) -> None:
    """Refuse symbolic links at names that a writer removes, replaces, or makes as temporary ones.

    What a link leads to is somebody else's: a writer that took it for its own unfinished work would
    delete it. A link in the place of a file is refused as well, although to rename a file over it
    would spare what it leads to: the user, who made it so that the output lies elsewhere, would
    find it gone and the output here. Folders on the way to an output may be links.

    Parameters
    ----------
    *paths : Path
        Names of outputs and of what is made beside them; nothing need lie there.

    Raises
    ------
    FileExistsError
        If one is a link, wherever it leads and whether anything lies there.
    """
    for path in paths:
        try:
            state = os.lstat(path)
        except OSError:  # nothing is there; what else is wrong is told where it is written
            continue
        if _is_link(state):
            raise FileExistsError(
                f"{path} must not be a symbolic link, got one to {os.readlink(path)}: "
                "remove the link or name another output"
            )


def refuse_linked_companion(path: Path) -> None:
    """Refuse a file that is read because it lies beside one that the user named, if it is a link.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    DoorError
        If it is a symbolic link, wherever it leads.
    """
    if _is_link(os.lstat(path)):
        raise DoorError(
            f"{path} must not be a symbolic link, got one to {os.readlink(path)}: files that are "
            "read beside a recording lie beside it; put a copy there, or name the recording where "
            "they lie"
        )


def _is_link(state: os.stat_result) -> bool:
    """Return whether a name leads elsewhere: a symbolic link, or a junction of Windows."""
    is_junction = getattr(state, "st_reparse_tag", 0) in _LEADS_ELSEWHERE
    return stat.S_ISLNK(state.st_mode) or is_junction


def _regular_state(
    path: str | Path, root: Path, name: str, folder: int | None = None
) -> os.stat_result:
    """Return the state of a file, by its path or in an open folder, which must be regular."""
    with _naming(root, name):
        state = os.stat(path, dir_fd=folder, follow_symlinks=False)
    if _is_link(state) or not stat.S_ISREG(state.st_mode):
        raise DoorError(f"{root}: {name} must be a regular file, got {_kind(state)}")
    return state


def _open_folders(root: Path, name: str, folders: Sequence[str]) -> int:
    """Return the descriptor of a folder below another; a link on the way is a DoorError.

    Errors name the file that was asked for.
    """
    with _naming(root, name):
        folder = os.open(root, _FOLDER)
    for component in folders:
        try:
            with _naming(root, name):
                inner_folder = os.open(component, _FOLDER | system.NO_LINK, dir_fd=folder)
        except OSError as error:
            if error.errno not in (errno.ELOOP, errno.ENOTDIR):
                raise
            kind = _kind(os.stat(component, dir_fd=folder, follow_symlinks=False))
            raise DoorError(
                f"{root}: {name} must lie in folders of its own, got {kind} at {component}"
            ) from None
        finally:
            os.close(folder)
        folder = inner_folder
    return folder


def _regular(handle: int, path: str | Path) -> int:
    """Return a descriptor if it is of a regular file; else close it and raise an error."""
    state = os.fstat(handle)
    if stat.S_ISREG(state.st_mode):
        return handle
    os.close(handle)
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise DoorError(f"{path} must be a regular file, got {_kind(state)}")


def kind_of(path: str | Path) -> str:
    """Return the kind of what lies at a path, links followed: "a file", "a folder", "a pipe"."""
    return _kind(os.stat(path))


def _kind(state: os.stat_result) -> str:
    """Return the kind of a file by its state."""
    return _KINDS.get(stat.S_IFMT(state.st_mode), "a file")


def _read_all(file: BinaryIO, label: str) -> bytes:
    """Read a file to its end; one that changes its size meanwhile is a DoorError."""
    size = os.fstat(file.fileno()).st_size
    data = file.read(size + 1)
    while 0 < len(data) < size:  # one call may return a part only
        block = file.read(size + 1 - len(data))
        if not block:
            break
        data += block
    if len(data) != size:
        raise DoorError(f"{label} must stay as it is while it is read, got another size")
    return data
