"""A made-up result of a lane of the study wang2007."""

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.model import Lane
from flgpr_papers.wang2007.analysis import SUBBANDS, LaneResult

BANDS = ("F0", *SUBBANDS)


def fake_lane(name, seed):
    rng = np.random.default_rng(seed)
    lane = Lane(-1.5, 1.5, 0.0, 60.0)
    kinds = [
        "metal",
        "metal",
        "metal",
        "plastic",
        "plastic",
        "plastic",
        "plastic",
        "simulant",
        "simulant",
    ]
    truth = pd.DataFrame(
        {
            "target_id": [f"T{i}" for i in range(9)],
            "x": rng.uniform(-1, 1, 9),
            "y": 3 + 6.3 * np.arange(9),
            "kind": kinds,
            "depth": [-0.15, 0.05, 0.1, -0.15, 0.05, 0.05, 0.1, 0.05, 0.1],
        }
    )
    x = np.arange(-3, 3.01, 0.1)
    y = np.arange(0, 60.01, 0.1)
    values = rng.rayleigh(size=(3, 5, y.size, x.size)).astype(np.float32)
    for tx, ty in truth[["x", "y"]].to_numpy()[:7]:
        values[..., round(ty / 0.1), round((tx + 3) / 0.1)] += 3
    coords = {"polarization": ["HH", "VV", "HV"], "subband": list(BANDS), "y": y, "x": x}
    view = xr.DataArray(values, dims=("polarization", "subband", "y", "x"), coords=coords)
    near = truth[["x", "y"]].to_numpy() + rng.normal(0, 0.2, (9, 2))
    places = np.vstack([near, np.column_stack([rng.uniform(-3, 3, 120), rng.uniform(0, 60, 120)])])
    mine = np.arange(len(places)) < 7
    columns = [f"{p}{f}_{b}" for p in ("", "swapped.") for b in BANDS for f in FEATURES]
    columns += [f"shared.{f}_{b}" for b in BANDS for f in POLARIMETRIC]
    columns += [f"{gain}.P_psi_{b}" for gain in ("circular", "shared.linear") for b in BANDS]
    table = rng.gamma(2, size=(len(places), len(columns))) + 1.5 * mine[:, None] * rng.random(
        len(columns)
    )
    features = pd.DataFrame(table, columns=columns).assign(scans=3)
    features["C_HH_F1"] += 3 * mine
    features.loc[20, "P_H_F1"] = np.nan
    alarms = pd.DataFrame(places, columns=["x", "y"]).assign(
        magnitude=rng.gamma(3, size=len(places)) + mine
    )
    return LaneResult(
        name,
        lane,
        truth,
        alarms.assign(confidence=features["C_HH_F1"]),
        features,
        view,
        dict.fromkeys(("wide", "largest", "mean"), view[0, 1]),
    )
