"""A simulated lane, scan by scan into a run store; an interrupted simulation resumes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flgpr import __version__
from flgpr.model import Sensor
from flgpr.progress import Track, silent
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.effort import check_effort
from flgpr.simulate.simulator import warn_of_aliases
from flgpr.store import (
    RunWriter,
    canonical_json,
    lane_text,
    sha256,
    write_whole,
)
from flgpr.store.lane_file import lane_file_of
from flgpr.store.outputs import atomic_output, log_finished
from flgpr.store.run_writer import RunExistsError
from flgpr.store.writing import write_table_pair
from flgpr.types import PathLike


def simulate_to_store(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    output: PathLike,
    errors: bool = True,
    track: Track = silent,
    resume: bool = True,
    truth: PathLike | None = None,
    blind: bool = False,
    force: bool = False,
) -> list[Path]:
    """Simulate a lane scan by scan into a run store.

    Beside it stand ``NAME-truth.csv`` and ``NAME-objects.csv``, both as GeoJSON in the lane frame,
    too, and ``NAME-lane.toml``. A stopped call continues when made again with the same arguments,
    to the same bits; a whole lane of the same arguments stays as it is, and of the files beside it
    those that are gone are written again.

    Parameters
    ----------
    scene : Scene
        What is there.
    sensor : Sensor
        What sees it.
    seed : int
        Of everything random.
    output : str or path
        The run store.
    errors : bool
        Whether the sensor has its errors.
    track : Track
        Shows progress.
    resume : bool
        Whether to continue a stopped call; otherwise it begins again.
    truth : str or path, optional
        File of the truth in place of ``NAME-truth.csv``.
    blind : bool
        Whether to write neither truth nor objects.
    force : bool
        Whether to do what would take too much memory or time.

    Returns
    -------
    list of Path
        All that was written; files that were there already are left out.

    Raises
    ------
    ValueError
        If it would take too much memory or time, or the truth is the output; nothing is made then.
    RunStoreError
        If the output was left by a call for another lane.
    FileExistsError
        If another lane is at the output, or a file of other content beside it.

    Warns
    -----
    UserWarning
        If the footprint reaches beyond what the steps of the tones keep apart.
    """
    check_effort(scene, sensor, force)
    warn_of_aliases(sensor)
    store = Path(output)
    if truth is not None and store.absolute() == Path(truth).absolute():
        raise ValueError(f"truth must be another file than the output, got {truth}")
    simulator = Simulator(scene, sensor, seed, errors)
    try:
        attrs = simulator.attributes() | {
            "source": "simulated by flgpr",
            "title": scene.name,
            "scene_sha256": _digest(scene),
        }
        inputs = {"flgpr": __version__, "sensor_sha256": _digest(sensor), "errors": errors}
        tx, rx = sensor.pairs()
        begun = RunWriter(
            store,
            simulator.frequency,
            list(sensor.polarization),
            tx,
            rx,
            attrs,
            resume=resume,
            inputs=inputs,
            limits=simulator.limits(),
        )
    except RunExistsError as error:
        if not error.same:
            raise
        log_finished(store)
        return _write_beside(store, simulator, truth, blind)
    with begun as writer:
        written = [store, *_write_beside(store, simulator, truth, blind, not resume)]
        poses = simulator.reported_pose()
        done = len(writer)
        total = len(simulator)
        label = f"simulating, {done} scans were there" if done else "simulating"
        for scan in track(range(done, total), label, total - done):
            writer.append(simulator.scan(scan), poses[scan], float(simulator.time[scan]))
    return written


def _write_beside(
    store: Path,
    simulator: Simulator,
    truth: PathLike | None,
    blind: bool,
    replace: bool = False,
) -> list[Path]:
    """Write what stands beside a store; return its files, of a whole store those that were gone.

    Files of other content are refused; ``replace`` takes the place of those but a named truth.
    """
    tables = {}
    if not blind:
        key = Path(truth or store.with_name(f"{store.stem}-truth.csv"))
        tables[key] = simulator.truth
        tables[store.with_name(f"{store.stem}-objects.csv")] = simulator.objects
    borders = lane_file_of(store)
    is_new = not store.exists()
    new = [path for path in (*tables, borders) if is_new or not path.exists()]
    for path, table in tables.items():
        is_named = truth is not None and table is simulator.truth
        write_table_pair(table, path, replace and not is_named)
    with atomic_output(borders, replace) as partial:
        write_whole(partial, lane_text(simulator.scene.lane))
    return new


def _digest(description: Scene | Sensor) -> str:
    """Return the SHA-256 of what a scene or a sensor says beside the defaults."""
    content: Any = json.loads(description.model_dump_json(exclude_defaults=True))
    return sha256(canonical_json(content))
