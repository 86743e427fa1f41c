"""A simulated lane, scan by scan into a run store; an interrupted simulation resumes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flgpr import __version__
from flgpr.chain.progress import Track, silent
from flgpr.model import Sensor
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
from flgpr.store.outputs import tell_finished, whole_output
from flgpr.store.run_writer import RunExistsError


def simulate_to_store(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    output: str | Path,
    errors: bool = True,
    track: Track = silent,
    resume: bool = True,
    truth: str | Path | None = None,
    blind: bool = False,
    force: bool = False,
) -> list[Path]:
    """Simulate a lane scan by scan into a run store, and return the paths of all that was written.

    Beside it stand ``NAME-truth.csv`` (or what ``truth`` names) and ``NAME-objects.csv``, as JSON
    in the lane frame, too, and ``NAME-lane.toml``; ``blind``, only the last. A stopped call goes on
    when made again with the same arguments, to the same bits; without ``resume`` it begins again;
    and a whole lane of the same arguments stays as it is. What another lane's call left is a
    RunStoreError. What would take too much memory or time is a ValueError before anything is made,
    unless ``force`` is given; a footprint that reaches beyond what the steps of the tones keep
    apart is a UserWarning.
    """
    check_effort(scene, sensor, force)
    warn_of_aliases(sensor)
    store = Path(output)
    simulator = Simulator(scene, sensor, seed, errors)
    tx, rx = sensor.pairs()
    attrs = simulator.attributes() | {
        "source": "simulated by flgpr",
        "title": scene.name,
        "scene_sha256": _digest(scene),
    }
    inputs = {"flgpr": __version__, "sensor_sha256": _digest(sensor), "errors": errors}
    polarization = list(sensor.polarization)
    try:
        begun = RunWriter(
            store, simulator.frequency, polarization, tx, rx, attrs, resume=resume, inputs=inputs
        )
    except RunExistsError as error:
        if not error.same:
            raise
        tell_finished(store)
        if truth is not None and not blind:
            _write_own_truth(Path(truth), simulator)
        return [store]
    with begun as writer:
        written = [
            store,
            *([] if blind else _write_truth(store, simulator, truth)),
            _write_borders(store, simulator),
        ]
        poses = simulator.reported_pose()
        done = len(writer)
        total = len(simulator)
        label = f"simulating, {done} scans were there" if done else "simulating"
        for scan in track(range(done, total), label, total - done):
            writer.append(simulator.scan(scan), poses[scan], float(simulator.time[scan]))
    return written


def _write_truth(store: Path, simulator: Simulator, truth: str | Path | None) -> list[Path]:
    """Write the tables of truth and objects; the truth where the user named a file, there."""
    written = [] if truth is None else [_write_own_truth(Path(truth), simulator)]
    for name, table in (("truth", simulator.truth), ("objects", simulator.objects)):
        if name == "truth" and truth is not None:
            continue
        path = store.with_name(f"{store.stem}-{name}.csv")
        write_table(table, path)
        write_geojson(table, path.with_suffix(".json"))
        written.append(path)
    return written


def _write_own_truth(path: Path, simulator: Simulator) -> Path:
    """Write the truth to a file that the user named, where no other is yet."""
    for file, write in ((path, write_table), (path.with_suffix(".json"), write_geojson)):
        with whole_output(file) as made:
            write(simulator.truth, made)
    return path


def _write_borders(store: Path, simulator: Simulator) -> Path:
    """Write the lane of the scene."""
    path = store.with_name(f"{store.stem}-lane.toml")
    write_whole(path, lane_text(simulator.scene.lane))
    return path


def _digest(part: Scene | Sensor) -> str:
    """Return the SHA-256 of a scene or a sensor."""
    content: Any = json.loads(part.model_dump_json())
    return sha256(canonical_json(content))
