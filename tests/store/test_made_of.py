"""The record of what a store was made of is no part of the run, and counts for its own commit."""

import pytest

from flgpr.store import RunWriter, read_manifest
from flgpr.store.journal import FixedParts, describe_inputs, difference_from_stored, read_limits
from flgpr.store.run_writer import RunExistsError


@pytest.fixture
def fixed(small_run):
    names = ("frequency", "polarization", "tx_position", "rx_position")
    return [small_run[name].values for name in names]


def append_first(writer, run):
    writer.append(run["signal"][0].values, run["pose"].values[0], float(run["time"][0]))


def test_limits_are_recorded_beside_the_run_and_are_no_part_of_it(small_run, fixed, tmp_path):
    digests = set()
    for name, limits in (("a", None), ("b", {"footprint_m": [0, 1, 2, 3]})):
        path = tmp_path / f"{name}.zarr"
        with RunWriter(path, *fixed, inputs={"seed": 1}, limits=limits) as writer:
            append_first(writer, small_run)
        digests.add(read_manifest(path)["sha256"])
        assert read_limits(path) == (limits or {})
        with pytest.raises(RunExistsError) as caught:
            RunWriter(path, *fixed, inputs={"seed": 1}, limits={"other": 1})
        assert caught.value.same
    assert len(digests) == 1
    made_of = tmp_path / "b.zarr" / "made-of.json"
    made_of.write_text(made_of.read_text().replace(digests.pop(), "0" * 64))
    assert read_limits(tmp_path / "b.zarr") == {}  # they were of another run
    assert read_limits(tmp_path / "none.zarr") == {}


def test_the_first_difference_is_named(small_run, fixed, tmp_path):
    path = tmp_path / "a.zarr"
    with RunWriter(path, *fixed, {"site": "field"}, inputs={"seed": 1}) as writer:
        append_first(writer, small_run)
    frequency, polarization, tx, rx = fixed
    labels = [str(label) for label in polarization]

    def difference(attrs, inputs):
        about = describe_inputs(FixedParts(frequency, labels, tx, rx), attrs, inputs)
        return difference_from_stored(path, about)

    assert difference({"site": "field"}, {"seed": 1}) == ""
    assert "seed" in difference({"site": "field"}, {"seed": 2})
    assert "site" in difference({"site": "road"}, {"seed": 1})
    assert difference_from_stored(tmp_path / "none.zarr", {}) is None
