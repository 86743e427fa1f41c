"""``flgpr calibrate poses`` on waves that gprMax computed, declared in ``pose_full_wave.toml``.

``python evidence/pose_full_wave.py`` takes the tones of ``full_wave_tones/`` and prints the errors of the poses from
scan to scan, before and after.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from flgpr.calibrate import focus_poses
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from full_wave_lanes import array_of, decks_of, declared, run_of
from pose_focus import against_next

AHEAD = 2.4  # antenna heights, of the middle of the ground that is looked at


def main() -> None:
    """Focus the poses, and print what is wrong with them before and after."""
    common = declared(Path(__file__).with_suffix(".toml"))
    (lane,) = common["lanes"]
    run = run_of(lane, decks_of(common, lane, array_of(common)).manifest)
    true = run["pose"].values
    pose = true.copy()
    pose[:, 1] = common["reported"]
    searched = subtract_mean_scan(run).assign(pose=(run["pose"].dims, pose))
    sight = np.array([0.0, AHEAD, -1.0]) / math.hypot(AHEAD, 1.0)
    for polarizations in (["VV"], ["VH", "VV"]):
        fit = focus_poses(searched.sel(polarization=polarizations), ImagingOperator)
        before, after = ((one - true)[:, :3] for one in (pose, fit.pose))
        print(
            f"{' '.join(polarizations)}: {1e3 * against_next(before, sight):.1f} mm before, "
            f"{1e3 * against_next(after, sight):.1f} mm after; told {1e3 * fit.before:.1f} and "
            f"{1e3 * fit.after:.1f} mm, {fit.alike} of {fit.pairs} pairs alike {fit.doubt}"
        )
        print("  along, mm:", (1e3 * before[:, 1]).round(1), (1e3 * after[:, 1]).round(1))
        over = (after / fit.sigma)[:, 1]
        print(f"  along, over its deviation: {np.sqrt(np.mean(over**2)):.1f}")


if __name__ == "__main__":
    main()
