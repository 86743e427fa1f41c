"""``flgpr calibrate poses`` on waves that gprMax computed, declared in ``pose_full_wave.toml``.

``python evidence/pose_full_wave.py`` takes the tones of ``full_wave_tones/`` and prints the errors of the poses from
scan to scan, before and after, with the mean of the scans left out and with the scans as they are. ``--twins N`` does
the same on N drives over such ground that flgpr simulates.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.calibrate import focus_poses
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from flgpr.simulate import simulate
from full_wave_lanes import array_of, decks_of, declared, run_of, scene_of
from pose_focus import against_next, with_pose

AHEAD = 2.4  # antenna heights, of the middle of the ground that is looked at


def tell(label: str, run: xr.Dataset, reported: list[float]) -> None:
    """Focus the poses of a run whose places along the lane are reported wrongly; print what is wrong."""
    sight = np.array([0.0, AHEAD, -1.0]) / math.hypot(AHEAD, 1.0)
    true = run["pose"].values
    pose = true.copy()
    pose[:, 1] = reported
    for words, searched in {"mean left out": subtract_mean_scan(run), "as it is": run}.items():
        posed = with_pose(searched.sel(polarization=["VV"]), pose)
        fit = focus_poses(posed, ImagingOperator)
        before, after = ((one - true)[:, :3] for one in (pose, fit.pose))
        print(
            f"{label}, {words}: {1e3 * against_next(before, sight):.1f} mm before, "
            f"{1e3 * against_next(after, sight):.1f} mm after, told {1e3 * fit.after:.1f} mm; "
            f"{fit.alike} of {fit.pairs} pairs alike {fit.doubt}",
            "  along, mm:",
            (1e3 * before[:, 1]).round(1),
            (1e3 * after[:, 1]).round(1),
        )


def main() -> None:
    """Focus the poses of the drive, and of its twins."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=0)
    given = parser.parse_args()
    common = declared(Path(__file__).with_suffix(".toml"))
    (lane,) = common["lanes"]
    sensor = array_of(common)
    tell("gprMax", run_of(lane, decks_of(common, lane, sensor).manifest), common["reported"])
    for seed in range(lane["seed"], lane["seed"] + given.twins):
        tell(f"twin {seed}", simulate(scene_of(common, lane), sensor, seed)[0], common["reported"])


if __name__ == "__main__":
    main()
