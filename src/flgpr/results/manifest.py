"""The manifest of a result folder and its seal; one that is read may come from anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from flgpr.door import MOST_CHECKED, DoorError, Folder, Version
from flgpr.json_text import check_format
from flgpr.results.description import check_description, check_origin
from flgpr.store import canonical_json, json_with_digest, sha256
from flgpr.store.files import read_with_digest, taken_for
from flgpr.types import Entries, PathLike


class ResultError(ValueError):
    """A result folder is incomplete, altered or not a result folder at all."""


FORMAT = "flgpr-result"
VERSION = 2
MANIFEST = "manifest.json"

# Versions of the files that are added to a folder later; several of a file while it is written.
Added = Mapping[str, list[Version]]


def sealed_manifest(content: Entries, added: Added) -> bytes:
    """Return the sealed content with its identity and the versions of files that were added."""
    digests = {}
    sizes = {}
    for name, versions in added.items():
        digests[name] = [digest for digest, _ in versions]
        sizes[name] = [size for _, size in versions]
    identity = sha256(canonical_json(content))
    return json_with_digest(
        {**content, "identity": identity, "added": digests, "added_sizes": sizes}
    )


def read_result_manifest(folder: PathLike) -> Entries:
    """Read the manifest of a result folder and no other file.

    Its ``identity`` does not change when files are added.

    Raises
    ------
    ResultError
        If the manifest is missing, altered or of another format.
    """
    folder = Path(folder)
    with reading(folder, MANIFEST):
        manifest = read_with_digest(folder, MANIFEST)
        check_format(manifest, FORMAT, VERSION)
        check_origin(manifest)
        check_description(manifest["run"])
        return manifest


@contextmanager
def reading(folder: Path, name: str, kind: str = "result folder") -> Iterator[None]:
    """Turn whatever goes wrong while a result is read into a ResultError that names the folder.

    Parameters
    ----------
    folder : Path
        The folder.
    name : str
        The file that lists the others: it is to blame for what no other file is.
    kind : str
        What the folder should be.
    """
    try:
        yield
    except ResultError:
        raise
    except OSError as error:
        reason = "is missing" if isinstance(error, FileNotFoundError) else f"gives {error.strerror}"
        told = f"{folder}: not a complete {kind}: {error.filename} {reason}{taken_for(folder)}"
        raise ResultError(told) from None
    except DoorError as error:
        raise ResultError(str(error)) from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: {name} is altered: {error}") from None


def listing(folder: Path, names: Iterable[str]) -> dict[str, Entries]:
    """Return digests and sizes of files that were just written, as manifests hold them."""
    written = Folder(folder)
    digests = {}
    sizes = {}
    for name in names:
        data = written.read(name, MOST_CHECKED)
        digests[name] = sha256(data)
        sizes[name] = len(data)
    return {"files": digests, "sizes": sizes}
