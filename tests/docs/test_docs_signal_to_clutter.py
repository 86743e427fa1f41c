"""The published table of signal to clutter: the formula's figures, and as near to the images as the page says."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.design import Viewing, expected_signal_to_clutter, ground_model
from flgpr.model import load_sensor

pytestmark = pytest.mark.slow("checks of pages")

DOCS = Path(__file__).parents[2] / "docs"
BANDS = {"F1": (0.75e9, 1.35e9), "F4": (2.25e9, 2.85e9)}
CHANNELS = {"f1_hh": ("F1", "HH"), "f1_vv": ("F1", "VV"), "f4_hh": ("F4", "HH")}


@pytest.fixture(scope="module")
def table():
    return pd.read_csv(DOCS / "evidence" / "signal-to-clutter.csv")


@pytest.mark.slow("makes images of simulated ground")
@pytest.mark.parametrize(
    ("site", "body", "rms_mm"),
    [("prepared-earth", "vs-1.6", 2.0), ("temperate", "metal-at", 4.0), ("gravel", "m19", 1.0)],
)
def test_the_table_is_what_the_formula_gives(table, site, body, rms_mm):
    part = table[(table["site"] == site) & (table["body"] == body) & (table["rms_mm"] == rms_mm)]
    ground = ground_model(site, rms_height=rms_mm / 1000)
    depths = [0.01 * depth for depth in part["depth_cm"]]
    assert len(depths) == 5
    found = expected_signal_to_clutter(
        load_sensor("sri-array"), ground, [body], depths, Viewing(subbands=BANDS)
    )
    for name, (subband, polarization) in CHANNELS.items():
        channel = found[(found["subband"] == subband) & (found["polarization"] == polarization)]
        np.testing.assert_allclose(
            part[f"{name}_formula_db"], channel["signal_to_clutter_db"], atol=0.051
        )


@pytest.mark.parametrize("name", CHANNELS)
def test_formula_and_images_agree_in_the_table(table, name):
    measured = table.dropna(subset=[f"{name}_measured_db"])
    assert len(measured) > 400
    off = measured[f"{name}_measured_db"] - measured[f"{name}_formula_db"]
    assert off.abs().max() <= 1.0
    assert (measured[f"{name}_margin_db"] < 1.5).all()
