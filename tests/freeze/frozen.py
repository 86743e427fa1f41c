"""Frozen tables and digests: how they are made, written and compared.

Tables hold six digits and are compared as the tables of ``tests/data/goldens`` are, to a thousandth
of the column's largest value. They hold on any machine. Digests are exact. Equal processors and
equal libraries give equal bits, so that digests are kept by machine, and compared on a machine that
is known.
"""

import hashlib
import json
from datetime import date, datetime
from functools import cache
from pathlib import Path

import llvmlite
import llvmlite.binding
import numba
import numpy as np
import pandas as pd
import scipy
import sklearn
from threadpoolctl import threadpool_info

DATA = Path(__file__).parent / "data"
DIGESTS = DATA / "digests.json"
TOLERANCE = 1e-3
FORMAT = "%.6g"
VALUES = ("format", "version")
"""Keys of JSON whose values are frozen as well."""
_TYPES = {
    bool: "boolean", int: "number", float: "number", str: "text", type(None): "null",
    date: "date", datetime: "time",
}  # fmt: skip
"""Names of the types of JSON and TOML."""


def digest(data: bytes) -> str:
    """Return the SHA-256 of bytes, shortened to 16 digits."""
    return hashlib.sha256(data).hexdigest()[:16]


def array_digest(values: np.ndarray) -> str:
    """Return the digest of an array's type, shape and bytes."""
    values = np.ascontiguousarray(values)
    head = f"{values.dtype.str} {values.shape} ".encode()
    return digest(head + values.tobytes())


def json_digest(value: object) -> str:
    """Return the digest of a JSON value."""
    return digest(json.dumps(value, sort_keys=True).encode())


@cache
def machine() -> dict[str, str]:
    """Describe all that the bits of a result depend on beside the program."""
    features = llvmlite.binding.get_host_cpu_features().flatten()
    algebra = sorted({f"{one['version']} {one.get('architecture')}" for one in threadpool_info()})
    libraries = {
        module.__name__: module.__version__ for module in (llvmlite, numba, np, pd, scipy, sklearn)
    }
    return {
        "processor": llvmlite.binding.get_host_cpu_name(),
        "features": digest(features.encode()),
        "linear algebra": ", ".join(algebra),
        **libraries,
    }


def machine_key() -> str:
    """Return the key under which digests of this machine are kept."""
    return json_digest(machine())


def read_digests() -> dict[str, dict]:
    """Return what is kept of every machine: what it is, and its digests by name."""
    if not DIGESTS.exists():
        return {}
    return json.loads(DIGESTS.read_text())


def write_digests(digests: dict[str, dict[str, str]], others: bool) -> None:
    """Keep digests of this machine, beside those of other machines or instead of them."""
    known = read_digests() if others else {}
    known[machine_key()] = {"machine": machine(), "digests": digests}
    write_json(DIGESTS, known)


def write_json(path: Path, value: object) -> None:
    """Write JSON with a line for each entry, so that a change shows where it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False) + "\n")


def read_json(path: Path):
    """Read what ``write_json`` wrote."""
    return json.loads(path.read_text())


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table with six digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, float_format=FORMAT)


def check_table(table: pd.DataFrame, path: Path) -> None:
    """Compare a table with a frozen one: the same columns and rows, numbers to the tolerance."""
    frozen = pd.read_csv(path)
    name = path.stem
    assert list(table.columns) == list(frozen.columns), name
    assert len(table) == len(frozen), name
    for column in frozen.columns:
        values = table[column].to_numpy()
        expected = frozen[column].to_numpy()
        message = f"{name}.{column}"
        if np.issubdtype(expected.dtype, np.number):
            largest = np.nanmax(np.abs(expected), initial=0)
            np.testing.assert_allclose(
                values.astype(float),
                expected,
                rtol=TOLERANCE,
                atol=TOLERANCE * largest,
                err_msg=message,
            )
        else:
            np.testing.assert_array_equal(values.astype(str), expected.astype(str), err_msg=message)


def json_shape(value, folder: Path):
    """Return keys and types of a JSON value, those of a list's entries as one.

    What stands under ``format`` and ``version`` is kept as it is.
    """
    if isinstance(value, dict):
        shape = {}
        for key, one in value.items():
            plain = one if key in VALUES else json_shape(one, folder)
            shape[key.replace(str(folder), "FOLDER")] = plain
        return shape
    if isinstance(value, list):
        shapes = [json_shape(one, folder) for one in value]
        return [merged(shapes)] if shapes else []
    return _TYPES[type(value)]


def merged(shapes):
    """Merge structures into one that says what each of them may be."""
    if all(isinstance(one, dict) for one in shapes):
        keys = sorted({key for one in shapes for key in one})
        joined = {}
        for key in keys:
            held = [one[key] for one in shapes if key in one]
            name = key if len(held) == len(shapes) else f"{key} (not always)"
            joined[name] = merged(held)
        return joined
    if all(isinstance(one, list) for one in shapes):
        inner = [entry for one in shapes for entry in one]
        return [merged(inner)] if inner else []
    distinct = sorted({json.dumps(one, sort_keys=True) for one in shapes})
    if len(distinct) == 1:
        return shapes[0]
    return " or ".join(text.strip('"') for text in distinct)
