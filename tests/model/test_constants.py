"""Physical constants, and the names that tables and runs keep to."""

import itertools

import scipy.constants

from flgpr.model.constants import AXES, POLARIZATIONS, POSE_COMPONENTS, SPEED_OF_LIGHT


def test_the_speed_of_light_is_that_of_vacuum():
    assert scipy.constants.c == SPEED_OF_LIGHT


def test_polarizations_are_all_pairs_of_what_is_sent_and_received():
    assert {send + receive for send, receive in itertools.product("HV", "HV")} == set(POLARIZATIONS)
    assert len(POLARIZATIONS) == 4


def test_a_pose_begins_with_the_axes(small_run):
    assert POSE_COMPONENTS[:3] == AXES
    assert small_run["pose"].shape[-1] == len(POSE_COMPONENTS)
