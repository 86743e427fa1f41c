"""A scene and a sensor of which decks are small, and the lines of a deck."""

from flgpr.model import Sensor
from flgpr.simulate import Scene

SENSOR = Sensor(
    name="two dipoles",
    source="test",
    polarization=("HH", "HV", "VV"),
    height=0.6,
    tx=((0.0, 0.0, 0.0), (0.3, 0.0, 0.0)),
    rx=((0.1, 0.0, 0.0), (-0.15, 0.02, 0.0)),
    tones={"start": 500e6, "step": 20e6, "count": 51},
    antenna={"kind": "dipole"},
)
SMALL = {"length": 0.9, "x_min": -0.3, "x_max": 0.3, "track": {"positions": (0.0, 0.2)}}


def lines_of(decks, command, name="scene.txt"):
    return [
        line.split()[1:]
        for line in decks.files[name].splitlines()
        if line.startswith(f"#{command}:")
    ]


def flat(**parts):
    return Scene.model_validate({**SMALL, "surface": {"rms_height": 0.0}, **parts})
