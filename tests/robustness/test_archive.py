"""Archives of arrays from anywhere: what they declare is refused before it is decoded."""

import io
import struct
import zipfile

import numpy as np
import pytest

from damage import memory_within
from flgpr.archive import Archive, npy_header
from flgpr.formats.arrays import open_arrays
from flgpr.results.detection_files import parse_view
from flgpr.results.result import read_result
from flgpr.simulate.bodies.signature.table import load_table
from flgpr.store import json_with_digest, parse_with_digest, sha256
from small_results import small_result

SMALL = 40 * 2**20
BOMB = (80, 2**20)  # bytes when decoded: 80 MiB of 80 kB


def npy(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=array.dtype.hasobject)
    return file.getvalue()


def header(shape, dtype):
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return file.getvalue()


def archive(members, method=zipfile.ZIP_DEFLATED):
    """Give the bytes of an archive of members, each the bytes of its file or pieces of them."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as whole:
        for name, data in members.items():
            with whole.open(name, "w") as member:
                for piece in [data] if isinstance(data, bytes) else data:
                    member.write(piece)
    return file.getvalue()


def zeros(shape, dtype, size):
    """Give a member of zeros piece by piece."""
    yield header(shape, dtype)
    yield from (bytes(2**20) for _ in range(size // 2**20))


def view_of(magnitude, **more):
    """Give the members of a run-view with another magnitude, of the right shape."""
    labels = np.array(["HH"])
    sides = {"y": np.zeros(BOMB[0]), "x": np.zeros(BOMB[1] // 4), "looks": np.zeros((1, 1))}
    parts = {"polarization": labels, "subband": labels, **sides, **more}
    return {f"{name}.npy": npy(array) for name, array in parts.items()} | {
        "magnitude.npy": magnitude
    }


def refused(data, words):
    with memory_within(SMALL), pytest.raises(ValueError, match=words):
        dict(Archive(io.BytesIO(data)))


def test_whole_archives_are_read(tmp_path):
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array(["HH", "VV"]),
        "c": np.asfortranarray(np.ones((3, 2))),
    }
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    with (tmp_path / "a.npz").open("rb") as file:
        whole = Archive(file)
        assert set(whole) == set(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(whole[name], array)
        with pytest.raises(ValueError, match="not among its arrays"):
            whole["d"]


def test_what_expands_too_far_is_not_decoded():
    size = BOMB[0] * BOMB[1]
    bomb = archive({"a.npy": zeros((size,), "|u1", size)})
    assert len(bomb) < size / 500
    refused(bomb, "would expand")


def test_many_members_that_expand_are_counted_together():
    part = 35 * 2**20
    refused(
        archive({f"{k}.npy": zeros((part,), "|u1", part) for k in range(2)}),
        "all of it .* would expand",
    )


def test_an_absolute_limit_holds_whatever_the_room():
    data = archive({"a.npy": npy(np.zeros(1000))}, zipfile.ZIP_STORED)
    assert len(Archive(io.BytesIO(data), 9000)["a"]) == 1000
    with pytest.raises(ValueError, match="at most 5000 bytes"):
        Archive(io.BytesIO(data), 5000)


def test_a_header_is_bounded():
    """NumPy reads as much as the header says before it looks at it."""
    start = b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**32 - 1)
    pieces = [start, *(b" " * 2**20 for _ in range(80))]
    refused(archive({"a.npy": pieces}), "header of an array must take at most 10000 bytes")
    with pytest.raises(ValueError, match="header"):
        npy_header(io.BytesIO(start))


def test_members_cannot_share_their_bytes():
    """Each entry of the directory leads to the same data: sixteen arrays in the room of one."""
    one = archive({"a.npy": npy(np.random.default_rng(0).random(2**17))}, zipfile.ZIP_STORED)
    end = one.rindex(b"PK\x05\x06")
    begin = struct.unpack_from("<I", one, end + 16)[0]
    entry = one[begin:end]
    names = [entry[:46] + f"{k:x}.npy".encode() + entry[51:] for k in range(16)]
    data = one[:begin] + b"".join(names)
    tail = bytearray(one[end:])
    struct.pack_into("<HHII", tail, 8, 16, 16, len(b"".join(names)), begin)
    refused(data + bytes(tail), r"overlap|differ")


def test_a_directory_is_bounded():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as whole:
        for k in range(6000):
            whole.writestr(f"{k}", b"")
    refused(file.getvalue(), "directory of an archive must take at most")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_methods_are_refused(method):
    refused(archive({"a.npy": npy(np.zeros(9))}, method), "stored or deflated")


def test_objects_and_other_members_are_passed_over():
    data = {
        "a.npy": npy(np.array([{}], dtype=object)),
        "b.txt": b"text",
        "c.npy": npy(np.arange(3)),
    }
    assert set(Archive(io.BytesIO(archive(data)))) == {"c"}
    assert set(
        Archive(io.BytesIO(archive({"a.npy": header((10**15,), "<U0"), "c.npy": npy(np.ones(2))})))
    ) == {"c"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no archive"),
        (b"PK\x05\x06", "no archive"),
        (archive({"a.npy": npy(np.zeros(9))})[:-30], "no archive"),
        (archive({"a.npy": header((9,), "<f8")}), "holds 128 bytes, its header tells"),
        (archive({"a.npy": b"nothing"}), "magic"),
        (archive({"a.npy": header((-5,), "<f8")}), "holds|negative|shape"),
        (archive({"a.npy": b""}), "magic|EOF"),
    ],
)
def test_what_is_no_archive_of_arrays(data, words):
    refused(data, words)


def test_a_damaged_member_is_an_error():
    data = bytearray(archive({"a.npy": npy(np.arange(1000.0))}))
    data[900] ^= 255
    refused(bytes(data), "damaged|archive")


def test_a_run_view_must_fit_before_it_is_decoded():
    size = BOMB[0] * BOMB[1]
    right = (1, 1, BOMB[0], BOMB[1] // 4)
    for shape, words in ((right, "must fit"), ((size // 4,), "must fit")):
        data = archive(view_of(zeros(shape, "<f4", size)), zipfile.ZIP_STORED)
        with memory_within(2 * SMALL), pytest.raises(ValueError, match=words):
            parse_view(data)
    with pytest.raises(ValueError, match="must be lists"):
        parse_view(archive(view_of(npy(np.zeros(1)), x=np.zeros((2, 2)))))
    with pytest.raises(KeyError):
        parse_view(archive({"magnitude.npy": npy(np.zeros(1))}))


def test_a_result_with_a_bomb_is_refused(tmp_path):
    folder = small_result(tmp_path / "result")
    size = BOMB[0] * BOMB[1]
    shape = (1, 1, BOMB[0], BOMB[1] // 4)
    bomb = archive(view_of(zeros(shape, "<f4", size), looks=np.zeros((1, 1))))
    (folder / "run_view.npz").write_bytes(bomb)
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    del manifest["sha256"]
    manifest["files"]["run_view.npz"] = sha256(bomb)
    manifest["sizes"]["run_view.npz"] = len(bomb)
    (folder / "manifest.json").write_bytes(json_with_digest(manifest))
    with (
        memory_within(SMALL),
        pytest.raises(ValueError, match=r"run_view\.npz cannot be read.*would expand"),
    ):
        read_result(folder)


@pytest.mark.parametrize("read", [load_table, lambda path: open_arrays(path).read("a")])
def test_archives_that_users_name_are_bounded_alike(tmp_path, read):
    size = BOMB[0] * BOMB[1]
    (tmp_path / "a.npz").write_bytes(archive({"a.npy": zeros((size,), "|u1", size)}))
    with memory_within(SMALL), pytest.raises(ValueError, match=r"a\.npz.*would expand"):
        read(tmp_path / "a.npz")
