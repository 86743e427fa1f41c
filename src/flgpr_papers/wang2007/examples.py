"""Scan images and patches that the figures show, taken while a lane's images are at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.lane_chain import CleanedRun
from flgpr.chain.recipe import Recipe
from flgpr.imaging import ScanImager
from flgpr.kernels.sampling import bilinear
from flgpr.model import lane_to_scan
from flgpr_papers.kit.cache import write_arrays

_AHEAD = 11.0  # m before the array at which an example target is shown
_CONSECUTIVE = 5


def save_examples(
    path: Path, cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, truth: pd.DataFrame, alarms: pd.DataFrame
) -> None:
    """Save the scan images and patches of Figs. 2-5, 8 and 10."""
    table = recipe.image
    imager = ScanImager(run, table.grid(), table.subbands, table.window, table.tolerance)
    chosen = example_targets(truth, alarms)
    arrays: dict[str, Any] = {
        "polarization": run["polarization"].values.astype(str),
        "subband": np.array(list(table.subbands)),
    }
    arrays |= {"x": imager.grid.x, "y": imager.grid.y, "near": cleaned.grid.ny}
    poses = run["pose"].values
    number = {int(scan): place for place, scan in enumerate(imager.scans)}
    for name, (x, y, _) in chosen.items():
        scan = _scan_before(imager, poses, y)
        image = imager.image(scan).values
        arrays[f"raw_{name}"] = np.abs(image).astype(np.float16 if image.max() == 0 else np.float32)
        arrays[f"clean_{name}"] = cleaned.whole_background.magnitude(image, cleaned.gains[number[scan]])
        arrays[f"place_{name}"] = lane_to_scan([x, y, 0.0], poses[scan])[:2]
        arrays[f"patches_{name}"], arrays[f"distances_{name}"] = _patches(cleaned, recipe, x, y)
    first = number[_scan_before(imager, poses, chosen["surface"][1])]
    first = max(0, min(first - 2, len(imager.scans) - _CONSECUTIVE))
    follow = [int(scan) for scan in imager.scans[first : first + _CONSECUTIVE]]
    hh, f1 = list(arrays["polarization"]).index("HH"), list(table.subbands).index(recipe.prescreen.subband)
    arrays["series"] = np.stack([np.abs(imager.image(scan).values[hh, f1]) for scan in follow])
    arrays["series_place"] = np.stack([lane_to_scan([*chosen["surface"][:2], 0.0], poses[scan])[:2] for scan in follow])
    arrays["signature"] = np.abs(cleaned.whole_background.signature[hh, f1])
    arrays["gain"] = cleaned.whole_background.gain[hh, f1]
    arrays["titles"] = np.array([f"{name}: {text}" for name, (_, _, text) in chosen.items()])
    write_arrays(path, arrays)


def example_targets(truth: pd.DataFrame, alarms: pd.DataFrame) -> dict[str, tuple[float, float, str]]:
    """Choose a surface plastic mine, a deep metal one, a shallow plastic one and a false alarm.

    Place (m) and description by "surface", "metal", "plastic" and "false"; the nearest of the kind in the table.
    """
    mines = truth[truth["kind"].isin(["metal", "plastic"])]
    plastic, metal = (mines[mines["kind"] == kind] for kind in ("plastic", "metal"))
    wanted = {"surface": (plastic, -1.0), "metal": (metal, 1.0), "plastic": (plastic[plastic["depth"] > 0], 0.05)}
    found = {}
    for name, (table, depth) in wanted.items():
        table = table if len(table) else mines
        row = table.iloc[int((table["depth"] - depth).abs().argmin())]
        where = "on the surface" if row["depth"] < 0 else f"{100 * row['depth']:.0f} cm deep"
        found[name] = (float(row["x"]), float(row["y"]), f"{row['kind']} mine {where}")
    away = np.hypot(*(alarms[axis].to_numpy()[:, None] - truth[axis].to_numpy()[None] for axis in ("x", "y")))
    free = alarms[(away.min(axis=1) > 2) & (alarms["x"].abs() < 1.5)]
    best = (free if len(free) else alarms).sort_values("confidence", ascending=False).iloc[0]
    found["false"] = (float(best["x"]), float(best["y"]), "strongest false alarm")
    return found


def _scan_before(imager: ScanImager, poses: NDArray[np.float64], y: float) -> int:
    ahead = y - poses[imager.scans, 1]
    return int(imager.scans[int(np.argmin(np.abs(ahead - _AHEAD)))])


def _patches(cleaned: CleanedRun, recipe: Recipe, x: float, y: float) -> tuple[NDArray[np.float32], NDArray[Any]]:
    """Incoherent patches (scan, polarization, subband, y, x) of all scans that count, from near to far."""
    grid, offsets, poses = cleaned.grid, recipe.contrast.patch().offsets(), cleaned.imager.run["pose"].values
    found, distances = [], []
    for place, scan in enumerate(cleaned.imager.scans):
        local = lane_to_scan([x, y, 0.0], poses[scan])[:2]
        if not grid.y_min <= local[1] <= recipe.run_view.y_max:
            continue
        magnitude = cleaned.background.magnitude(cleaned.imager.image(int(scan)).values, cleaned.gains[place])
        row = (local[1] + offsets[..., 1] - grid.y_min) / grid.dy
        found.append(bilinear(magnitude, row, (local[0] + offsets[..., 0] - grid.x_min) / grid.dx))
        distances.append(local[1])
    order = np.argsort(distances)
    return np.stack(found)[order].astype(np.float32), np.asarray(distances)[order]
