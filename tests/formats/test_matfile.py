import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from damage import in_forks
from flgpr.formats.arrays import open_arrays

MEASURED = """
import resource, sys
from flgpr.formats.arrays import open_arrays
try:
    open_arrays(sys.argv[1], limit=2**24)
except ValueError as error:
    print(error)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@in_forks()
def read(path, **options):
    opened = open_arrays(path, **options)
    return {name: opened.read(name) for name in opened.arrays}


@pytest.mark.parametrize("packed", [False, True])
def test_numbers_come_as_they_were_saved(packed, tmp_path):
    rng = np.random.default_rng(0)
    content = {
        "c64": (rng.normal(size=(3, 4, 5)) + 1j * rng.normal(size=(3, 4, 5))).astype(np.complex64),
        "c128": rng.normal(size=(2, 7)) * (1 - 2j),
        **{
            t: rng.integers(0, 100, (4, 3)).astype(t)
            for t in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
        },
        "small": np.array([[1.0]]),
        "empty": np.zeros((0, 3)),
    }
    savemat(tmp_path / "a.mat", content, do_compression=packed)
    got = read(tmp_path / "a.mat")
    assert set(got) == set(content)
    for name in content:
        np.testing.assert_array_equal(got[name], content[name])
        assert got[name].dtype == content[name].dtype


def test_structures_cells_and_text(tmp_path):
    cell = np.empty((2, 2), object)
    cell[0, 0] = np.arange(3.0)
    cell[1, 0] = "word"
    cell[0, 1] = {"in": 5.0}
    cell[1, 1] = np.array(["ab", "cde"])
    pair = np.zeros((1, 2), [("x", object)])
    pair["x"][0] = 1.0, 2.0
    data = {"fp": np.ones((2, 2)), "af": {"r": np.arange(4.0)}}
    savemat(
        tmp_path / "a.mat", {"data": data, "c": cell, "many": pair, "on": np.array([[True, False]])}
    )
    got = read(tmp_path / "a.mat")
    assert set(got) == {
        "data.fp",
        "data.af.r",
        "c[0]",
        "c[1]",
        "c[2].in",
        "c[3]",
        "many[0].x",
        "many[1].x",
        "on",
    }
    np.testing.assert_array_equal(got["data.af.r"], [np.arange(4.0)])
    assert (str(got["c[1]"]), list(got["c[3]"]), float(got["many[1].x"].squeeze())) == (
        "word",
        ["ab ", "cde"],
        2.0,
    )
    assert got["on"].dtype == np.uint8  # numbers, as in v7.3 files
    np.testing.assert_array_equal(got["on"], [[1, 0]])


def element(order, kind, data):
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def header(order="<"):
    return (
        b"hand made".ljust(124) + struct.pack(f"{order}H", 0x0100) + {">": b"MI", "<": b"IM"}[order]
    )


def variable(order, name, number_class, *parts):
    """The real and, if any, imaginary parts of [a b], stored as unsigned bytes."""
    body = element(order, 6, struct.pack(f"{order}II", number_class | (len(parts) == 2) << 11, 0))
    body += element(order, 5, struct.pack(f"{order}ii", 1, 2)) + element(order, 1, name.encode())
    return element(order, 14, body + b"".join(element(order, 2, bytes(part)) for part in parts))


@pytest.mark.parametrize("order", [">", "<"])
def test_whole_numbers_stored_in_bytes_have_the_class_they_had(order, tmp_path):
    classes = {"f8": 6, "f4": 7, "i2": 10}
    real = [variable(order, name, number, (1, 2)) for name, number in classes.items()]
    complex_ = [
        variable(order, name, number, (1, 2), (3, 4)) for name, number in (("c16", 6), ("c8", 7))
    ]
    (tmp_path / "a.mat").write_bytes(header(order) + b"".join(real + complex_))
    got = read(tmp_path / "a.mat")
    assert list(got) == ["f8", "f4", "i2", "c16", "c8"]
    for name, values in got.items():
        assert values.dtype == name
        np.testing.assert_array_equal(values, [[1 + 3j, 2 + 4j]] if name[0] == "c" else [[1, 2]])


@in_forks()
def test_damage_is_told(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"x": np.arange(160_000.0), "y": np.ones(3)}, do_compression=True)
    whole = path.read_bytes()
    for damaged in (whole[:100], whole[:132], whole[:-9], whole[:500] + b"????" + whole[504:]):
        path.write_bytes(damaged)
        with pytest.raises(
            ValueError, match=r"a\.mat: cannot be read as a MATLAB file: it is damaged"
        ):
            open_arrays(path)
    path.write_bytes(whole[:128])
    with pytest.raises(ValueError, match="holds no array"):
        open_arrays(path)


@in_forks()
def test_what_unpacks_to_more_than_the_limit_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"x": np.zeros((400, 400))}, do_compression=True)
    assert read(path, limit=400 * 400 * 8)["x"].shape == (400, 400)
    with pytest.raises(ValueError, match="unpacks to more than"):
        open_arrays(path, limit=400 * 400 * 8 - 1)


@pytest.mark.slow("runs in processes of its own")
def test_what_would_fill_the_memory_is_refused_before_it_does(tmp_path):
    """A variable of 768 MB of zeros in 3.5 MB; the child may take 560."""
    size = 768 * 2**20
    work = zlib.compressobj(1)
    start = variable("<", "x", 9, b"")[8:-8] + struct.pack("<II", 2, size)
    packed = [work.compress(struct.pack("<II", 14, len(start) + size) + start)]
    packed += [
        work.flush(zlib.Z_FULL_FLUSH),
        work.compress(bytes(2**20)) + work.flush(zlib.Z_FULL_FLUSH),
    ]
    packed += packed[-1:] * ((size >> 20) - 1) + [
        work.flush()
    ]  # with a checksum to which nobody comes
    data = b"".join(packed)
    (tmp_path / "a.mat").write_bytes(header() + struct.pack("<II", 15, len(data)) + data)
    command = [sys.executable, "-c", MEASURED, str(tmp_path / "a.mat")]
    said, taken = subprocess.run(
        command, capture_output=True, check=True, text=True
    ).stdout.splitlines()
    assert "unpacks to more than 0.0156 GiB" in said
    assert int(taken) < 600 * 2**10
