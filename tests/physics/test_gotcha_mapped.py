"""The measured X-band phase history imported by its mapping alone gives the same image as read by hand."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from flgpr.formats import import_mapped
from flgpr.imaging import ImagingOperator

MAPPING = Path(__file__).parent.parent / "data" / "mappings" / "gotcha.toml"
TARGET = np.array([-15.63, 21.59, 0.0])


@pytest.mark.slow("reads a whole measured recording")
def test_the_mapping_says_it_all():
    folder = Path(os.environ.get("FLGPR_MEASURED_DATA", "")) / "gotcha"
    if not os.environ.get("FLGPR_MEASURED_DATA") or not folder.is_dir():
        pytest.skip("FLGPR_MEASURED_DATA has no gotcha folder")
    run = import_mapped(MAPPING, folder=folder).run
    side = np.arange(-1.0, 1.01, 0.1)
    pixels = TARGET + np.stack(
        [*np.meshgrid(side, side), np.zeros((side.size, side.size))], axis=-1
    )
    tones = run["frequency"].values
    place = run["tx_position"].values
    image = ImagingOperator(tones, place, place, pixels).adjoint(run["signal"].values[0])[0, 0]
    parts = [loadmat(path)["data"][0, 0] for path in sorted(folder.glob("*.mat"))]
    phase = np.concatenate([p["fp"].T for p in parts])[None]
    reference = np.concatenate([p["r0"].ravel() for p in parts])
    by_hand = ImagingOperator(tones, place, place, pixels, path_offset=2 * reference).adjoint(
        phase
    )[0, 0]
    assert np.linalg.norm(image - by_hand) < 3e-3 * np.linalg.norm(by_hand)
    peak = pixels[np.unravel_index(np.abs(image).argmax(), image.shape)]
    assert np.abs(peak - TARGET).max() <= 0.1 + 1e-9
