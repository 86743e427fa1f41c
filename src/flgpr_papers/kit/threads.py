"""A decorator that lets the linear algebra of a study run in one thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import scipy.linalg  # noqa: F401  # loads the BLAS of SciPy, which can be limited only once loaded
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

Run = TypeVar("Run", bound=Callable[..., Any])


def one_blas_thread(run: Run) -> Run:
    """Return a function that runs with one thread of the linear algebra.

    The matrices of the studies are small, so that several threads mostly wait for each other. When
    other work runs on the same two cores, flsar2004 takes four times as long with two threads.
    """
    return cast("Run", threadpool_limits.wrap(limits=1, user_api="blas")(run))
