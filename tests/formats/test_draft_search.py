"""Which array of a file is taken for tones, samples, clock, antennas and pose."""

import numpy as np
import pytest

from flgpr.formats.draft_search import (
    ArraySearch,
    find_pose,
    find_positions,
    find_rotation,
    find_signal_axis,
    find_stamp,
    find_track,
)
from formats.test_draft_units import file_of

SIZES = [41, 8, 200]
"""Scans, pairs and tones or samples of a signal."""
TONES = np.linspace(1e9, 2e9, 200)
DELAYS = np.linspace(0.0, 50e-9, 200)
CLOCK = np.linspace(0.0, 10.0, 41)


def search_in(**arrays):
    """Return the search among arrays, of which ``data`` is the signal."""
    opened = file_of(data=np.ones(SIZES), **arrays)
    return ArraySearch(opened, used={"data"})


def signal_of(search):
    return search.opened.arrays["data"]


def test_tones_go_before_samples_and_what_is_found_is_used_up():
    search = search_in(freq=TONES, time=DELAYS)
    axis = find_signal_axis(search, SIZES)
    assert (axis.info.name, axis.name) == ("freq", "frequency")
    assert search.used == {"data", "freq"}
    assert [info.name for info in search.unused()] == ["time"]


@pytest.mark.parametrize(
    ("time", "name"),
    [(DELAYS, "sample"), (np.linspace(0.0, 10.0, 200), "sample?")],  # s: of samples, or of scans
)
def test_a_slow_time_of_the_samples_is_in_doubt(time, name):
    axis = find_signal_axis(search_in(time=time), SIZES)
    assert (axis.info.name, axis.name) == ("time", name)


def test_values_that_do_not_rise_are_no_axis():
    axis = find_signal_axis(search_in(freq=TONES[::-1].copy()), SIZES)
    assert axis.info is None


def test_the_clock_of_the_scans_is_no_time_of_the_samples():
    search = search_in(time=DELAYS, gps_time=CLOCK)
    assert find_signal_axis(search, SIZES).info.name == "time"
    assert find_stamp(search, SIZES, tones=200).name == "gps_time"
    assert find_stamp(search, SIZES, tones=200) is None


def test_antennas_are_told_by_their_names():
    search = search_in(tx_xyz=np.ones((8, 3)), receivers=np.ones((8, 3)), elements=np.ones((8, 3)))
    positions = find_positions(search, signal_of(search))
    names = {side: [info.name for info in infos] for side, infos in positions.items()}
    assert names == {"tx": ["tx_xyz"], "rx": ["receivers"], "antenna": ["elements"]}


def test_a_pose_is_taken_from_the_antennas_positions_and_components_by_their_words():
    search = search_in(vehicle_pos=np.ones((41, 3)), yaw=CLOCK, pitch_deg=CLOCK, speed=CLOCK)
    positions = find_positions(search, signal_of(search))
    components = find_pose(search, positions, SIZES, tones=200)
    names = {component: info.name for component, info in components.items()}
    assert names == {"position": "vehicle_pos", "heading": "yaw", "pitch": "pitch_deg"}
    assert positions == {}
    assert "speed" not in search.used


def test_longitude_and_latitude_stand_back_behind_places_in_the_lane():
    globe = {"lon": CLOCK, "lat": CLOCK}
    components = find_pose(search_in(**globe), {}, SIZES, tones=200)
    assert set(components) == {"longitude", "latitude"}
    components = find_pose(search_in(**globe, x=CLOCK, y=CLOCK), {}, SIZES, tones=200)
    assert set(components) == {"x", "y"}


def test_a_track_has_positions_and_a_clock_of_a_length_of_their_own():
    search = search_in(
        tx=np.ones((8, 3)),
        gps=np.ones((95, 3)),
        gps_stamp=np.arange(95.0),
        quaternion=np.ones((95, 4)),
    )
    positions = find_positions(search, signal_of(search))
    clock, position = find_track(search, positions, SIZES)
    assert (clock.name, position.name) == ("gps_stamp", "gps")
    assert set(positions) == {"tx"}
    assert find_rotation(search, position).name == "quaternion"
    assert find_track(search, positions, SIZES) is None
