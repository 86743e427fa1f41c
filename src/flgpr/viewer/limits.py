"""Limits of a client: the number of connections, and the time for every step of a request."""

from __future__ import annotations

import asyncio
import errno
import logging
import threading
import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from flgpr import system

_PROGRESS = 65536  # bytes of an answer that a slow client must take in time
_BACKLOG = 32  # connections that wait to be accepted, and as many are accepted at once
_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-type: text/plain\r\ncontent-length: 9\r\n"
    b"retry-after: 1\r\nconnection: close\r\n\r\n503 busy\n"
)

_SCARCITY = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)

RequestStage = Literal["header", "body", "unread"]


@dataclass(frozen=True)
class Limits:
    """How many connections a server holds, and how long it waits for a client, s."""

    connections: int = 64  #: at most; where fewer files may be open, an eighth of them
    header: float = 5.0  #: from connection or last answer to the end of a request's header
    body: float = 10.0  #: from there to the end of its body
    unread: float = 10.0  #: for a client to take 64 KiB of an answer, or the rest of it
    ending: int = 20  #: for answers that are computed when the server ends


class LimitedProtocol(H11Protocol):
    """A connection that ends when its client takes too long.

    It also ends when there are too many connections and it waits the longest. Every step has a
    deadline of its own that no byte in between puts off; uvicorn alone waits without end once a
    first byte came.
    """

    config: LimitedConfig

    def __init__(self, config: LimitedConfig, *args: Any, **options: Any) -> None:
        super().__init__(config, *args, **options)
        self.limits = config.limits
        self.step: RequestStage | None = None
        self.since = time.monotonic()
        self._step_of: Any = None
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a header; make room if there are too many connections."""
        super().connection_made(transport)
        if self.config.is_ending:  # it was accepted before the server stopped to listen
            transport.abort()
            return
        transport.set_write_buffer_limits(high=0)  # any byte that is not taken pauses writing
        if len(self.connections) > self.limits.connections and not self._make_room():
            self.connections.discard(self)
            transport.write(_BUSY)
            transport.close()
            return
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the deadline."""
        self._cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Process what came, and set the deadline of the step that the request is at."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._watch()

    def pause_writing(self) -> None:
        """Wait for the client to take what was sent."""
        super().pause_writing()
        self._watch()

    def resume_writing(self) -> None:
        """Continue once the client took everything."""
        super().resume_writing()
        self._watch()

    def _waits_for(self) -> RequestStage | None:
        """Return the step that the client must do; None while the answer is computed."""
        if self.flow.write_paused:
            return "unread"
        if self.conn.their_state is h11.SEND_BODY:
            return "body"
        is_answered = self.cycle is None or self.cycle.response_complete
        return "header" if is_answered else None

    def _watch(self) -> None:
        """Set the deadline of a new step; that of a step which continues is not changed."""
        is_ending = self.transport.is_closing() and not self.flow.write_paused
        step = None if is_ending else self._waits_for()
        if (step, self.cycle) == (self.step, self._step_of):
            return
        self._cancel()
        self.step = step
        self._step_of = self.cycle
        if step is not None:
            self._start(getattr(self.limits, step))

    def _start(self, seconds: float) -> None:
        """Set a deadline in so many seconds."""
        self.since = time.monotonic()
        unread = self.transport.get_write_buffer_size()
        self._deadline = self.loop.call_later(seconds, self._too_late, unread)

    def _too_late(self, unread: int) -> None:
        """End the connection, unless the client took enough of the ``unread`` bytes."""
        still_unread = self.transport.get_write_buffer_size()
        if self.step == "unread" and still_unread <= unread - _PROGRESS:
            self._start(self.limits.unread)
            return
        self.transport.abort()

    def _cancel(self) -> None:
        """Remove the deadline."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _make_room(self) -> bool:
        """End the connection that waits the longest; return False if none waits.

        Connections that wait for a header end before those that wait for another step.
        """
        waiting = []
        for connection in self.connections:
            if not isinstance(connection, LimitedProtocol) or connection is self:
                continue
            if connection.step is not None:
                waiting.append(connection)
        if not waiting:
            return False
        longest = min(
            waiting, key=lambda connection: (connection.step != "header", connection.since)
        )
        self.connections.discard(longest)
        longest.transport.abort()
        return True


class LimitedConfig(uvicorn.Config):
    """uvicorn's configuration with limits: HTTP/1.1 only, and few messages."""

    def __init__(self, app: Any, limits: Limits) -> None:
        self.limits = limits
        self.is_ending = False
        super().__init__(
            app,
            http=LimitedProtocol,
            ws="none",
            lifespan="off",
            log_level="warning",
            access_log=False,
            server_header=False,
            backlog=_BACKLOG,
            timeout_keep_alive=max(round(limits.header), 1),
            timeout_graceful_shutdown=limits.ending,
        )
        logging.getLogger("uvicorn.error").addFilter(_FEW_RECORDS)


class LimitedServer(uvicorn.Server):
    """A server that ends on request, and reports once that the system opens no more connections."""

    config: LimitedConfig
    _scarcity_reported = False

    async def startup(self, sockets: Any = None) -> None:
        """Listen."""
        asyncio.get_running_loop().set_exception_handler(self._report)
        await super().startup(sockets)

    async def shutdown(self, sockets: Any = None) -> None:
        """End, after the answers that are being computed, or without those that take too long."""
        self.config.is_ending = True
        for connection in list(self.server_state.connections):
            if isinstance(connection, LimitedProtocol) and connection.step is not None:
                connection.transport.abort()
        await super().shutdown(sockets)

    def _report(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:  # noqa: ARG002
        """Log a fault outside of requests; log once that no connection can be accepted."""
        fault = context.get("exception")
        if self.should_exit:
            return
        if isinstance(fault, OSError) and fault.errno in _SCARCITY:
            if not self._scarcity_reported:
                self._scarcity_reported = True
                _LOG.error(
                    "the system opens no more files or connections for the viewer: "
                    "new ones wait until it does"
                )
            return
        _LOG.error(context["message"], exc_info=fault)


class FewRecords(logging.Filter):
    """Let ``most`` records of a logger through in ``period`` seconds.

    The next one gives the number of those left out.
    """

    def __init__(self, most: int = 10, period: float = 60.0) -> None:
        super().__init__()
        self._most = most
        self._period = period
        self._lock = threading.Lock()
        self._begun = -period
        self._passed = 0
        self._left_out = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written: not that of an answer which the server's end cut."""
        if record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError):
            return False
        with self._lock:
            now = time.monotonic()
            if now - self._begun >= self._period:
                self._begun = now
                self._passed = 0
            if self._passed >= self._most:
                self._left_out += 1
                return False
            self._passed += 1
            if self._left_out:
                record.msg = (
                    f"{record.getMessage()} ({self._left_out:,} messages before it were left out)"
                )
                record.args = None
                self._left_out = 0
            return True


_FEW_RECORDS = FewRecords()
_LOG = logging.getLogger("uvicorn.error")


def fit_to_process(limits: Limits) -> Limits:
    """Return limits with at most an eighth as many connections as this process may open files."""
    files = system.most_open_files()
    if files is None:
        return limits
    return replace(limits, connections=min(limits.connections, max(files // 8, 4)))
