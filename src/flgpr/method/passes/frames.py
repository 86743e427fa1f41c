"""Alarms on every scan's image, for recipes that score by frames (Fuse et al. 2018, Sec. 4)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from flgpr.engine import concatenate
from flgpr.method.imaged_run import ImagedRun, table_arrays
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.screen import frame_alarms
from flgpr.types import AnyArray, Arrays, FloatArray


class FrameAlarms(Pass):
    """The local maxima of every scan's image, once it sums as many scans as the recipe wants.

    The result holds ``frame``, ``pose`` and ``count`` (the number of its alarms) for every frame,
    and ``x``, ``y`` (m, scan frame) and ``magnitude`` for every alarm, frame after frame.
    """

    name = "frames"
    title = "alarms of every frame"
    needs = ("gain",)
    all_scans = True

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        screen = lane.recipe.prescreen
        labels = lane.labels()
        polarization = labels["polarization"].index(screen.polarization)
        subband = labels["subband"].index(screen.subband)
        self._channel = (polarization, subband)
        self._frames: list[Arrays] = []

    def add(self, scan: ImagedScan) -> None:
        """Add the alarms of a scan's image."""
        if scan.index + 1 >= self.lane.setup.summed:
            self._frames.append(self._raise(scan))

    def _raise(self, scan: ImagedScan) -> Arrays:
        """Return the alarms of a scan's image, with the scan's number and pose."""
        recipe = self.lane.recipe
        magnitude = scan.magnitude()[self._channel]
        grid = self.lane.near
        alarms = frame_alarms(magnitude, grid, recipe.frame_area(), recipe.prescreen.radius)
        frame: Arrays = {
            "frame": np.array([scan.index]),
            "pose": scan.pose[None],
            "count": np.array([len(alarms)]),
        }
        return frame | table_arrays(alarms[["x", "y", "magnitude"]])

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the alarms so far, by frame."""
        return concatenate(self._frames)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Append the alarms of the block that follows."""
        if state:
            self._frames.append(dict(state))

    def result(self) -> Arrays:
        """Return the alarms of all frames."""
        return concatenate(self._frames)


def alarms_by_frame(lane: ImagedRun) -> tuple[pd.DataFrame, dict[int, FloatArray]]:
    """Return the alarms of all frames, and the pose of each frame by its number.

    Needs the result of the pass "frames".

    Returns
    -------
    alarms : DataFrame
        ``frame``, ``across`` and ``ahead`` (m, scan frame), ``confidence``.
    poses : dict
        Pose (6,) by frame.
    """
    arrays = lane.results["frames"]
    alarms = pd.DataFrame(
        {
            "frame": np.repeat(arrays["frame"], arrays["count"]),
            "across": arrays["x"],
            "ahead": arrays["y"],
            "confidence": arrays["magnitude"],
        }
    )
    poses = dict(zip(arrays["frame"].tolist(), arrays["pose"], strict=True))
    return alarms, poses
