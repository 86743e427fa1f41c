"""The bridge over gprMax itself, where it is installed: here, or in the interpreter that FLGPR_GPRMAX_PYTHON names."""

import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest

from flgpr.formats import GprmaxRun
from flgpr.model import Sensor
from flgpr.simulate import Scene
from flgpr_exchange.gprmax.deck_folder import write_gprmax_decks
from io_gprmax import dipole_field

PYTHON = os.environ.get("FLGPR_GPRMAX_PYTHON") or (
    sys.executable if importlib.util.find_spec("gprMax") else None
)
pytestmark = pytest.mark.skipif(PYTHON is None, reason="gprMax is not installed")


def test_dipoles_in_air_are_the_textbooks_in_level_and_phase(tmp_path):
    tx = np.array([0.0, 0.0, 0.0])
    rx = np.array([[0.31, 0.0, 0.0], [-0.2, 0.27, 0.07]])
    sensor = Sensor(
        name="dipoles", source="test", polarization=("HH", "VV", "HV"), height=0.35, tilt=0.25, tx=(tuple(tx),),
        rx=tuple(map(tuple, rx)), tones={"start": 500e6, "step": 50e6, "count": 11}, antenna={"kind": "dipole"},
    )  # fmt: skip
    scene = Scene(
        length=0.2, x_min=-0.1, x_max=0.1, surface={"rms_height": 0.0}, track={"positions": (0.0,)},
        soil={"model": "fixed", "permittivity": 1.0},
    )  # fmt: skip
    folder = tmp_path / "decks"
    write_gprmax_decks(scene, sensor, 1, folder, cells_per_wavelength=12)
    told = subprocess.run(
        ["sh", str(folder / "run.sh")],
        env=os.environ | {"PYTHON": str(PYTHON)},
        capture_output=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr[-2000:]
    kept = GprmaxRun(folder, keep_direct=True)
    taken = GprmaxRun(folder)
    signal = kept.scan(0)
    tilted = np.array([0.0, np.sin(0.25), np.cos(0.25)])
    for row, (send, receive) in enumerate(
        ((np.eye(3)[0], np.eye(3)[0]), (tilted, tilted), (np.eye(3)[0], tilted))
    ):
        for pair in range(2):
            wanted = sum(
                receive[c] * dipole_field(send, rx[pair] - tx, c, kept.frequency) for c in range(3)
            )
            level = np.abs(dipole_field(np.eye(3)[2], rx[pair] - tx, 2, kept.frequency)).max()
            assert np.abs(signal[row, pair] - wanted).max() < 0.06 * level
    # All is air: nothing stays but what the absorbing layers give back.
    assert np.abs(taken.scan(0)).max() < 0.01 * np.abs(signal).max()
