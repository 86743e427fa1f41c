"""What a live run checks before it begins, when it goes on after a stop, and at its end."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.door import refuse_links
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.events import EVENT_FILE
from flgpr.live.options import LiveOptions
from flgpr.live.state import SNAPSHOT_FILE, Snapshot, read_snapshot
from flgpr.method.model import Model
from flgpr.model import complete_scans
from flgpr.recipe.schema import Recipe
from flgpr.stages.earlier import BEFORE, LEAST_SCANS
from flgpr.store import RunDescription, Scan, parse_description, read_description
from flgpr.store.answers import ANSWER_FILE
from flgpr.store.files import PARTIAL

REPORT_FILE = "live.json"
RECIPE_FILE = "recipe.toml"  # of a run without a given recipe
LIVE_RECORDING = "live.mcap"  # made of the events when the run has ended, where it is asked for


def check_output(folder: Path) -> None:
    """Refuse a folder that holds anything but the files of a live run, or links."""
    known = {EVENT_FILE, ANSWER_FILE, "alarms.csv", REPORT_FILE, RECIPE_FILE}
    known |= {name + PARTIAL for name in known}  # of a process that was killed
    known |= {LIVE_RECORDING, f".partial-{LIVE_RECORDING}"}
    refuse_links(folder)
    entries = list(folder.iterdir()) if folder.is_dir() else []
    foreign = []
    for entry in entries:
        refuse_links(entry)
        if entry.name not in known and not entry.name.startswith(SNAPSHOT_FILE):
            foreign.append(entry)
    if folder.is_file() or foreign:
        raise FileExistsError(
            f"output must be a new folder or a live run's, got {folder}, which holds other files"
        )


def snapshot_to_go_on(path: Path, options: LiveOptions) -> Snapshot | None:
    """Return the snapshot that a run goes on from; None where it begins, as ``fresh`` asks for.

    Raises
    ------
    ValueError
        If the snapshot is damaged, or of another run than the folder that scans come in.
    """
    if options.fresh:
        path.unlink(missing_ok=True)
    snapshot = read_snapshot(path)
    if snapshot is not None and options.incoming is not None:
        # Refused before anything is written.
        description = read_description(Path(options.incoming))
        run_id = parse_description(snapshot[0]["run"]).run_id
        if description is not None and description.run_id != run_id:
            raise ValueError(
                f"{options.incoming}: the description is that of another run; `fresh` begins anew"
            )
    return snapshot


def rehearse(
    description: RunDescription,
    recipe: Recipe,
    model: Model,
    others: Mapping[str, xr.Dataset] | None = None,
) -> None:
    """Run noise through a separate detector: all is compiled and loaded before the first scan."""
    settings = LiveSettings(looks=1, warm_up=3)
    # What earlier drives tell is estimated from all of their scans for the detector itself.
    few = {
        name: run.isel(scan=np.flatnonzero(complete_scans(run))[:LEAST_SCANS])
        for name, run in (others or {}).items()
    }
    detector = LiveDetector(description, recipe, None, model, settings, few)
    rng = np.random.default_rng(0)
    for number in range(8):
        noise = rng.standard_normal((2, *description.shape), dtype=np.float32)
        pose = np.array([0.0, float(number), 2.0, 0.0, 0.0, 0.0])
        signal = (noise[0] + 1j * noise[1]).astype(np.complex64)
        detector.add(Scan(number, float("nan"), pose, signal))


def sentences_at_end(detector: LiveDetector, came: bool) -> dict[str, list[str]]:
    """Return what is said of a run that ends, by what it is about.

    Parameters
    ----------
    detector : LiveDetector
        The detector of the run.
    came : bool
        Whether any frame came.
    """
    said = {}
    lane = detector.lane
    if not detector.saw_lane and came and lane is not None:
        said["lane"] = [
            f"no scan saw the lane, y {lane.y_min:g} to {lane.y_max:g} m: nothing is said of it"
        ]
    fit = [] if detector.earlier is None else detector.earlier.sentences()
    if fit:
        said[BEFORE] = fit
    return said
