"""Axes and attitudes of other instruments: motion capture, robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flgpr.model.frames import attitude_angles

FloatArray = NDArray[np.float64]


def axes_matrix(axes: Sequence[str], where: str = "axes") -> FloatArray:
    """Matrix (3, 3) to axes x, y, z that are ``axes`` of another right-handed frame, such as ``("x", "-z", "y")``."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=False):
        name = axis.strip().lower().lstrip("+-")
        if name not in ("x", "y", "z"):
            raise ValueError(
                f"{where} must be three of x, y, z, -x, -y and -z, got {', '.join(axes)}"
            )
        row["xyz".index(name)] = -1.0 if axis.strip().startswith("-") else 1.0
    if len(axes) != 3 or not np.isclose(np.linalg.det(rows), 1.0):
        raise ValueError(
            f"{where} must be different and right-handed, such as x, -z, y, got {', '.join(axes)}"
        )
    return rows


def attitude_of(
    parts: FloatArray,
    axes: Sequence[str],
    body: Sequence[str],
    euler: str | None = None,
    where: str = "orientation",
) -> FloatArray:
    """Heading, pitch and roll (n, 3), rad, of rotations from a body's axes to those of its instrument.

    ``parts`` are quaternions (n, 4) x, y, z, w of any length, or Euler angles (n, 3), rad, in the order ``euler``
    ("XYZ" about the body's turned axes, "xyz" about fixed ones). ``axes`` are the instrument's axes that are the lane's
    x, y and z, ``body`` those of the body that are the vehicle's. What is not finite stays so.
    """
    from scipy.spatial.transform import Rotation

    width = 4 if euler is None else 3
    if parts.ndim != 2 or parts.shape[1] != width:
        raise ValueError(f"{where} must have {width} columns, got shape {parts.shape}")
    if euler is not None and (
        sorted(euler.lower()) != ["x", "y", "z"] or euler not in (euler.upper(), euler.lower())
    ):
        raise ValueError(
            f"{where}.euler must be x, y and z in some order, all large or all small, got {euler!r}"
        )
    angles = np.full((len(parts), 3), np.nan)
    size = np.abs(parts).max(axis=1, initial=0.0)
    good = np.isfinite(size)
    if euler is None:
        good &= size > 0  # a zero quaternion is how recorders say that they have none
        turned = Rotation.from_quat(parts[good] / size[good, None]) if good.any() else None
    else:
        turned = Rotation.from_euler(euler, parts[good]) if good.any() else None
    if turned is not None:
        matrix = axes_matrix(axes) @ turned.as_matrix() @ axes_matrix(body, f"{where}.body").T
        angles[good] = attitude_angles(matrix)
    return angles
