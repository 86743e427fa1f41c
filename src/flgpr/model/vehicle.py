"""The vehicle that carries the array: the numbers that decide what its driver is told."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flgpr.model.bounds import Entries
from flgpr.model.faults import first_fault_of
from flgpr.model.frames import lane_to_scan


class Vehicle(Entries):
    """The numbers that decide what the driver of a vehicle is told, each with its source.

    The vehicle drives on while driver and brakes react, then slows evenly: the stopping distance is
    ``v·t + v²/(2·a)``. Lengths are counted from the array's reference point, whose middle is taken
    as the vehicle's.
    """

    #: confidence from which an alarm counts; all count without one, for no threshold is proven
    #: before a model is
    threshold: float | None = None
    #: v, m/s, where poses and times do not tell it; no source: every drive has its own
    speed: Annotated[float, Field(gt=0, lt=100)] | None = None
    #: t, from the sight of the word to brakes that hold, s; default: 1.5 s, drivers whom something
    #: surprises (Green 2000, Transportation Human Factors 2, 195-216)
    reaction: Annotated[float, Field(ge=0, lt=60)] = 1.5
    #: a of the braking vehicle, m/s²; default: 3, below the 3.4 that roads are laid out for (AASHTO,
    #: Geometric Design of Highways and Streets, 2018, 3.2.2), for loose ground; mud or ice: 1 to 2
    deceleration: Annotated[float, Field(ge=0.1, le=20)] = 3.0
    #: from a word of caution to the word to brake, s; default: the two-second rule (UK Highway
    #: Code, rule 126)
    warning: Annotated[float, Field(ge=0, lt=60)] = 2.0
    #: kept between vehicle and alarm on all sides, m; default: 0.5, more than twice the 0.2 m that
    #: the farthest of ten alarms lay off its mine on the packaged drive (``evidence/demo_drive.py``)
    clearance: Annotated[float, Field(ge=0, le=20)] = 0.5
    #: of the vehicle over its wheels, m; default: 2.55, the widest vehicle on European roads
    #: (Directive 96/53/EC, annex I, 1.2)
    width: Annotated[float, Field(gt=0, le=20)] = 2.55
    #: of a wheel, m, for the tracks in the picture; default: 0.32, a tyre 12.5 inches wide
    #: (37 x 12.5 R 16.5 of the HMMWV, TM 9-2320-280-10)
    tyre: Annotated[float, Field(gt=0, le=5)] = 0.32
    #: how far the foremost wheel or bumper lies ahead of the array, m; default: 0, an array at the
    #: bumper
    front: Annotated[float, Field(ge=-50, le=50)] = 0.0
    #: how far the rear axle lies behind the array, m; default: 4.6, the whole length of a HMMWV
    #: (4.57 m, TM 9-2320-280-10), whose rear axle lies before that
    axle: Annotated[float, Field(ge=-50, le=50)] = 4.6

    #: speed while no ground has been seen ahead, m/s; default: 1.4, a person who walks (Bohannon
    #: 1997, Age and Ageing 26, 15-19)
    walk: Annotated[float, Field(gt=0, le=10)] = 1.4

    @classmethod
    def of(cls, **entries: Any) -> Self:
        """Return a vehicle of these entries; a ValueError names the first that breaks its rule."""
        with first_fault_of(cls, "vehicle"):
            return cls(**entries)

    def changed(self, **entries: Any) -> Self:
        """Return the vehicle with those of the entries that are not None in place of its own."""
        given = {name: value for name, value in entries.items() if value is not None}
        return type(self).of(**{**self.model_dump(), **given})

    @property
    def stopping_distance(self) -> float | None:
        """Distance driven from the word to the stand, m; None without a speed."""
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
