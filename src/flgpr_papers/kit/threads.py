"""A decorator that lets the linear algebra of a study run in one thread."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import scipy.linalg  # noqa: F401  # loads the BLAS of SciPy, which can be limited only once loaded
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

Run = TypeVar("Run", bound=Callable[..., Any])


def one_blas_thread(run: Run) -> Run:
    """Return a function that runs with one thread of the linear algebra.

    The matrices of the studies are small, so that several threads mostly wait for each other. When
    other work runs on the same two cores, flsar2004 takes four times as long with two threads.
    """

    @wraps(run)
    def limited(*arguments: Any, **options: Any) -> Any:
        with threadpool_limits(limits=1, user_api="blas"):
            return run(*arguments, **options)

    return cast("Run", limited)
