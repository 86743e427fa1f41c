"""Senders on a socket as tests of live detection try them."""

import contextlib
import time

import numpy as np

from flgpr.live.senders import SenderLimits
from flgpr.live.source import Inbox
from flgpr.store import describe_for_live, encode_scan

QUICK = SenderLimits(senders=3, pause=0.2, frame=0.4, silence=0.4)
"""Limits that end what is too slow within half a second."""


def first_scan(run):
    """Return the frame of the first scan of a run, taken at the origin."""
    run_id = describe_for_live(run).run_id
    return encode_scan(0, run["signal"].values[0], np.zeros(6), 0.0, run_id)


@contextlib.contextmanager
def watching(make_watch, address, limits=QUICK):
    """Yield the inbox and the source that listens on an address; it must end when it is stopped."""
    inbox = Inbox()
    watch = make_watch(address, inbox, limits)
    watch.start()
    try:
        yield inbox, watch
    finally:
        inbox.stop.set()
        watch.join(5)
        assert not watch.is_alive()


@contextlib.contextmanager
def sending_over(connect, data=b""):
    """Yield a connection that ``connect`` makes, over which data were sent."""
    with connect() as sender:
        sender.settimeout(20)
        if data:
            sender.sendall(data)
        yield sender


def is_ended(sender):
    """Return whether the other side has closed a connection; wait until it says something."""
    try:
        return sender.recv(1) == b""
    except ConnectionError:
        return True


def wait_for(condition):
    """Wait until a condition holds, a minute at most."""
    last = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < last
        time.sleep(0.01)
