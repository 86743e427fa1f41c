"""Axes and attitudes of other instruments: motion capture, robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flgpr.model.frames import attitude_angles
from flgpr.types import FloatArray


def axes_matrix(axes: Sequence[str], where: str = "axes") -> FloatArray:
    """Return the rotation to x, y and z from another right-handed frame.

    Parameters
    ----------
    axes : (3,) sequence of str
        Which axes of the other frame are x, y and z, such as ``("x", "-z", "y")``.
    where : str
        Name of the entry in an error.

    Returns
    -------
    (3, 3) ndarray
        Takes columns of the other frame to x, y and z.

    Raises
    ------
    ValueError
        If the axes are not three different ones, or not right-handed.
    """
    matrix = np.zeros((3, 3))
    for row, axis in zip(matrix, axes, strict=False):
        letter = axis.strip().lower().lstrip("+-")
        if letter not in ("x", "y", "z"):
            raise ValueError(
                f"{where} must be three of x, y, z, -x, -y and -z, got {', '.join(axes)}"
            )
        sign = -1.0 if axis.strip().startswith("-") else 1.0
        row["xyz".index(letter)] = sign
    if len(axes) != 3 or not np.isclose(np.linalg.det(matrix), 1.0):
        raise ValueError(
            f"{where} must be different and right-handed, such as x, -z, y, got {', '.join(axes)}"
        )
    return matrix


def attitude_of(
    rotations: FloatArray,
    axes: Sequence[str],
    body: Sequence[str],
    euler: str | None = None,
    where: str = "orientation",
) -> FloatArray:
    """Compute heading, pitch and roll of rotations from a body's axes to its instrument's.

    Parameters
    ----------
    rotations : (n, 4) or (n, 3) ndarray
        Quaternions x, y, z, w of any length, or with ``euler`` Euler angles, rad.
    axes : (3,) sequence of str
        Which axes of the instrument are the lane's x, y and z.
    body : (3,) sequence of str
        Which axes of the body are the vehicle's x, y and z.
    euler : str, optional
        Order of the Euler angles: "XYZ" about the body's turned axes, "xyz" about fixed ones.
    where : str
        Name of the entry in an error.

    Returns
    -------
    (n, 3) ndarray
        Heading, pitch and roll, rad; NaN where a rotation is not finite or a quaternion is zero.

    Raises
    ------
    ValueError
        If the shape, the order of the Euler angles or the axes break their rule.
    """
    from scipy.spatial.transform import Rotation

    width = 4 if euler is None else 3
    if rotations.ndim != 2 or rotations.shape[1] != width:
        raise ValueError(f"{where} must have {width} columns, got shape {rotations.shape}")
    if euler is not None:
        has_each_axis = sorted(euler.lower()) == ["x", "y", "z"]
        is_one_case = euler in (euler.upper(), euler.lower())
        if not (has_each_axis and is_one_case):
            raise ValueError(
                f"{where}.euler must be x, y and z in some order, all large or all small, "
                f"got {euler!r}"
            )

    angles = np.full((len(rotations), 3), np.nan)
    size = np.abs(rotations).max(axis=1, initial=0.0)
    usable = np.isfinite(size)
    if euler is None:
        usable &= size > 0  # a zero quaternion is how recorders say that they have none
    if not usable.any():
        return angles
    if euler is None:
        turned = Rotation.from_quat(rotations[usable] / size[usable, None])
    else:
        turned = Rotation.from_euler(euler, rotations[usable])
    matrix = axes_matrix(axes) @ turned.as_matrix() @ axes_matrix(body, f"{where}.body").T
    angles[usable] = attitude_angles(matrix)
    return angles
