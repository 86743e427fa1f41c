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
    write_geojson,
    write_table,
    write_whole,
)
from flgpr.store.lane_file import lane_file_of
from flgpr.store.outputs import atomic_output, log_finished
from flgpr.store.run_writer import RunExistsError
from flgpr.store.writing import write_table_beside
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
    to the same bits; a whole lane of the same arguments stays as it is.

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
        All that was written.

    Raises
    ------
    ValueError
        If it would take too much memory or time; nothing is made then.
    RunStoreError
        If the output was left by a call for another lane.

    Warns
    -----
    UserWarning
        If the footprint reaches beyond what the steps of the tones keep apart.
    """
    check_effort(scene, sensor, force)
    warn_of_aliases(sensor)
    store = Path(output)
    simulator = Simulator(scene, sensor, seed, errors)
    try:
        tx, rx = sensor.pairs()
        attrs = simulator.attributes() | {
            "source": "simulated by flgpr",
            "title": scene.name,
            "scene_sha256": _digest(scene),
        }
        inputs = {"flgpr": __version__, "sensor_sha256": _digest(sensor), "errors": errors}
        polarization = list(sensor.polarization)
        begun = RunWriter(
            store,
            simulator.frequency,
            polarization,
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
        if truth is not None and not blind:
            _write_named_truth(Path(truth), simulator)
        return [store]
    with begun as writer:
        written = [store]
        if not blind:
            written += _write_truth(store, simulator, truth)
        borders = lane_file_of(store)
        write_whole(borders, lane_text(simulator.scene.lane))
        written.append(borders)
        poses = simulator.reported_pose()
        done = len(writer)
        total = len(simulator)
        label = f"simulating, {done} scans were there" if done else "simulating"
        for scan in track(range(done, total), label, total - done):
            writer.append(simulator.scan(scan), poses[scan], float(simulator.time[scan]))
    return written


def _write_truth(store: Path, simulator: Simulator, truth: PathLike | None) -> list[Path]:
    """Write the tables of truth and objects, the former to the file that the user named, if any."""
    written = []
    tables = {"truth": simulator.truth, "objects": simulator.objects}
    if truth is not None:
        written.append(_write_named_truth(Path(truth), simulator))
        del tables["truth"]
    for name, table in tables.items():
        written.append(write_table_beside(store, name, table))
    return written


def _write_named_truth(path: Path, simulator: Simulator) -> Path:
    """Write the truth to a file that the user named; another one there is refused."""
    for file, write in ((path, write_table), (path.with_suffix(".json"), write_geojson)):
        with atomic_output(file) as partial:
            write(simulator.truth, partial)
    return path


def _digest(description: Scene | Sensor) -> str:
    """Return the SHA-256 of what a scene or a sensor says beside the defaults."""
    content: Any = json.loads(description.model_dump_json(exclude_defaults=True))
    return sha256(canonical_json(content))
