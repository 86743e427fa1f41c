"""What each array of a measurement's files is: signal, tones, samples, clock, antennas, places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flgpr.formats.arrays import LIMIT
from flgpr.formats.draft_arrays import FileGroup, group_files
from flgpr.formats.draft_roles import Roles
from formats.test_draft_units import file_of

SIGNAL = np.ones((5, 2, 3, 7), np.complex64)
TONES = np.linspace(5e8, 3e9, 7)


def roles_of(folder, way=None, **arrays):
    """Return the roles in an archive, and in a table of fixes beside it if there is one."""
    np.savez(folder / "a.npz", **arrays)
    paths = [folder / "a.npz"]
    if way is not None:
        np.savez(folder / "b.npz", **way)
        paths.append(folder / "b.npz")
    return Roles(group_files(paths, LIMIT))


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
    assert roles.scan_count(roles.dims()) == roles.places.count == 5


def test_lengths_that_leave_a_choice_end_in_a_question_mark(tmp_path):
    roles = roles_of(tmp_path, field=np.ones((7, 7), complex), freq=TONES)
    assert roles.dims() == ["scan?", "frequency?"]
    unnamed = roles_of(tmp_path, field=np.ones((4, 5, 7), complex), freq=TONES)
    assert unnamed.dims()[:2] == ["scan, polarization, pair, tx, rx or single?"] * 2


def test_an_axis_of_two_real_numbers_is_rather_their_parts(tmp_path):
    parts = np.ones((2, 5, 3, 7))
    roles = roles_of(tmp_path, field=parts, freq=TONES, x=np.arange(5.0), y=np.arange(5.0))
    assert roles.dims()[:2] == ["complex?", "scan"]
    doubtful = roles_of(tmp_path, field=parts[:, :2], freq=TONES).dims()
    assert doubtful[:2] == ["scan, polarization, pair, tx, rx, complex or single?"] * 2
    whole = roles_of(tmp_path, field=parts + 0j, freq=TONES)
    assert "complex" not in " ".join(whole.dims())


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
    roles = roles_of(tmp_path, way, field=SIGNAL, freq=TONES)
    assert roles.position_unit() == unit


def test_steps_beside_the_signal_may_be_those_of_a_rail_in_any_unit(tmp_path):
    way = {"x": np.zeros(5), "y": 0.5 * np.arange(5.0)}
    assert roles_of(tmp_path, field=SIGNAL, freq=TONES, **way).position_unit() == ("m?", "")


def test_tones_must_increase(tmp_path):
    roles = roles_of(tmp_path, field=SIGNAL, freq=TONES[[0, 2, 1, 3, 4, 5, 6]])
    assert roles.frequency is None


def test_files_without_a_signal_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"must hold a signal, .*, got none in a\.npz"):
        roles_of(tmp_path, t=np.arange(5.0))


# --- one file

SIZES = [41, 8, 200]
"""Scans, pairs and tones or samples of a signal."""
MANY_TONES = np.linspace(1e9, 2e9, 200)
DELAYS = np.linspace(0.0, 50e-9, 200)
CLOCK = np.linspace(0.0, 10.0, 41)


def roles_in(**arrays):
    """Return the roles of arrays of one file, of which ``data`` is the signal."""
    opened = replace(file_of(data=np.ones(SIZES), **arrays), path=Path("a.npz"), signal="data")
    return Roles([FileGroup("data", [opened.path], opened)])


def names_of(columns):
    return {component: source.info.name for component, source in columns.items()}


def test_tones_go_before_samples_and_what_is_found_is_used_up():
    roles = roles_in(freq=MANY_TONES, time=DELAYS)
    assert roles.frequency.info.name == "freq"
    assert roles.samples is None
    assert roles.dims()[2] == "frequency"
    assert roles.used == {("data", "data"), ("data", "freq")}


@pytest.mark.parametrize(
    ("time", "name"),
    [(DELAYS, "sample"), (np.linspace(0.0, 10.0, 200), "sample?")],  # s: of samples, or of scans
)
def test_a_slow_time_of_the_samples_is_in_doubt(time, name):
    roles = roles_in(time=time)
    assert (roles.samples.info.name, roles.dims()[2]) == ("time", name)


def test_values_that_do_not_rise_are_no_axis():
    assert roles_in(freq=MANY_TONES[::-1].copy()).axis is None


def test_the_clock_of_the_scans_is_no_time_of_the_samples():
    roles = roles_in(time=DELAYS, gps_time=CLOCK)
    assert roles.samples.info.name == "time"
    assert roles.stamp.info.name == "gps_time"


def test_antennas_are_told_by_their_names():
    roles = roles_in(tx_xyz=np.ones((8, 3)), receivers=np.ones((8, 3)), elements=np.ones((8, 3)))
    names = {side: found.source.info.name for side, found in roles.antennas.items()}
    assert names == {"tx": "tx_xyz", "rx": "receivers", "antenna": "elements"}


def test_a_pose_is_no_antennas_positions_and_components_are_told_by_their_words():
    roles = roles_in(vehicle_pos=np.ones((41, 3)), yaw=CLOCK, pitch_deg=CLOCK, speed=CLOCK)
    expected = {"position": "vehicle_pos", "heading": "yaw", "pitch": "pitch_deg"}
    assert names_of(roles.places.columns) == expected
    assert roles.antennas == {}
    assert ("data", "speed") not in roles.used


def test_longitude_and_latitude_stand_back_behind_places_in_the_lane():
    globe = {"lon": CLOCK, "lat": CLOCK}
    assert set(roles_in(**globe).places.columns) == {"longitude", "latitude"}
    assert set(roles_in(**globe, x=CLOCK, y=CLOCK).places.columns) == {"x", "y"}


def test_the_plainest_name_is_the_component():
    assert names_of(roles_in(dist=CLOCK, x=CLOCK, y=CLOCK).places.columns) == {"x": "x", "y": "y"}


def test_a_track_has_positions_and_a_clock_of_a_length_of_their_own():
    roles = roles_in(
        tx=np.ones((8, 3)),
        gps=np.ones((95, 3)),
        gps_stamp=np.arange(95.0),
        quaternion=np.ones((95, 4)),
    )
    expected = {"position": "gps", "time": "gps_stamp", "orientation": "quaternion"}
    assert names_of(roles.places.columns) == expected
    assert set(roles.antennas) == {"tx"}
    assert roles_in(gps=np.ones((95, 3))).places is None


def test_a_damaged_array_keeps_no_other_from_its_place():
    roles = roles_in(freq=MANY_TONES, tx=np.ones((8, 3)), x=CLOCK, y=CLOCK)

    def read(name):
        raise ValueError(name)

    opened = replace(roles.data.opened, _read=read)
    roles = Roles([FileGroup("data", [opened.path], opened)])
    assert roles.frequency is None
    assert roles.antennas["tx"].unit == "m?"
    assert roles.position_unit() == ("m?", "")
