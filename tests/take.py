"""A take of OptiTrack Motive as it exports one."""

import numpy as np

UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Takes the room's axes, y up, to those of a lane along -z."""


def take_text(time, position, rotation, lost=(), spin="Quaternion"):
    """CSV of a take with the bodies Cart, lost in some frames, and Pole, which stands, and a marker; lengths in mm."""
    axes = "XYZW" if spin == "Quaternion" else spin
    width = len(axes)
    bodies = ["Cart"] * (width + 4) + ["Pole"] * (width + 4) + ["Cart:1"] * 3
    kinds = ["Rigid Body"] * 2 * (width + 4) + ["Rigid Body Marker"] * 3
    groups = (["Rotation"] * width + ["Position"] * 3 + ["Mean Marker Error"]) * 2 + [
        "Position"
    ] * 3
    about = [
        "Format Version",
        "1.23",
        "Take Name",
        "drive",
        "Export Frame Rate",
        "4.000000",
        "Rotation Type",
        spin,
    ]
    lines = [
        ",".join([*about, "Length Units", "Millimeters", "Coordinate Space", "Global"]),
        "",
        ",".join(["", "Type", *kinds]),
        ",".join(["", "Name", *bodies]),
        ",".join(["", "ID", *(["7"] * len(bodies))]),
        ",".join(["", "", *groups]),
        ",".join(["Frame", "Time (Seconds)", *([*axes, "X", "Y", "Z", ""] * 2), "X", "Y", "Z"]),
    ]
    still = [*([0] * (width - 1)), 1 if width == 4 else 0, 0, 0, 0, 0.1]
    for k, now in enumerate(time):
        seen = [*rotation[k], *position[k], 0.1]
        cells = [
            *([""] * len(seen) if k in lost else [f"{value:.6f}" for value in seen]),
            *map(str, still),
            1,
            2,
            3,
        ]
        lines.append(",".join([str(k), f"{now:.6f}", *map(str, cells)]))
    return "\n".join(lines) + "\n"
