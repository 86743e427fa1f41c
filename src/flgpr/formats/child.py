"""What ``arrays.py`` has a child process do: damaged HDF5 and MATLAB files can crash C libraries or keep them busy.

Run as a script, ``hdf5 FILE`` or ``matlab FILE LIMIT SPARE``. It imports nothing of flgpr, so that it starts quickly.
"""

from __future__ import annotations

import contextlib
import resource
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray


def parts_elsewhere(file: Any) -> dict[str, str]:
    """Find what an HDF5 file does not hold itself: why, by name. Nothing of it is opened.

    Links lead to other files, and arrays may say that their numbers lie in others, whichever these are.
    """
    import h5py

    found: dict[str, str] = {}

    def look_at_link(name: bytes, info: Any) -> None:
        if info.type == h5py.h5l.TYPE_EXTERNAL:
            found[name.decode(errors="replace")] = "it is a link to another file"

    def look_at_item(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external is not None):
            found[name] = "its numbers lie in other files: copy them into this one"

    file.id.links.visit(look_at_link, info=True)
    file.visititems(look_at_item)
    return found


def look(path: str) -> None:
    """Read all attributes and all but the largest arrays of an HDF5 file; name those that cannot be read, a line each.

    What lies in other files is not read.
    """
    import h5py

    def notes(item: Any) -> None:
        for name in item.attrs:
            with contextlib.suppress(Exception):
                item.attrs[name]

    def visit(name: str, item: Any) -> None:
        notes(item)
        if name in elsewhere or not isinstance(item, h5py.Dataset):
            return
        if item.size is not None and item.size < 10_000_000:
            try:
                item[()]
            except Exception as error:
                reason = " ".join(str(error).split())[:120] or type(error).__name__
                damaged.append(f"{name!r}\tdamaged ({reason})")

    with h5py.File(path, "r") as file:
        elsewhere = parts_elsewhere(file)
        damaged = [f"{name!r}\t{reason}" for name, reason in elsewhere.items()]
        notes(file)
        file.visititems(visit)
    print(*damaged, sep="\n", end="\n" if damaged else "")


def unpack(path: str, limit: int, spare: int) -> None:
    """Write the arrays of a MATLAB file to standard output as ``.npy``, each after its name.

    The first array holds lines that say what is passed over.
    """
    # SciPy holds a complex array, its parts and their product at once; the spare bytes are the
    # interpreter's.
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    most = 2**62 if hard == resource.RLIM_INFINITY else hard
    resource.setrlimit(resource.RLIMIT_AS, (min(3 * limit + spare, most), hard))
    from scipy.io import loadmat

    warnings.simplefilter("ignore")
    # MATLAB keeps whole numbers in fewer bytes: only mat_dtype tells their class, but it drops
    # imaginary parts.
    passed_over: list[str] = []
    kinds = {
        name: value.dtype
        for name, value in _members("", loadmat(path, appendmat=False, mat_dtype=True), [])
    }
    arrays = dict(_members("", loadmat(path, appendmat=False), passed_over))
    if sum(value.nbytes for value in arrays.values()) > limit:
        raise MemoryError
    with open(1, "wb", closefd=False) as out:
        np.save(out, np.array(passed_over, dtype=np.str_), allow_pickle=False)
        for name, value in arrays.items():
            kind = (
                np.result_type(kinds[name], np.complex64) if np.iscomplexobj(value) else kinds[name]
            )
            np.save(out, np.array(name), allow_pickle=False)
            np.save(
                out,
                value.astype("u1" if kind == np.dtype(bool) else kind, copy=False),
                allow_pickle=False,
            )


def _members(label: str, value: Any, passed_over: list[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Go into structures and cells in MATLAB's order; objects, functions and sparse arrays are passed over."""
    if isinstance(value, dict):
        for name, one in value.items():
            if isinstance(one, str) and name != "__version__":
                passed_over.append(
                    f"{name}: not read: {one}"
                )  # SciPy goes on beyond variables that it cannot read
            elif not name.startswith("__"):
                yield from _members(name, one, passed_over)
    elif type(value) is np.ndarray and value.dtype.hasobject:
        for k, one in enumerate(value.ravel(order="F")):
            place = label if value.dtype.names and value.size == 1 else f"{label}[{k}]"
            for name in value.dtype.names or ():
                yield from _members(f"{place}.{name}", one[name], passed_over)
            if not value.dtype.names:
                yield from _members(place, one, passed_over)
    elif type(value) is np.ndarray:
        yield label, value.reshape(()) if value.dtype.kind == "U" and value.size == 1 else value
    else:
        passed_over.append(f"{label}: not read: {type(value).__name__}")


if __name__ == "__main__":
    if sys.argv[1] == "hdf5":
        look(sys.argv[2])
    else:
        most = int(sys.argv[3])
        try:
            unpack(sys.argv[2], most, int(sys.argv[4]))
        except MemoryError:
            sys.exit(f"it unpacks to more than {most / 2**30:.3g} GiB")
