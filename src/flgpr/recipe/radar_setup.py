"""What a recipe depends on: channels, tones, array and course of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flgpr.model import aperture_pose, complete_scans, lane_to_scan, vehicle_to_scan
from flgpr.model.frames import steps_of
from flgpr.model.run import complete_scan_numbers, polarizations_of
from flgpr.types import FloatArray

Band = tuple[float, float]
FEWEST_SCANS = 5
"""Scans from which on their mean holds little of a target, and so is a self-signature."""
SCAN_SPACING = 0.5
"""Mean distance between such scans, m."""
_ALIKE = 0.95  # length of the mean of the headings' unit vectors of a radar that looks one way
# m, and array widths, that a radar goes across its course at least to be a synthetic aperture
_ACROSS = (0.5, 2.0)


@dataclass(frozen=True)
class RadarSetup:
    """What a recipe depends on: channels, tones, array and course of a run."""

    polarizations: list[str]
    tones: FloatArray  #: Hz
    tx: FloatArray  #: (pair, 3) transmitters in the scan frame, m
    rx: FloatArray  #: (pair, 3) receivers in the scan frame, m
    poses: FloatArray  #: (scan, 6) of the complete scans
    aperture: bool = False  #: whether the run is taken as one scan
    begins: bool = False  #: whether the scans are the beginning of a drive that goes on

    @property
    def height(self) -> float:
        """Mean height of the antennas, m."""
        return float((self.tx + self.rx)[:, 2].mean() / 2)

    @property
    def ahead(self) -> float:
        """Distance of the middle of the antennas ahead of the vehicle's reference point, m."""
        return float((self.tx + self.rx)[:, 1].mean() / 2)

    @property
    def step(self) -> float:
        """Step of the tones, Hz; zero of a single tone."""
        return float(np.median(np.diff(self.tones))) if self.tones.size > 1 else 0.0

    @property
    def scan_step(self) -> float:
        """Usual distance between scans, m; zero of a single scan."""
        steps = steps_of(self.poses)
        return float(np.median(steps)) if steps.size else 0.0

    @property
    def drives(self) -> bool:
        """Whether the mean scan is the self-signature rather than a blend of targets."""
        if self.begins:
            return True
        travelled = float(steps_of(self.poses).sum())
        enough_scans = len(self.poses) >= FEWEST_SCANS
        return enough_scans and travelled >= SCAN_SPACING * (FEWEST_SCANS - 1)

    def behind(self, frames: int) -> float:
        """Return how far the vehicle drives while an image gathers its last scans, m.

        The earliest of them lies so far behind the latest.
        """
        earlier = self.poses[: 1 - frames or None, :2]
        later = self.poses[frames - 1 :, :2]
        return float(np.hypot(*(later - earlier).T).max()) if len(later) else 0.0


def radar_setup(run: xr.Dataset, aperture: bool = False) -> RadarSetup:
    """Return what a recipe depends on.

    Parameters
    ----------
    run : xarray.Dataset
        The run, as it is imaged.
    aperture : bool
        Whether it is one scan of a whole run.

    Raises
    ------
    ValueError
        If no scan is complete.
    """
    poses = run["pose"].values[complete_scan_numbers(run)]
    pose = np.median(poses, axis=0)
    tx = vehicle_to_scan(run["tx_position"].values, pose)
    rx = vehicle_to_scan(run["rx_position"].values, pose)
    return RadarSetup(polarizations_of(run), run["frequency"].values, tx, rx, poses, aperture)


def goes_across(run: xr.Dataset) -> bool:
    """Return whether a radar moves past what it looks at, much farther than its array is wide."""
    pose = run["pose"].values[complete_scans(run)]
    if not len(pose):
        return False
    if abs(np.exp(1j * pose[:, 3]).mean()) < _ALIKE:  # there and back
        return False
    across, ahead = np.ptp(lane_to_scan(pose[:, :3], aperture_pose(run)), axis=0)[:2]
    widths = [float(np.ptp(run[f"{end}_position"].values[:, 0])) for end in ("tx", "rx")]
    least = max(_ACROSS[0], _ACROSS[1] * max(widths))
    return bool(across > least and across > 2 * ahead)


def allow_features(polarizations: Sequence[str]) -> bool:
    """Return whether polarimetric features can be computed: of HH, VV and HV or VH."""
    return {"HH", "VV"} <= set(polarizations) and bool({"HV", "VH"} & set(polarizations))
