"""A scan of the simulator: bare rough ground, and a natural site with all there is."""

from __future__ import annotations

import numpy as np

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator

from .data import size

SCANS = 40
"""Scans of a track; a benchmark takes the next one each time, so that no scan is known yet."""


class BareGround:
    """Scan over bare rough ground with so many scatterers in view."""

    params = (("sri-array", 100_000), ("dual-band-l", 100_000), ("dual-band-x", 300_000))
    param_names = ("sensor and scatterers",)
    number = 1
    repeat = SCANS // 4
    warmup_time = 0

    def setup(self, case: tuple[str, int]) -> None:
        preset, scatterers = case
        sensor = load_sensor(preset)
        x_min, x_max, y_min, y_max = sensor.footprint
        density = size(scatterers, 1000) / ((x_max - x_min) * (y_max - y_min))
        track = {"positions": tuple(float(y) for y in range(SCANS))}
        scene = Scene(surface={"density": density}, track=track, length=60.0)
        self.simulator = Simulator(scene, sensor, 1, errors=False)
        self.simulator.scan(0)
        self.scan = 0

    def time_scan(self, case: tuple[str, int]) -> None:
        self.scan = (self.scan + 1) % SCANS
        self.simulator.scan(self.scan)


class NaturalSite:
    """Scan of the ``sri-array`` over ``temperate``: its density, 12 mines, objects, all errors."""

    number = 1
    repeat = SCANS // 4
    warmup_time = 0

    def setup(self) -> None:
        kinds = ("metal", "plastic")
        draws = [{"kind": kind, "depth": 0.05, "count": 6} for kind in kinds]
        track = {"positions": tuple(np.arange(SCANS) * 1.0)}
        surface = {"density": 20.0} if size(0, 1) else {}
        scene = Scene(site="temperate", length=60.0, draws=draws, track=track, surface=surface)
        self.simulator = Simulator(scene, load_sensor("sri-array"), 1)
        self.simulator.scan(0)
        self.scan = 0

    def time_scan(self) -> None:
        self.scan = (self.scan + 1) % SCANS
        self.simulator.scan(self.scan)
