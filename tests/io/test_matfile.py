import struct

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from flgpr.io.matfile import read_mat

LIMIT = 2**30


@pytest.mark.parametrize("packed", [False, True])
def test_agrees_with_scipy(packed, tmp_path):
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
    got, want = read_mat(tmp_path / "a.mat", LIMIT), loadmat(tmp_path / "a.mat")
    for name in content:
        np.testing.assert_array_equal(got[name], want[name])
        assert got[name].dtype == want[name].dtype


def test_structures_cells_and_text(tmp_path):
    cell = np.empty((1, 2), object)
    cell[0, 0], cell[0, 1] = np.arange(3.0), "word"
    savemat(tmp_path / "a.mat", {"data": {"fp": np.ones((2, 2)), "af": {"r": np.arange(4.0)}}, "c": cell})
    got = read_mat(tmp_path / "a.mat", LIMIT)
    assert set(got) == {"data.fp", "data.af.r", "c[0]", "c[1]"}
    np.testing.assert_array_equal(got["data.af.r"], [np.arange(4.0)])
    assert str(got["c[1]"]) == "word"


def test_either_byte_order(tmp_path):
    """The same variable written by hand as a big-endian machine would."""
    for order, mark in ((">", b"MI"), ("<", b"IM")):
        body = struct.pack(f"{order}IIII", 6, 8, 6, 0) + struct.pack(f"{order}IIii", 5, 8, 1, 2)
        body += struct.pack(f"{order}I", (1 << 16) | 1) + b"x\0\0\0"
        body += struct.pack(f"{order}IIdd", 9, 16, 1.5, -2.0)
        head = b"hand made".ljust(124) + struct.pack(f"{order}H", 0x0100) + mark
        (tmp_path / "a.mat").write_bytes(head + struct.pack(f"{order}II", 14, len(body)) + body)
        np.testing.assert_array_equal(read_mat(tmp_path / "a.mat", LIMIT)["x"], [[1.5, -2.0]])
        np.testing.assert_array_equal(loadmat(tmp_path / "a.mat")["x"], [[1.5, -2.0]])


def test_damage_is_told(tmp_path):
    savemat(tmp_path / "a.mat", {"x": np.zeros((400, 400))}, do_compression=True)
    packed = (tmp_path / "a.mat").read_bytes()
    with pytest.raises(ValueError, match="unpacks to more than"):
        read_mat(tmp_path / "a.mat", 1000)
    for cut, words in ((100, "128"), (132, "left over|tag"), (len(packed) - 9, "truncated")):
        (tmp_path / "b.mat").write_bytes(packed[:cut])
        with pytest.raises(ValueError, match=words):
            read_mat(tmp_path / "b.mat", LIMIT)
    (tmp_path / "b.mat").write_bytes(packed[:126] + b"??" + packed[128:])
    with pytest.raises(ValueError, match="byte order"):
        read_mat(tmp_path / "b.mat", LIMIT)
