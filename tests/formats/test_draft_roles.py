"""What each array of a measurement's files is."""

import numpy as np
import pytest

from flgpr.formats.arrays import LIMIT
from flgpr.formats.draft_groups import group_files
from flgpr.formats.draft_roles import Roles

SIGNAL = np.ones((5, 2, 3, 7), np.complex64)
TONES = np.linspace(5e8, 3e9, 7)


def roles_of(folder, **arrays):
    np.savez(folder / "a.npz", **arrays)
    return Roles(group_files([folder / "a.npz"], LIMIT))


def test_axes_follow_from_lengths_and_names(tmp_path):
    roles = roles_of(
        tmp_path,
        field=SIGNAL,
        freq=TONES,
        tx=np.zeros((2, 3)),
        rx=np.ones((3, 3)),
        x=np.arange(5.0),
        y=np.arange(5.0),
    )
    assert roles.signal.name == "field"
    assert roles.dims() == ["scan", "tx", "rx", "frequency"]
    assert {side: found.count for side, found in roles.antennas.items()} == {"tx": 2, "rx": 3}
    assert roles.scan_count(roles.dims()) == roles.fix_count() == 5


def test_lengths_that_leave_a_choice_end_in_a_question_mark(tmp_path):
    roles = roles_of(tmp_path, field=np.ones((7, 7), complex), freq=TONES)
    assert roles.dims() == ["scan?", "frequency?"]
    unnamed = roles_of(tmp_path, field=np.ones((4, 5, 7), complex), freq=TONES)
    assert unnamed.dims()[:2] == ["scan, polarization, pair, tx, rx or single?"] * 2


def test_tones_that_can_only_be_hertz_are_no_guess(tmp_path):
    roles = roles_of(tmp_path, field=SIGNAL, freq=TONES)
    assert roles.frequency_unit() == ("Hz", "by their size")
    roles = roles_of(tmp_path, field=SIGNAL, freq=TONES / 1e9)
    assert roles.frequency_unit() == ("GHz?", "")


@pytest.mark.parametrize(
    ("step", "unit"), [(0.5, ("m", "by their steps of 0.5 from row to row")), (500.0, ("m?", ""))]
)
def test_steps_of_a_vehicle_give_the_unit_of_its_positions(step, unit, tmp_path):
    way = {"x": np.zeros(5), "y": step * np.arange(5.0)}
    roles = roles_of(tmp_path, field=SIGNAL, freq=TONES, **way)
    assert roles.position_unit() == unit


def test_tones_must_increase(tmp_path):
    roles = roles_of(tmp_path, field=SIGNAL, freq=TONES[[0, 2, 1, 3, 4, 5, 6]])
    assert roles.frequency is None


def test_files_without_a_signal_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"must hold a signal, .*, got none in a\.npz"):
        roles_of(tmp_path, t=np.arange(5.0))
