"""Damage to files, and what readers say of it."""

import os
import warnings

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

CASES = int(os.environ.get("FLGPR_CASES", "100"))
"""Cases per reader."""
FUZZ = settings(
    max_examples=CASES,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
)
MACHINE = settings(FUZZ, max_examples=max(CASES // 4, 1), stateful_step_count=20)
"""Of a state machine, whose cases are long."""

_BLOWS = st.lists(
    st.tuples(
        st.sampled_from(["cut", "flip", "write", "grow", "swap", "zero"]),
        st.integers(0, 2**32 - 1),
        st.integers(0, 7),
        st.binary(min_size=1, max_size=8),
    ),
    min_size=1,
    max_size=4,
)


def damaged(data, draw):
    """Cut, flip, swap, overwrite or lengthen."""
    raw = bytearray(data)
    for what, where, bit, new in draw(_BLOWS):  # drawn at once, so that what is drawn does not depend on the data
        at = where % max(len(raw), 1)
        if what == "cut":
            del raw[at:]
        elif what == "flip" and raw:
            raw[at] ^= 1 << bit
        elif what == "write":
            raw[at : at + 4] = new
        elif what == "grow":
            raw += bytes(raw) * 9
        elif what == "swap":
            raw[at : at + 8] = raw[at : at + 8][::-1]
        elif what == "zero":
            raw[at : at + 16] = bytes(len(raw[at : at + 16]))
        if len(raw) > 200_000:
            break
    return bytes(raw)


def refusal(call, *arguments, **options):
    """What a reader says, None if it reads; any other exception than ValueError goes on."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # parsers warn of what they then refuse
        try:
            call(*arguments, **options)
        except ValueError as error:
            return str(error)
    return None
