"""Stopping distance of a vehicle, and whether it can stop before an alarm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flgpr.model import lane_to_scan


@dataclass(frozen=True)
class Vehicle:
    """A vehicle and its brakes.

    It drives on while driver and brakes react, then slows evenly: the stopping distance is ``v·t +
    v²/(2·a)``.
    """

    speed: float | None = None  #: v, m/s; None where no stopping distance is asked for
    #: t, s: from the alarm to brakes that hold. Default 1.5 s, a driver who is alert and brakes
    #: that build up
    reaction: float = 1.5
    #: a, m/s². Default 3, loose ground; a dry road allows about 7, mud or ice 1 to 2
    deceleration: float = 3.0
    #: how far the vehicle's foremost wheel or bumper lies ahead of the array's reference point, m
    front: float = 0.0

    def __post_init__(self) -> None:
        if self.speed is not None and not 0 < self.speed < 100:
            raise ValueError(f"speed must lie between 0 and 360 km/h, got {3.6 * self.speed:g}")
        if not 0 <= self.reaction < 60:
            raise ValueError(f"reaction must lie between 0 and 60 s, got {self.reaction}")
        if not 0.1 <= self.deceleration <= 20:
            raise ValueError(
                f"deceleration must lie between 0.1 and 20 m/s², got {self.deceleration}"
            )
        if not -50 <= self.front <= 50:
            raise ValueError(f"front must lie between -50 and 50 m, got {self.front}")

    @property
    def stopping_distance(self) -> float | None:
        """Distance driven from the alarm to the stand, m; None without a speed."""
        if self.speed is None:
            return None
        return self.speed * self.reaction + self.speed**2 / (2 * self.deceleration)

    def left(self, x: float, y: float, pose: NDArray[np.float64]) -> float:
        """Return the distance along the heading from the vehicle's front to a place, m.

        It is negative once the vehicle is past the place.
        """
        return float(lane_to_scan([x, y, 0.0], pose)[1]) - self.front

    def margin(self, left: float, latency: float) -> float | None:
        """Return the distance between the stand and an alarm, m, if the driver is alarmed now.

        None without a speed. It is negative if the vehicle cannot stop before the alarm. ``left``
        is the distance to the alarm, m, when the scan was taken, ``latency`` seconds ago.
        """
        stopping = self.stopping_distance
        if stopping is None or self.speed is None:
            return None
        return left - self.speed * latency - stopping
