"""A long lane for the viewer: speckle, mines and alarms of known places, written as detection writes them."""

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.method.detection import Detection
from flgpr.model import Lane
from flgpr.recipe.schema import recipe_text
from flgpr.results.result import add_files, read_result, write_result
from flgpr.results.score import score_detections, view_score
from flgpr.store.view_format import VIEW_SCORE

POLARIZATIONS = ["HH", "VV"]
SUBBANDS = ["0.4-1.1", "1.1-1.7"]


def speckle(rng, shape, x, y, peaks, level):
    """Rayleigh noise with blobs of ``level`` dB; the same place in every channel."""
    values = rng.rayleigh(1.0, shape).astype(np.float32)
    for px, py in peaks:
        rows = np.flatnonzero(np.abs(y - py) < 1.5)
        blob = np.exp(-((x - px) ** 2) / 0.06 - ((y[rows, None] - py) ** 2) / 0.12)
        values[..., rows, :] += (10 ** (level / 20) * blob).astype(np.float32)
    return values


def truth_table(rng, count, length):
    kinds = np.array(["metal", "plastic", "simulant"])[np.arange(count) % 3]
    return pd.DataFrame(
        {
            "target_id": [f"t{i + 1}" for i in range(count)],
            "x": rng.uniform(-2.0, 2.0, count).round(2),
            "y": np.linspace(12, length - 12, count).round(2),
            "kind": kinds,
            "depth": np.array([0.0, 0.05, 0.1, 0.15])[np.arange(count) % 4],
        }
    )


def alarm_table(rng, truth, count, length):
    hit = rng.random(len(truth)) < 0.85
    places = truth[hit]
    extra = count - len(places)
    x = np.append(places["x"] + rng.normal(0, 0.1, len(places)), rng.uniform(-2.9, 2.9, extra))
    y = np.append(places["y"] + rng.normal(0, 0.1, len(places)), rng.uniform(2, length - 2, extra))
    confidence = np.append(rng.normal(8, 2.5, len(places)), rng.normal(3, 1.5, extra))
    table = pd.DataFrame({"x": x.round(2), "y": y.round(2), "confidence": confidence})
    table = table.sort_values("confidence", ascending=False, kind="stable", ignore_index=True)
    table.insert(0, "alarm_id", [f"alarm-{i + 1}" for i in range(count)])
    return table


def make_long_lane(folder, rows=12_000, seed=3, alarms=900, title="long lane", truth=None):
    rng = np.random.default_rng(seed)
    length = 0.1 * rows
    x = np.round(-2.95 + 0.1 * np.arange(60), 9)
    y = np.round(0.05 + 0.1 * np.arange(rows), 9)
    if truth is None:
        truth = truth_table(np.random.default_rng(1), max(rows // 150, 2), length)
    table = alarm_table(rng, truth, alarms, length)
    peaks = truth[["x", "y"]].to_numpy()
    shape = (len(POLARIZATIONS), len(SUBBANDS), rows, 60)

    def view(level):
        coords = {"polarization": POLARIZATIONS, "subband": SUBBANDS, "y": y, "x": x}
        coords["looks"] = (("y", "x"), np.full((rows, 60), 5))
        values = speckle(rng, shape, x, y, peaks, level)
        return xr.DataArray(values, dims=("polarization", "subband", "y", "x"), coords=coords)

    share = rng.normal(0, 1, (alarms, 3))
    share += (table["confidence"].to_numpy() - share.sum(axis=1))[:, None] / 3
    names = ["C_HH", "M_VV", "P_alpha"]
    features = pd.DataFrame(share + rng.normal(0, 0.3, share.shape), columns=names)
    training = pd.DataFrame(
        rng.normal(0, 1, (400, 3)) + 2 * (np.arange(400) < 150)[:, None], columns=names
    )
    training["label"] = np.where(np.arange(400) < 150, "hit", "false alarm")
    detection = Detection(
        "main",
        title,
        table,
        view(22),
        channel=("HH", SUBBANDS[0]),
        features=features,
        contributions=pd.DataFrame(share, columns=names),
        training=training,
        before=view(14),
    )
    pose = np.zeros((rows // 20, 6))
    pose[:, 1] = 2.0 * np.arange(len(pose)) - 10
    pose[:, 2] = 5.0
    run = {"title": title, "pose": pose.tolist(), "masked_scans": [3], "scans": len(pose)}
    run["georeference"] = {"latitude": 48.0, "longitude": 11.0, "azimuth": 90.0}
    lane = Lane(-2.5, 2.5, 5.0, length - 5)
    write_result(folder, [detection], recipe_text("demo"), lane, run)
    result = read_result(folder)
    add_files(result.folder, {VIEW_SCORE: view_score(result, score_detections(result, truth))})
    return folder
