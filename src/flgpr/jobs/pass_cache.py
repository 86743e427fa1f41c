"""The pass cache: results of passes that jobs of other recipes share.

It is a folder that may be deleted at any time. Beside every result lies a report of what it cost.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flgpr.door import Folder
from flgpr.jobs.checkpoint import Checkpoint
from flgpr.jobs.job import LaneJob
from flgpr.jobs.workers import Report
from flgpr.store import canonical_json, sha256, write_whole

_LAYOUT = 2  # to be raised when the arrays that jobs share change
_COSTS = ("seconds", "processor_seconds")
"""Entries of reports that add up."""


class PassCache:
    """The pass cache of a job; without a folder nothing is shared.

    Parameters
    ----------
    job : LaneJob
        The job.
    """

    def __init__(self, job: LaneJob) -> None:
        self._job = job
        self._folder = Path(job.pass_cache)
        self._results = Checkpoint(self._folder, job.largest)
        self._reports = Folder(self._folder)

    def name_of(self, name: str, depends_on: Mapping[str, Any] | None) -> str | None:
        """Return the name that the result of a pass has in the cache.

        Parameters
        ----------
        name : str
            Name of the pass.
        depends_on : mapping or None
            What of the recipe its result depends on; None if no other recipe can use the result.

        Returns
        -------
        str or None
            The name; None if the result is not shared.
        """
        if not self._job.pass_cache or depends_on is None:
            return None
        identity = self._job.identity
        context = {key: identity[key] for key in ("run", "lane", "code", "cpu", "block", "others")}
        for key in ("left_out", "left_out_of_others"):
            if key in identity:
                context[key] = identity[key]
        context["layout"] = _LAYOUT
        return sha256(canonical_json([context, name, depends_on]))[:32]

    def take(self, shared_name: str, work: Checkpoint, name: str) -> Report | None:
        """Take the result of a pass into a work folder.

        Returns
        -------
        Report or None
            What it cost the first job; None if the cache does not hold the result.
        """
        if not work.take(self._results, shared_name, name):
            return None
        report: Report = self._reports.json(f"{shared_name}.json")
        return report | {"lane": self._job.name}

    def leave(
        self, shared_name: str, work: Checkpoint, name: str, reports: Sequence[Report]
    ) -> None:
        """Leave the result of a pass in the cache, with what its blocks and their merge cost."""
        self._folder.mkdir(parents=True, exist_ok=True)
        cost = dict(reports[-1])
        for entry in _COSTS:
            cost[entry] = sum(report[entry] for report in reports)
        cost["peak_bytes"] = max(report["peak_bytes"] for report in reports)
        write_whole(self._folder / f"{shared_name}.json", json.dumps(cost))
        self._results.take(work, name, shared_name)
