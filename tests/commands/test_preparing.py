"""Steps of preparation: read, checked, applied in their order, and kept in the history."""

import numpy as np
import pytest

from flgpr.commands.preparing import check_steps, prepare_run, read_steps
from flgpr.store import open_run, save_run


@pytest.fixture
def stored(small_run, tmp_path):
    return save_run(small_run, tmp_path / "drive.zarr")


def test_steps_of_a_file_work_in_its_order_and_history_grows(stored, tmp_path):
    steps = tmp_path / "steps.toml"
    steps.write_text(
        f'[[step]]\ndo = "time-zero"\ndelay_ns = 2.0\n[[step]]\ndo = "subtract"\nrun = "{stored}"\n'
    )
    first = tmp_path / "first.zarr"
    prepare_run(stored, check_steps([{"do": "dewow", "length_ns": 3}]), first)
    prepare_run(first, read_steps(steps), tmp_path / "second.zarr")
    assert [one["do"] for one in open_run(tmp_path / "second.zarr").attrs["history"]] == [
        "dewow", "time-zero", "subtract",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("entries", "rule"),
    [
        ([{"do": "dewow", "length_ns": -1}], "length_ns: input should be greater than 0, got -1"),
        ([{"do": "smooth"}], "smooth"),
        (
            [{"do": "gate", "start_ns": 9, "stop_ns": 5}],
            "step 1, gate: gate must have start < stop",
        ),
        ([], "at least one step"),
    ],
)
def test_a_step_that_does_not_fit_is_told_and_nothing_is_stored(stored, tmp_path, entries, rule):
    with pytest.raises(ValueError, match=rule):
        prepare_run(stored, check_steps(entries), tmp_path / "new.zarr")
    assert not (tmp_path / "new.zarr").exists()


def test_what_is_subtracted_from_elsewhere_is_told(small_run, tmp_path, caplog):
    caplog.set_level("INFO", "flgpr.notes")
    names = [str(tmp_path / f"{name}.zarr") for name in ("drive", "same", "moved", "short")]
    moved = small_run.copy(deep=True)
    moved["pose"].values[:2, 1] += 0.25
    runs = [small_run, small_run, moved, small_run.isel(scan=slice(3))]
    for run, name in zip(runs, names, strict=True):
        save_run(run, name)
    for name in names[1:]:
        prepare_run(
            names[0], check_steps([{"do": "subtract", "run": name}]), f"{name[:-5]}-less.zarr"
        )
    total = small_run.sizes["scan"]
    assert caplog.messages == [
        f"{names[2]}: 2 of {total} scans were taken elsewhere, up to 0.25 m from those that they are "
        "subtracted from",
        f"{names[3]} has 3 scans beside {total}: the mean of its complete ones is subtracted from all",
    ]
    left = open_run(f"{names[1][:-5]}-less.zarr")["signal"].values
    assert np.nanmax(np.abs(left)) == 0
