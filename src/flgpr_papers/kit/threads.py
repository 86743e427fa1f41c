"""One thread of the linear algebra for a study, whose matrices are small."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import scipy.linalg  # noqa: F401  # so that the library it brings is there to be limited
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

Run = TypeVar("Run", bound=Callable[..., Any])


def one_blas_thread(run: Run) -> Run:
    """Let a function run with one thread of the linear algebra, however many the process was given.

    The matrices of the studies are small: threads mostly wait for each other. Beside other work on two cores flsar2004
    takes four times as long with two of them.
    """

    @wraps(run)
    def limited(*arguments: Any, **options: Any) -> Any:
        with threadpool_limits(limits=1, user_api="blas"):
            return run(*arguments, **options)

    return cast("Run", limited)
