"""The conformance set of run stores, read by flgpr and by a reader written from the page alone."""

import hashlib
import json
import math
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flgpr.store import RunStoreError, open_run, save_run

STORES = Path(__file__).parents[1] / "data" / "run-stores"
EXPECTED = json.loads((STORES / "expected.json").read_text(encoding="utf-8"))
GOOD = sorted(name for name, entry in EXPECTED.items() if "read" in entry)
BAD = sorted(name for name, entry in EXPECTED.items() if "refuse" in entry)


class Refused(Exception):
    """The store breaks a rule of the page."""


def independent_reader(root):
    """Read a store by docs/reference/run-store.md with nothing but the standard library."""
    manifest_file = root / "commit.json"
    if not manifest_file.is_file():
        raise Refused("no commit.json")
    manifest = json.loads(manifest_file.read_bytes())
    content = {name: value for name, value in manifest.items() if name != "sha256"}
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(canonical.encode()).hexdigest() != manifest["sha256"]:
        raise Refused("commit.json differs from its own digest")
    if (manifest["format"], manifest["version"]) != ("flgpr-run", 1):
        raise Refused("another format")
    data = {}
    for name, entry in manifest["files"].items():
        if not (root / name).is_file():
            raise Refused(f"{name} is missing")
        data[name] = (root / name).read_bytes()
        if hashlib.sha256(data[name]).hexdigest() != entry["sha256"]:
            raise Refused(f"{name} has another digest")

    def array(name):
        description = json.loads(data[f"{name}/zarr.json"])
        shape = description["shape"]
        chunk = description["chunk_grid"]["configuration"]["chunk_shape"]
        code, width = {"float64": ("d", 1), "complex64": ("f", 2), "bool": ("?", 1)}[
            description["data_type"]
        ]
        count = math.prod(chunk) * width
        numbers = []
        # Every array has one chunk, the signal one a scan: first dimension only.
        for first in range(math.ceil(shape[0] / chunk[0])):
            key = "/".join([name, "c", str(first), *["0"] * (len(shape) - 1)])
            size = count * struct.calcsize(code)
            numbers += struct.unpack(f"<{count}{code}", data[key][:size])
        if width == 2:
            numbers = [complex(*pair) for pair in zip(numbers[::2], numbers[1::2], strict=True)]
        return shape, numbers

    group = json.loads(data["zarr.json"])["attributes"]
    return {name: array(name) for name in ("signal", "valid", "pose", "frequency", "time")}, group


@pytest.mark.parametrize("name", GOOD)
def test_what_must_be_read_is_read(name):
    expected = EXPECTED[name]["read"]
    run = open_run(STORES / f"{name}.zarr").load()
    assert {dim: run.sizes[dim] for dim in expected["sizes"]} == expected["sizes"]
    assert run["frequency"].values.tolist() == expected["frequency"]
    assert run["polarization"].values.tolist() == expected["polarization"]
    assert run["pose"].values.tolist() == expected["pose"]
    time = [np.nan if t is None else t for t in expected["time"]]
    np.testing.assert_array_equal(run["time"].values, time)
    assert (~run["valid"].values).sum() == expected["sweeps_not_valid"]
    finite = run["signal"].values[np.isfinite(run["signal"].values)]
    total = complex(*expected["sum_of_finite_samples"])
    assert finite.sum() == pytest.approx(total, rel=1e-6)
    assert run.attrs == expected["attrs"]


@pytest.mark.parametrize("name", GOOD)
def test_the_page_suffices_to_write_a_reader(name):
    arrays, group = independent_reader(STORES / f"{name}.zarr")
    run = open_run(STORES / f"{name}.zarr").load()
    for variable, (shape, numbers) in arrays.items():
        values = np.array(numbers).reshape(shape)
        np.testing.assert_array_equal(values, run[variable].values)
    assert group["polarization"] == run["polarization"].values.tolist()
    assert group["attrs"] == run.attrs


@pytest.mark.parametrize("name", BAD)
def test_what_must_be_refused_is_refused(name):
    with pytest.raises(RunStoreError):
        open_run(STORES / f"{name}.zarr").load()
    with pytest.raises(Refused):
        independent_reader(STORES / f"{name}.zarr")


def test_the_samples_are_those_that_the_page_states():
    run = open_run(STORES / "plain.zarr").load()
    scan, polarization, pair, tone = np.ogrid[:3, :2, :2, :4]
    signal = (scan + 1) + 0.1 * polarization + 0.01 * pair + 0.001j * tone
    np.testing.assert_allclose(run["signal"].values, signal, rtol=1e-6)


@pytest.mark.parametrize("name", GOOD)
def test_plain_zarr_opens_it_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opened = xr.open_zarr(STORES / f"{name}.zarr")
    assert opened["signal"].attrs["long_name"] == "received field over transmitted field"
    assert opened["frequency"].attrs["units"] == "Hz"
    assert all("units" in opened[name].attrs for name in opened.variables)


def test_consolidated_metadata_that_differ_from_the_arrays_are_refused(small_run, tmp_path):
    """A reader that takes the group's word would see another run than one that looks at the arrays."""
    from flgpr.json_text import canonical_json, sha256
    from flgpr.store.run_store import manifest_bytes

    root = save_run(small_run, tmp_path / "a.zarr")
    group = json.loads((root / "zarr.json").read_text())
    group["consolidated_metadata"]["metadata"]["pose"]["shape"] = [1, 6]
    (root / "zarr.json").write_text(json.dumps(group))
    manifest = json.loads((root / "commit.json").read_text())
    data = (root / "zarr.json").read_bytes()
    manifest["files"]["zarr.json"] = {"sha256": sha256(data), "bytes": len(data)}
    content = {name: value for name, value in manifest.items() if name != "sha256"}
    manifest["sha256"] = sha256(canonical_json(content))
    (root / "commit.json").write_bytes(manifest_bytes(manifest))
    with pytest.raises(RunStoreError, match="pose: the group's consolidated metadata"):
        open_run(root)
