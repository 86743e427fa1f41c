"""Events of alarms as a live run reports them: with a forecast, advice to wait, and places on Earth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from flgpr.geo import Anchor, own_anchor
from flgpr.live.detector import LiveDetector
from flgpr.live.event_types import AlarmEvent, Event
from flgpr.live.events import add_places_on_earth, alarm_event, as_line
from flgpr.live.forecast import Forecast, forecast_event
from flgpr.live.updates import LiveAlarm, LiveUpdate
from flgpr.model.vehicle import Vehicle
from flgpr.types import FloatArray


class AlarmReporter:
    """Makes the events of alarms that changed, and sends their lines to a callback.

    Parameters
    ----------
    vehicle : Vehicle
        Speed, brakes, front and threshold.
    worth : float
        Probability of another decision from which waiting is worth it.
    send_line : callable
        Called with the line of every event.
    """

    def __init__(self, vehicle: Vehicle, worth: float, send_line: Callable[[str], None]) -> None:
        self._vehicle = vehicle
        self._worth = worth
        self._send_line = send_line
        self.forecast: Forecast | None = None  #: what the model has learnt of further looks
        self.anchor: Anchor | None = None  #: what ties the lane to the Earth
        # Alarms whose last event advised to wait.
        self._waiting: set[str] = set()

    def use_georeference(self, reference: Any) -> str:
        """Use the georeference that a run is described with, unless an anchor was given.

        Return why alarms have no places on Earth; "" if they have, or the run has none.
        """
        if self.anchor is not None or reference is None:
            return ""
        try:
            anchor = own_anchor(reference)
            if not np.isfinite(anchor.to_geodetic(np.zeros(3))).all():
                raise ValueError(f"georeference must lie on the Earth, got {reference!r}")
        except ValueError as error:
            return f"alarms have places in the lane alone: {error}"
        self.anchor = anchor
        return ""

    def send(self, event: Event) -> None:
        """Send the line of an event that is of no alarm."""
        self._send_line(as_line(event))

    def resume(self, alarm_ids: Iterable[str]) -> None:
        """Take these open alarms as advised to wait: what an earlier process wrote is not known."""
        self._waiting = set(alarm_ids)

    def keep_open(self, alarm_ids: Iterable[str]) -> None:
        """Forget the advice on all alarms but these, which are still open."""
        self._waiting &= set(alarm_ids)

    def events(
        self,
        update: LiveUpdate,
        scan: int,
        pose: FloatArray,
        latency: float,
        detector: LiveDetector,
    ) -> list[AlarmEvent]:
        """Return the events of alarms that a scan changed, and send their lines.

        Parameters
        ----------
        update : LiveUpdate
            What the scan changed.
        scan : int
            Number of the scan.
        pose : (6,) ndarray of float
            Pose of the newest scan, m and rad.
        latency : float
            Time from the arrival of the scan, s.
        detector : LiveDetector
            Has the alarms.

        Returns
        -------
        list of dict
            The events. Some are of alarms that did not change: their last event advised to wait
            for a look that did not come, and waiting is no longer worth it.
        """

        def event_of(alarm: LiveAlarm) -> AlarmEvent:
            event = alarm_event(alarm, scan, pose, self._vehicle, latency)
            if detector.ground is not None and detector.ground.unlike:
                event["unlike"] = True
            if self.forecast is None:
                return event
            threshold = self._vehicle.threshold or 0.0
            entries = forecast_event(
                self.forecast, detector, alarm, event.get("margin_m"), threshold, self._worth
            )
            return {**event, **entries}

        events = [event_of(alarm) for alarm in update.alarms]
        changed = {alarm.alarm_id for alarm in update.alarms}
        unchanged = detector.alarms.open.keys() - changed
        for alarm_id in self._waiting & unchanged:
            alarm = replace(detector.alarms.open[alarm_id], state="update")
            event = event_of(alarm)
            if event.get("wait") is False:
                events.append(event)
        if self.anchor is not None:
            add_places_on_earth(events, self.anchor)
        for event in events:
            if event.get("wait"):
                self._waiting.add(event["alarm_id"])
            else:
                self._waiting.discard(event["alarm_id"])
            self._send_line(as_line(event))
        return events
