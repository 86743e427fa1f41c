"""What a child process does for ``arrays.py``.

Damaged HDF5 and MATLAB files can crash C libraries or keep them busy. It is run as a script,
``hdf5 FILE`` or ``matlab FILE LIMIT SPARE``, and imports nothing of flgpr, so that it starts
quickly.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST_PROBED = 10_000_000
"""Values of an array, from which on it is not read to see whether it can be."""
_MOST_CHUNK = 64 * 2**20  # bytes of a chunk of HDF5 that is unpacked whatever its array holds
_MOST_PROBED_BYTES = 2**31  # addresses of a process that probes; its libraries take a fifth
_MOST_ADDRESSES = 2**62  # bytes, where the system sets no limit


def parts_elsewhere(file: Any) -> dict[str, str]:
    """Find what an HDF5 file does not hold itself. Nothing of it is opened.

    Links lead to other files, and arrays may state that their numbers lie in others, whichever
    these are.

    Parameters
    ----------
    file : h5py.File
        The file.

    Returns
    -------
    dict of str to str
        Why, by the name in the file.
    """
    import h5py

    reasons: dict[str, str] = {}

    def visit_link(name: bytes, info: Any) -> None:
        if info.type == h5py.h5l.TYPE_EXTERNAL:
            reasons[name.decode(errors="replace")] = "it is a link to another file"

    def visit_item(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external is not None):
            reasons[name] = "its numbers lie in other files: copy them into this one"

    file.id.links.visit(visit_link, info=True)
    file.visititems(visit_item)
    return reasons


def oversized_chunks(item: Any) -> str:
    """Return why the chunks of an HDF5 array are too large to be read; empty if they are not.

    A chunk is unpacked as a whole, however few of its values the array has.

    Parameters
    ----------
    item : h5py.Dataset
        The array.

    Returns
    -------
    str
        The reason.
    """
    if item.chunks is None:
        return ""
    size = math.prod(item.chunks) * item.dtype.itemsize
    if size <= max(_MOST_CHUNK, item.nbytes):
        return ""
    return (
        f"its {item.nbytes} bytes lie in chunks of {size}, which must take at most {_MOST_CHUNK}, "
        "or as many as the array"
    )


def probe_hdf5(path: str) -> None:
    """Read all attributes and all but the largest arrays of an HDF5 file.

    Those that cannot be read are printed, a line each. What lies in other files is not read.

    Parameters
    ----------
    path : str
        The file.
    """
    import h5py

    def read_attributes(item: Any) -> None:
        for name in item.attrs:
            try:
                item.attrs[name]
            except Exception as error:
                # A damaged text may claim any size, and whoever reads it takes as much memory.
                if isinstance(error, MemoryError) or "memory allocation" in str(error):
                    raise SystemExit(
                        f"attribute {name!r} of {item.name!r} claims more memory than "
                        f"{_MOST_PROBED_BYTES / 2**30:g} GiB: it is damaged"
                    ) from None

    def visit(name: str, item: Any) -> None:
        read_attributes(item)
        if name in elsewhere or not isinstance(item, h5py.Dataset):
            return
        if item.size is None:
            return
        reason = oversized_chunks(item)
        if reason:
            lines.append(f"{name!r}\t{reason}")
        elif item.size < LARGEST_PROBED:
            try:
                item[()]
            except Exception as error:
                reason = " ".join(str(error).split())[:120] or type(error).__name__
                lines.append(f"{name!r}\tdamaged ({reason})")

    with h5py.File(path, "r") as file:
        elsewhere = parts_elsewhere(file)
        lines = [f"{name!r}\t{reason}" for name, reason in elsewhere.items()]
        read_attributes(file)
        file.visititems(visit)
    print(*lines, sep="\n", end="\n" if lines else "")


def _bound_memory(most: int) -> None:
    """Let this process have no more than so many bytes of addresses, where the system can.

    Windows has no such limit, and macOS refuses to set it.
    """
    try:
        import resource
    except ImportError:
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    available = _MOST_ADDRESSES if hard == resource.RLIM_INFINITY else hard
    try:
        resource.setrlimit(resource.RLIMIT_AS, (min(most, available), hard))
    except (ValueError, OSError):
        if sys.platform != "darwin":
            raise


def unpack(path: str, limit: int, spare: int) -> None:
    """Write the arrays of a MATLAB file to standard output as ``.npy``, each after its name.

    The first array holds lines of what is passed over.

    Parameters
    ----------
    path : str
        The file.
    limit : int
        Bytes that all arrays may take.
    spare : int
        Bytes that the interpreter may take besides.

    Raises
    ------
    MemoryError
        If they take more.
    """
    # SciPy holds a complex array, its two components and their product at once.
    _bound_memory(3 * limit + spare)
    from scipy.io import loadmat

    warnings.simplefilter("ignore")
    # MATLAB stores whole numbers in fewer bytes: only mat_dtype restores their class, but it drops
    # imaginary parts.
    kinds = {}
    for name, value in _members("", loadmat(path, appendmat=False, mat_dtype=True), []):
        kinds[name] = value.dtype
    passed_over: list[str] = []
    arrays = dict(_members("", loadmat(path, appendmat=False), passed_over))
    if sum(value.nbytes for value in arrays.values()) > limit:
        raise MemoryError
    with open(1, "wb", closefd=False) as out:
        np.save(out, np.array(passed_over, dtype=np.str_), allow_pickle=False)
        for name, value in arrays.items():
            np.save(out, np.array(name), allow_pickle=False)
            np.save(out, _with_class(value, kinds[name]), allow_pickle=False)


def _with_class(values: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return values in the type of their class in MATLAB; truth values as numbers."""
    if np.iscomplexobj(values):
        return values.astype(np.result_type(kind, np.complex64), copy=False)
    return values.astype("u1" if kind == np.dtype(bool) else kind, copy=False)


def _members(label: str, value: Any, passed_over: list[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the names and values of arrays, also in structures and cells, in MATLAB's order.

    Objects, functions and sparse arrays are passed over.
    """
    if isinstance(value, dict):
        for name, member in value.items():
            if isinstance(member, str) and name != "__version__":
                # SciPy goes on beyond variables that it cannot read, and says so in a text.
                passed_over.append(f"{name}: not read: {member}")
            elif not name.startswith("__"):
                yield from _members(name, member, passed_over)
    elif type(value) is not np.ndarray:
        passed_over.append(f"{label}: not read: {type(value).__name__}")
    elif value.dtype.hasobject:
        fields = value.dtype.names
        for number, member in enumerate(value.ravel(order="F")):
            element = label if fields and value.size == 1 else f"{label}[{number}]"
            if not fields:
                yield from _members(element, member, passed_over)
            for name in fields or ():
                yield from _members(f"{element}.{name}", member[name], passed_over)
    elif value.dtype.kind == "U" and value.size == 1:
        yield label, value.reshape(())
    else:
        yield label, value


if __name__ == "__main__":
    if sys.argv[1] == "hdf5":
        _bound_memory(_MOST_PROBED_BYTES)
        probe_hdf5(sys.argv[2])
    else:
        limit = int(sys.argv[3])
        try:
            unpack(sys.argv[2], limit, int(sys.argv[4]))
        except MemoryError:
            sys.exit(f"it unpacks to more than {limit / 2**30:.3g} GiB")
