"""Limits how many events of faults are written.

Of a flood, one event now and then gives the count.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from flgpr.live.event_types import Event

BURST = 10  # events of a kind that are written one by one
# s between the summaries of a flood; the page reports a missing radar after 0.75 s
_PERIOD = {"problem": 1.0, "counts": 0.25}
_MOST_KINDS = 32


@dataclass
class _Flood:
    """Events of a kind that came without a pause."""

    last: float  # when the last event came, s
    written: float  # when an event was last written, s
    singly: int = 0  # events written one by one
    left_out: int = 0  # events not written since
    event: Event | None = None  # the last of these


class EventRate:
    """Lets events through, but of a flood of faults only some.

    ``problem`` by what it says, and ``counts``. The first ``burst`` of a kind are let through.
    After that, one ``problem`` a second gives in ``more`` how many came since, with the words of
    the last, and of ``counts`` the newest is let through four times a second, until none came for
    so long.
    """

    def __init__(self, burst: int = BURST, clock: Callable[[], float] = time.monotonic) -> None:
        self._burst = burst
        self._clock = clock
        self._floods: dict[tuple[str, str], _Flood] = {}

    def admit(self, events: Iterable[Event]) -> list[Event]:
        """Return the events that are written, in order, with the summaries that are due."""
        written = self.due()
        for event in events:
            if event["event"] == "end":
                written += self.rest()
            if event["event"] not in _PERIOD or self._is_single(event):
                written.append(event)
        return written

    def due(self) -> list[Event]:
        """Return the summaries of floods whose time has come."""
        now = self._clock()
        summaries = []
        for (kind, _), flood in self._floods.items():
            if now - flood.written >= _PERIOD[kind]:
                summaries.append(_summary(flood, now))
        return [event for event in summaries if event is not None]

    def rest(self) -> list[Event]:
        """Return the summaries of all that was left out so far."""
        now = self._clock()
        summaries = [_summary(flood, now) for flood in self._floods.values()]
        return [event for event in summaries if event is not None]

    def _is_single(self, event: Event) -> bool:
        """Count the event of a fault; return whether it is written by itself."""
        now = self._clock()
        kind = event["event"]
        flood = self._flood(kind, _gist(event), now)
        if now - flood.last > _PERIOD[kind] and not flood.left_out:
            flood.singly = 0
        flood.last = now
        if flood.singly < self._burst:
            flood.singly += 1
            flood.written = now
            return True
        flood.left_out += 1
        flood.event = event
        return False

    def _flood(self, kind: str, gist: str, now: float) -> _Flood:
        """Return the flood of a kind and gist.

        Beyond so many, one without a gist collects the others.
        """
        if (kind, gist) not in self._floods and len(self._floods) >= _MOST_KINDS:
            gist = ""
        return self._floods.setdefault((kind, gist), _Flood(now, now))


def _gist(event: Event) -> str:
    """Return the first three words of a problem without numbers: they identify its kind."""
    problem = re.sub(r"\d[\d,.]*", "0", str(event.get("words", ""))[:200])
    return " ".join(problem.split()[:3])


def _summary(flood: _Flood, now: float) -> Event | None:
    """Return the event for what was left out, and begin to count anew.

    None where nothing was left out.
    """
    event = flood.event
    if event is None:
        return None
    left_out = flood.left_out
    flood.written = now
    flood.left_out = 0
    flood.event = None
    if event["event"] == "counts":
        return event
    noun = "problem" if left_out == 1 else "problems"
    summary = f"{left_out:,} more {noun} like this: {event['words']}"
    return {**event, "more": left_out, "words": summary}
