"""A small array over quiet ground."""

import pytest

from flgpr.model import Sensor, load_sensor


@pytest.fixture(scope="session")
def quiet():
    """The sri-array without errors, every second receiver and every fourth tone."""
    full = load_sensor("sri-array").model_dump()
    full["errors"] = {}
    full["rx"] = full["rx"][::2]
    full["tones"] = {"start": 442.5e6, "step": 10e6, "count": 256}
    return Sensor.model_validate(full)


@pytest.fixture(scope="session")
def dipoles(quiet):
    data = quiet.model_dump() | {
        "antenna": {"kind": "dipole"},
        "polarization": ["HH", "HV", "VH", "VV"],
    }
    return Sensor.model_validate(data)


STILL = {"positions": (0.0,)}
BARE = {"echo": False, "phase_screen": False}
