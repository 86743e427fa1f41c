"""Alarms followed over frames, as far as the abstract of the sequel tells it.

Fuse, Rostami, Gonzalez-Valdes & Rappaport, "False alarm reduction by target tracking for forward looking ground
penetrating radar", Ground Penetrating Radar 1(2), 2018: buried objects stand still while the platform advances, so that
images cleaned of clutter are compared by the system's positions and what does not stay is taken for clutter. Gate and
number of frames are ours.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray


def follow(alarms: pd.DataFrame, gate: float, hits: int) -> pd.DataFrame:
    """Join the alarms of frames into tracks that stand still in the lane frame.

    Frame by frame each alarm, strongest first, continues the nearest track within the gate that has none of this frame
    yet, or begins one; a track stands at the mean of its alarms, weighed by magnitude. Its confidence is the
    ``hits``-th largest of its magnitudes: at a threshold are declared the tracks of which so many frames exceed it.

    ``alarms`` has frame, x, y (m, lane frame) and magnitude; ``gate`` is in m. The table has x, y, confidence and
    frames; tracks of fewer frames than ``hits`` are left out.
    """
    tracks: list[list[NDArray[np.float64]]] = []
    for _, frame in alarms.sort_values("magnitude", ascending=False, kind="stable").groupby("frame", sort=True):
        old = np.array([_place(track) for track in tracks]).reshape(-1, 2)
        free = np.ones(len(old), dtype=bool)
        for one in frame[["x", "y", "magnitude"]].to_numpy(dtype=np.float64):
            away = np.where(free, np.hypot(*(old - one[:2]).T), np.inf)
            if away.size and away.min() <= gate:
                nearest = int(away.argmin())
                tracks[nearest].append(one)
                free[nearest] = False
            else:
                tracks.append([one])
    kept = [track for track in tracks if len(track) >= hits]
    rows = [(*_place(track), np.sort([m for *_, m in track])[-hits], len(track)) for track in kept]
    return pd.DataFrame(rows, columns=["x", "y", "confidence", "frames"])


def _place(track: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    points = np.array(track)
    return np.asarray(np.average(points[:, :2], axis=0, weights=points[:, 2]))
