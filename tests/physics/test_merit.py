"""Measured multistatic data in a medium (MERIT): the target is the brightest pixel after subtraction, not before."""

import os
from pathlib import Path

import numpy as np
import pytest

from flgpr.formats.mapped import import_mapped
from flgpr.imaging import ImagingOperator

TARGET = np.array([0.015, 0.0, 0.035])
MAPPING = Path(__file__).parent.parent / "data" / "mappings" / "merit.toml"


@pytest.fixture(scope="module")
def images():
    folder = Path(os.environ.get("FLGPR_MEASURED_DATA", "")) / "merit"
    if not os.environ.get("FLGPR_MEASURED_DATA") or not folder.is_dir():
        pytest.skip("FLGPR_MEASURED_DATA has no merit folder")
    run = import_mapped(MAPPING, folder=folder).run
    side = np.arange(-0.06, 0.0601, 0.0025)
    height = np.arange(0.0, 0.0701, 0.0025)
    pixels = np.stack(np.meshgrid(side, side, height, indexing="ij"), axis=-1)
    pixels = pixels[np.hypot(pixels[..., 0], pixels[..., 1]) < 0.06]
    operator = ImagingOperator(
        run["frequency"].values,
        run["tx_position"].values,
        run["rx_position"].values,
        pixels,
        permittivity=8.0,
    )
    straight, turned = run["signal"].values
    return (
        pixels,
        np.abs(operator.adjoint(straight - turned)[0, 0]),
        np.abs(operator.adjoint(straight)[0, 0]),
    )


def test_the_target_is_brightest_after_subtraction(images):
    pixels, subtracted, _ = images
    assert np.linalg.norm(pixels[subtracted.argmax()] - TARGET) < 0.010


def test_without_subtraction_no_peak_is_there(images):
    pixels, _, plain = images
    near = np.linalg.norm(pixels - TARGET, axis=1) < 0.010
    assert np.linalg.norm(pixels[plain.argmax()] - TARGET) > 0.030
    assert plain[near].max() < plain.max() / np.sqrt(2)
