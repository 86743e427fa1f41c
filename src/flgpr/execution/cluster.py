"""A Dask cluster that does the work. Only small values go through it: arrays stay in the work folder, which all see."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any

from flgpr.execution.executors import Executor, LostWorkersError, Report, Work
from flgpr.store.extras import optional

_PATIENCE = "20s"


class Cluster(Executor):
    """Hands the work to the workers of an existing Dask cluster, by the scheduler's address (``tcp://host:8786``).

    A lost worker costs what it was at. Run, model and output must have the same path on every worker, and the workers
    the same versions as this process.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._distributed = optional("distributed", "cluster")
        self._client: Any = None

    def __enter__(self) -> Cluster:
        try:
            self._client = self._distributed.Client(
                self.address, timeout=_PATIENCE, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise ValueError(
                f"scheduler must be the address of a Dask scheduler, got {self.address} ({error})"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def run(
        self,
        work: Work,
        arguments: Sequence[tuple[Any, ...]],
        threads: int = 1,  # noqa: ARG002
    ) -> Generator[Report]:
        """Submit a task for each set of arguments and yield what is done first; workers lost time and again end it."""
        futures = [self._client.submit(work, *some, pure=False) for some in arguments]
        try:
            done = self._distributed.as_completed(
                futures, loop=self._client.loop, with_results=True
            )
            for future, report in done:
                future.release()
                yield report
        except self._distributed.KilledWorker as error:
            raise LostWorkersError(
                f"workers must live to do their work, several died at one piece ({error})"
            ) from None
        finally:
            for future in futures:
                future.release()
