"""Poses, run-views, alarms and maps as messages that Foxglove shows, with their JSON schemas.

Names and fields are those of https://docs.foxglove.dev/docs/sdk/schemas, whose JSON form is in
``schemas/jsonschema`` of https://github.com/foxglove/foxglove-sdk. A program that reads such
messages knows them by the name of the schema. Only fields that are written here are declared, and
all that the schemas require are.

Places are in the lane frame, named ``lane``: x cross-track to the right, y down-track, z up, m. The
frame ``vehicle`` lies at the array's reference point. Its axes are those of ROS (REP 103), x ahead,
y to the left, z up, because programs draw a pose as an arrow along its x.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.json_text import compact_json, parse_json
from flgpr.model.frames import pose_matrix

LANE_FRAME = "lane"
VEHICLE_FRAME = "vehicle"
SHOWN_DB = 25.0
"""Range of the greys of a run-view, dB above its median; assumed, for display alone."""
_NANOSECONDS = 10**9
_AXES_OF_ROS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Axes of ROS (columns) in the vehicle frame: ahead is +y, to the left is -x."""
_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_FLOAT32 = 7
_UINT8 = 1
_DELETE_THIS_ID = 0
_MARKER = 0.3  # m, diameter of the marker of an alarm; it states no size of what lies there
_LABEL_HEIGHT = 0.5  # m above the ground
_FONT_SIZE = 14.0  # pixels of the screen
_ALARM_COLOUR = (1.0, 0.6, 0.0)
_TOO_NEAR_COLOUR = (0.9, 0.1, 0.1)
_CELL = np.dtype([("db", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")])

Message = dict[str, Any]
Schema = dict[str, Any]

_UNUSED_PRIMITIVES = ("arrows", "cubes", "cylinders", "lines", "triangles", "models")
"""Members that every entity of a scene must have, and that are empty here."""
SCHEMAS: dict[str, Schema] = parse_json(
    (resources.files("flgpr_exchange.bags") / "schemas.json").read_bytes()
)
"""JSON schemas of the messages, by name."""


def pose_message(nanoseconds: int, pose: ArrayLike) -> Message:
    """Return a pose of the vehicle as ``foxglove.PoseInFrame``.

    Parameters
    ----------
    nanoseconds : int
        Time, ns since 1970.
    pose : (6,) array_like
        x, y, z, m, and heading, pitch, roll, rad, in the lane frame.

    Returns
    -------
    dict
        The message.
    """
    pose_of_vehicle = {"position": _position(pose), "orientation": _orientation(pose)}
    return {**_in_lane(nanoseconds), "pose": pose_of_vehicle}


def transform_message(nanoseconds: int, pose: ArrayLike) -> Message:
    """Return a pose of the vehicle as ``foxglove.FrameTransform`` from lane to vehicle.

    Parameters are those of :func:`pose_message`.
    """
    return {
        "timestamp": _time(nanoseconds),
        "parent_frame_id": LANE_FRAME,
        "child_frame_id": VEHICLE_FRAME,
        "translation": _position(pose),
        "rotation": _orientation(pose),
    }


def grid_message(
    nanoseconds: int,
    decibels: NDArray[np.floating[Any]],
    first: tuple[float, float],
    spacing: tuple[float, float],
    median_db: float,
) -> Message:
    """Return a run-view as ``foxglove.Grid``.

    Parameters
    ----------
    nanoseconds : int
        Time, ns since 1970.
    decibels : (y, x) ndarray of float
        dB over the background; NaN where no scan looked.
    first : tuple of float
        x and y of the centre of the first pixel, m.
    spacing : tuple of float
        Distance between pixels along x and y, m.
    median_db : float
        Level that is shown black, dB.

    Returns
    -------
    dict
        The message. Every cell has ``db`` (float) and a grey in ``red``, ``green``, ``blue`` and
        ``alpha``, which is 0 where no scan looked.
    """
    is_measured = np.isfinite(decibels)
    levels = np.clip((np.where(is_measured, decibels, median_db) - median_db) / SHOWN_DB, 0.0, 1.0)
    cells = np.zeros(decibels.shape, _CELL)
    cells["db"] = decibels
    for name in ("red", "green", "blue"):
        cells[name] = np.round(255 * levels)
    cells["alpha"] = np.where(is_measured, 255, 0)
    columns = decibels.shape[1]
    # The message places the outer corner of the first cell, not its centre.
    corner = _xyz(first[0] - spacing[0] / 2, first[1] - spacing[1] / 2, 0.0)
    return {
        **_in_lane(nanoseconds),
        "pose": {"position": corner, "orientation": _NO_TURN},
        "column_count": columns,
        "cell_size": {"x": spacing[0], "y": spacing[1]},
        "row_stride": columns * _CELL.itemsize,
        "cell_stride": _CELL.itemsize,
        "fields": _fields(),
        "data": base64.b64encode(cells.tobytes()).decode("ascii"),
    }


def alarms_message(
    nanoseconds: int, alarms: Sequence[Mapping[str, Any]], withdrawn: Sequence[str] = ()
) -> Message:
    """Return alarms that are new or changed, and those withdrawn, as ``foxglove.SceneUpdate``.

    Parameters
    ----------
    nanoseconds : int
        Time, ns since 1970.
    alarms : sequence of mapping
        ``alarm_id``, ``x``, ``y`` (m, lane frame) and ``confidence``; ``in_time``, false for one
        that the vehicle cannot stop before; all members but x and y are kept as metadata.
    withdrawn : sequence of str
        Alarms that no longer stand.

    Returns
    -------
    dict
        The message.
    """
    time = _time(nanoseconds)
    deletions = [{"timestamp": time, "type": _DELETE_THIS_ID, "id": one} for one in withdrawn]
    return {"deletions": deletions, "entities": [_entity(nanoseconds, one) for one in alarms]}


def geojson_message(alarms: Sequence[Mapping[str, Any]], statement: str) -> Message:
    """Return alarms as points of a map, as ``foxglove.GeoJSON``.

    Parameters
    ----------
    alarms : sequence of mapping
        ``longitude`` and ``latitude`` (WGS 84, degrees); all other members are properties.
    statement : str
        What the points are and are not.

    Returns
    -------
    dict
        The message, a feature collection as RFC 7946 has it, which replaces earlier ones.
    """
    features = []
    for alarm in alarms:
        properties = dict(alarm)
        place = [properties.pop(name) for name in ("longitude", "latitude")]
        geometry = {"type": "Point", "coordinates": place}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    collection = {"type": "FeatureCollection", "statement": statement, "features": features}
    return {"geojson": compact_json(collection)}


def _time(nanoseconds: int) -> dict[str, int]:
    """Return a time in seconds and nanoseconds."""
    seconds, rest = divmod(nanoseconds, _NANOSECONDS)
    return {"sec": seconds, "nsec": rest}


def _in_lane(nanoseconds: int) -> Message:
    """Return the members of a message that has a time and is in the lane."""
    return {"timestamp": _time(nanoseconds), "frame_id": LANE_FRAME}


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    """Return a place."""
    return {"x": x, "y": y, "z": z}


def _position(pose: ArrayLike) -> dict[str, float]:
    """Return the position of a pose."""
    return _xyz(*np.asarray(pose, np.float64)[:3].tolist())


def _orientation(pose: ArrayLike) -> dict[str, float]:
    """Return the attitude of a pose as the turn from lane axes to those of ROS."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose_matrix(pose) @ _AXES_OF_ROS).as_quat(canonical=True)
    return dict(zip("xyzw", turn.tolist(), strict=True))


def _fields() -> list[dict[str, Any]]:
    """Return the fields of a cell of a grid."""
    fields = []
    for name in _CELL.names or ():
        kind, offset = _CELL.fields[name][:2]  # type: ignore[index]
        number = _FLOAT32 if kind.kind == "f" else _UINT8
        fields.append({"name": name, "offset": offset, "type": number})
    return fields


def _entity(nanoseconds: int, alarm: Mapping[str, Any]) -> Message:
    """Return an alarm as a marker with its confidence, which replaces one of the same name."""
    x = float(alarm["x"])
    y = float(alarm["y"])
    is_too_near = alarm.get("in_time") is False
    red, green, blue = _TOO_NEAR_COLOUR if is_too_near else _ALARM_COLOUR
    colour = {"r": red, "g": green, "b": blue, "a": 1.0}
    marker = {
        "pose": {"position": _xyz(x, y, 0.0), "orientation": _NO_TURN},
        "size": _xyz(_MARKER, _MARKER, _MARKER),
        "color": colour,
    }
    label = {
        "pose": {"position": _xyz(x, y, _LABEL_HEIGHT), "orientation": _NO_TURN},
        "billboard": True,
        "font_size": _FONT_SIZE,
        "scale_invariant": True,
        "color": colour,
        "text": f"{alarm['confidence']:.3g}",
    }
    kept = {name: value for name, value in alarm.items() if name not in ("alarm_id", "x", "y")}
    return {
        **_in_lane(nanoseconds),
        "id": str(alarm["alarm_id"]),
        "lifetime": {"sec": 0, "nsec": 0},  # it stays until it is replaced or deleted
        "frame_locked": False,
        "metadata": [{"key": name, "value": str(value)} for name, value in kept.items()],
        "spheres": [marker],
        "texts": [label],
        **{name: [] for name in _UNUSED_PRIMITIVES},
    }
