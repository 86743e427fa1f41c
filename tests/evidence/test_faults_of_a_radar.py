"""The page of faults shows the table that its file holds, and the script knows every fault in it."""

from pathlib import Path

import numpy as np

import faults

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "robustness.md"


def test_the_page_shows_what_costs_mines_of_its_file():
    rows = faults.read_rows(faults.CSV)
    costly = faults.costly(rows)
    assert faults.table(costly) in PAGE.read_text()
    others = rows[~rows["fault"].isin(costly["fault"])]
    assert others["found"].ge(faults.MINES - 1).all()
    assert f"The other {others['fault'].nunique()} faults" in PAGE.read_text()


def test_every_row_is_of_a_fault_that_the_script_makes():
    rows = faults.read_rows(faults.CSV)
    assert set(rows["fault"]) <= {*faults.FAULTS, *faults.LIVE_FAULTS}
    assert not rows.duplicated(["fault", "recipe", "road"]).any()
    assert rows["found"].between(0, faults.MINES).all()


def test_rows_run_elsewhere_stay_and_those_run_again_are_renewed():
    before = faults.read_rows(faults.CSV)
    again = before[before["fault"] == "conjugated"].assign(found=0)
    after = faults.together(before, again)
    assert after.loc[after["fault"] == "conjugated", "found"].eq(0).all()
    kept = after["fault"] != "conjugated"
    assert after[kept].equals(before[before["fault"] != "conjugated"])


def test_every_fault_changes_data_or_poses_and_keeps_their_shape():
    rng = np.random.default_rng(1)
    shape = (50, 2, 36, 600)
    clean = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    poses = np.cumsum(rng.uniform(0.5, 1.5, (50, 6)), axis=0)
    for name, fault in faults.FAULTS.items():
        signal, pose = fault(clean.copy(), poses.copy(), np.random.default_rng(2))
        assert (signal.shape, pose.shape) == (clean.shape, poses.shape), name
        same = np.array_equal(signal, clean) and np.array_equal(pose, poses)
        assert same == (name == "clean"), name
