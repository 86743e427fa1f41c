"""What the robustness tests share: a detected lane, and the content of folders as digests."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from flgpr.engine import blocks_of
from flgpr.jobs.job import make_job
from flgpr.results.result import Result, read_result
from flgpr.store import open_run
from small_lane import LANE


def digests(folder):
    """Digests of all files of a folder."""
    folder = Path(folder)
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def content(folder):
    """Digests of all files of a result, and what its manifest tells of the run.

    Its path is left out, and the words on where the lane's borders come from: who calls says that.
    """
    files = digests(folder)
    del files["manifest.json"]
    manifest = read_result(folder).manifest
    described = {
        name: value for name, value in manifest["run"].items() if name not in ("path", "searched")
    }
    return files | {"run": described}


@dataclass
class DetectedLane:
    """A stored lane, its recipe and area, and the result of an uninterrupted detection in one process."""

    home: Path
    result: Result
    lane = LANE

    @property
    def run(self):
        return self.home / "run.zarr"

    @property
    def recipe(self):
        return self.home / "small.toml"

    @property
    def area(self):
        return self.home / "lane.toml"

    @property
    def arguments(self):
        return self.run, self.recipe

    @cached_property
    def content(self):
        return content(self.result.folder)

    @property
    def features(self):
        return self.result.detections[0].features

    @property
    def opened(self):
        return open_run(self.run)

    @property
    def blocks(self):
        return len(blocks_of(self.opened.sizes["scan"]))


def small_job(lane, output):
    return make_job(lane.run, lane.recipe.read_text(), LANE, output, report=False)
