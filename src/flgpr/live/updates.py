"""What a scan changes while a vehicle drives.

The alarms, and the run-view where it may have changed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from flgpr.method.unlike import Comparison
from flgpr.model.plausible import MotionStep
from flgpr.store import Scan
from flgpr.types import Float32Array

State = Literal["new", "update", "withdrawn", "final"]
SettledOutcome = Literal["taken", "warm-up", "still", "late", "refused"]
"""What became of a scan that is not held back."""
Outcome = SettledOutcome | Literal["held", "implausible", "duplicate"]


@dataclass(frozen=True)
class LiveAlarm:
    """An alarm as it stands after a scan.

    ``x`` and ``y`` are in m of the lane frame. ``scans`` is the number of scans that entered its
    confidence. The state "withdrawn" means that it is no longer a maximum or too weak for the
    density rule; "final" means that no scan will see it again. ``first_left`` is the distance along
    the heading from the array to the alarm when it was raised, m.
    """

    alarm_id: str
    x: float
    y: float
    confidence: float
    magnitude: float
    scans: int
    state: State
    first_left: float


@dataclass(frozen=True)
class LiveUpdate:
    """What a scan changed.

    ``outcome`` is "taken", "warm-up", "still" (the vehicle has not moved) or "late" (the scan's
    ground is passed). A scan whose pose is not plausible, see ``PoseGate``, is "held" back. It is
    among ``released`` once others agree with its pose; if they do not, it is dropped and counted,
    without an update of its own. One that is left out at once is "implausible". ``alarms`` are all
    that changed, those of ``released`` included. ``view`` is the prescreener's run-view (y, x)
    where it may have changed, from ``row`` of the lane on; ground that no scan has seen is NaN.
    """

    outcome: Outcome
    alarms: list[LiveAlarm]
    row: int = 0
    view: Float32Array | None = None
    step: MotionStep | None = None  #: why the pose is not plausible
    clock: MotionStep | None = None  #: why the time is not plausible, which is no fault of the pose
    anew: bool = False  #: whether detection started anew, at the first of ``released``
    #: whether all scans before were forgotten then, because too few poses agreed on them
    forgotten: bool = False
    #: scans that were held back and what became of them now, in their order
    released: list[tuple[Scan, LiveUpdate]] = field(default_factory=list)
    #: how the ground compares with that of training, where the verdict changes with this scan
    ground: Comparison | None = None
    words: str = ""  #: why a scan that was held back, or came with such scans, is "refused"


def last_states(alarms: list[LiveAlarm]) -> list[LiveAlarm]:
    """Return the last state of every alarm that several scans changed, in order of appearance.

    Whoever listens has heard of none of these changes: an alarm that one of the scans raised is
    still "new", and one that was raised and withdrawn among them is left out.

    Parameters
    ----------
    alarms : list of LiveAlarm
        States in the order of their changes.

    Returns
    -------
    list of LiveAlarm
        A state per alarm.
    """
    last = {alarm.alarm_id: alarm for alarm in alarms}
    new_ids = {alarm.alarm_id for alarm in alarms if alarm.state == "new"}
    changed = []
    for alarm_id, alarm in last.items():
        if alarm_id in new_ids and alarm.state == "update":
            changed.append(replace(alarm, state="new"))
        elif alarm_id not in new_ids or alarm.state != "withdrawn":
            changed.append(alarm)
    return changed
