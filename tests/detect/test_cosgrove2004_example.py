"""The example of docs/evidence/papers/cosgrove2004.md runs as printed."""

import re
from pathlib import Path

import numpy as np
import xarray as xr

DOC = Path(__file__).parents[2] / "docs" / "evidence" / "papers" / "cosgrove2004.md"


def test_example_trains_and_finds_its_own_mines(tmp_path, monkeypatch):
    rng = np.random.default_rng(4)
    shape = (2, 400, 60)
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    points = np.array([[0.5, 1.5], [1.5, 3.0], [2.4, 5.0], [1.0, 6.5]])
    for x, y in points:
        row = round(y / 0.02)
        column = round(x / 0.05)
        values[:, row - 8, column] += 9
        values[:, row + 8, column] += 9
    axes = {"polarization": ["HH", "VV"], "y": 0.02 * np.arange(400), "x": 0.05 * np.arange(60)}
    image = xr.DataArray(values, dims=("polarization", "y", "x"), coords=axes)
    code = re.findall(r"```python\n(.*?)```", DOC.read_text(encoding="utf-8"), re.DOTALL)[-1]
    monkeypatch.chdir(tmp_path)
    space = {"np": np, "image": image, "points": points}
    exec(code, space)
    likelihood = space["likelihood"]
    best = np.unravel_index(
        np.argsort(np.nan_to_num(likelihood, nan=-np.inf).ravel())[-4:], likelihood.shape
    )
    found = {(round(0.05 * c, 1), round(0.02 * r)) for r, c in zip(*best, strict=True)}
    assert len(found) >= 2
    for x, y in found:
        assert min(np.hypot(px - x, py - y) for px, py in points) < 0.6
