"""Axes and attitudes of other instruments."""

import numpy as np
import pytest

from flgpr.formats.axes import attitude_of, axes_matrix

PLAIN = ("x", "y", "z")


def test_the_rows_are_the_axes_of_the_other_frame():
    """Of motion capture, whose y points up: our y is its -z, and our z its y."""
    matrix = axes_matrix(("x", "-z", "y"))
    np.testing.assert_array_equal(matrix @ [1.0, 2.0, 3.0], [1.0, -3.0, 2.0])
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))


@pytest.mark.parametrize(
    ("axes", "rule"),
    [
        (("x", "z", "y"), "pose.axes must be different and right-handed"),
        (("x", "x", "y"), "pose.axes must be different and right-handed"),
        (("x", "y"), "pose.axes must be different and right-handed"),
        (("x", "y", "up"), "pose.axes must be three of x, y, z, -x, -y and -z, got x, y, up"),
    ],
)
def test_axes_that_are_no_rotation_are_refused(axes, rule):
    with pytest.raises(ValueError, match=rule):
        axes_matrix(axes, "pose.axes")


def test_a_turn_about_the_vertical_is_the_heading():
    """Headings go clockwise from y to x, rotations about z the other way."""
    half = np.deg2rad(30) / 2
    quaternion = np.array([[0, 0, -np.sin(half), np.cos(half)]])
    np.testing.assert_allclose(
        attitude_of(5 * quaternion, PLAIN, PLAIN), [[np.deg2rad(30), 0, 0]], atol=1e-15
    )
    euler = attitude_of(np.array([[-np.deg2rad(30), 0, 0]]), PLAIN, PLAIN, "zyx")
    np.testing.assert_allclose(euler, [[np.deg2rad(30), 0, 0]], atol=1e-15)


def test_rotations_that_are_none_are_missing():
    rows = np.array([[0, 0, 0, 0.0], [np.nan, 0, 0, 1], [0, 0, 0, 2.0]])
    angles = attitude_of(rows, PLAIN, PLAIN)
    assert np.isnan(angles[:2]).all()
    np.testing.assert_allclose(angles[2], 0, atol=1e-15)
    assert attitude_of(rows[:0], PLAIN, PLAIN).shape == (0, 3)


@pytest.mark.parametrize("euler", ["xyy", "xYz", "xy"])
def test_orders_of_euler_angles_are_checked(euler):
    with pytest.raises(
        ValueError, match=f"track.euler must be x, y and z in some order, .*{euler}"
    ):
        attitude_of(np.zeros((1, 3)), PLAIN, PLAIN, euler, "track")


def test_the_width_follows_from_the_form():
    with pytest.raises(ValueError, match=r"orientation must have 4 columns, got shape \(1, 3\)"):
        attitude_of(np.zeros((1, 3)), PLAIN, PLAIN)


def test_the_axes_of_the_body_say_where_it_points():
    """A body whose x points forward, turned by nothing, heads along the lane's x."""
    ahead = attitude_of(np.array([[0.0, 0, 0, 1]]), PLAIN, ("-y", "x", "z"))
    np.testing.assert_allclose(ahead, [[np.pi / 2, 0, 0]], atol=1e-15)
