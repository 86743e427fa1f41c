"""Simulated lanes as files: what ``flgpr simulate`` does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from flgpr import __version__
from flgpr.chain.progress import Track, silent
from flgpr.io import RunWriter, canonical_json, lane_text, sha256, write_geojson, write_table, write_whole
from flgpr.model import Sensor
from flgpr.simulate import Scene, Simulator, World, draw_world
from flgpr.simulate.effort import check_effort

_COLOUR = {"metal": "C3", "plastic": "C0", "simulant": "C2", "rock": "0.5", "post": "black", "bush": "C2"}


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
    """Simulate a lane scan by scan into a run store, and give the paths of all that was written.

    Beside it stand ``NAME-truth.csv`` (or what ``truth`` names) and ``NAME-objects.csv``, as GeoJSON too, and
    ``NAME-lane.toml``; ``blind``, only the last. A stopped call goes on when made again with the same arguments, to the
    same bits; without ``resume`` it begins again. What another lane's call left is a RunStoreError. What would take too
    much memory or time is a ValueError before anything is made, unless ``force`` is given.
    """
    check_effort(scene, sensor, force)
    store = Path(output)
    simulator = Simulator(scene, sensor, seed, errors)
    tx, rx = sensor.pairs()
    attrs = simulator.attributes() | {"source": "simulated by flgpr", "title": scene.name, "scene_sha256": _hash(scene)}
    inputs = {"flgpr": __version__, "sensor_sha256": _hash(sensor), "errors": errors}
    polarization = list(sensor.polarization)
    with RunWriter(store, simulator.frequency, polarization, tx, rx, attrs, resume=resume, inputs=inputs) as writer:
        written = [store, *([] if blind else _write_truth(store, simulator, truth)), _write_borders(store, simulator)]
        poses, done, total = simulator.reported_pose(), len(writer), len(simulator)
        label = f"simulating, {done} scans were there" if done else "simulating"
        for scan in track(range(done, total), label, total - done):
            writer.append(simulator.scan(scan), poses[scan], float(simulator.time[scan]))
    return written


def _write_truth(store: Path, simulator: Simulator, truth: str | Path | None) -> list[Path]:
    written = []
    for name, table in (("truth", simulator.truth), ("objects", simulator.objects)):
        path = Path(truth) if name == "truth" and truth else store.with_name(f"{store.stem}-{name}.csv")
        write_table(table, path)
        write_geojson(table, path.with_suffix(".geojson"))
        written.append(path)
    return written


def _write_borders(store: Path, simulator: Simulator) -> Path:
    path = store.with_name(f"{store.stem}-lane.toml")
    write_whole(path, lane_text(simulator.scene.lane))
    return path


def _hash(part: Scene | Sensor) -> str:
    content: Any = json.loads(part.model_dump_json())
    return sha256(canonical_json(content))


def preview_figure(scene: Scene, seed: int, force: bool = False) -> Figure:
    """Draw a scene from above, targets and clutter by kind, and in section, before anything is simulated.

    More things than can be drawn in reasonable memory and time are a ValueError, unless ``force`` is given.
    """
    check_effort(scene, None, force)
    world = draw_world(scene, seed)
    lane = scene.lane
    side = max(scene.clutter.roadside[1], abs(lane.x_min), abs(lane.x_max)) + 0.5
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    plan, section = figure.subplots(2, 1, height_ratios=(2.2, 1), sharex=True)
    size = lane.y_max - lane.y_min, lane.x_max - lane.x_min
    plan.add_patch(Rectangle((lane.y_min, lane.x_min), *size, fc="0.93", ec="0.2", ls="-.", label="lane"))
    for patch in world.patches:
        plan.add_patch(Circle((patch.y, patch.x), patch.radius, fc="C9", alpha=0.25, lw=0))
    _scatter_things(plan, world)
    plan.set(ylabel="cross-track x (m)", ylim=(-side, side), title=f"{scene.name}, seed {seed}")
    plan.legend(fontsize=8, ncols=7, loc="upper center", bbox_to_anchor=(0.5, -0.02), frameon=False)
    for kind in dict.fromkeys(t.kind for t in world.targets):
        some = [t for t in world.targets if t.kind == kind]
        depth = np.array([[100 * t.depth, 100 * (t.depth + t.height)] for t in some])
        colour = _COLOUR.get(kind, "C4")
        section.vlines([t.y for t in some], depth[:, 0], depth[:, 1], color=colour, lw=4)
    section.axhline(0, color="saddlebrown")
    section.set(xlabel="down-track y (m)", ylabel="depth (cm)", xlim=(lane.y_min - 2, lane.y_max + 2))
    section.invert_yaxis()
    return figure


def _scatter_things(axes: Any, world: World) -> None:
    marks = {"metal": "s", "plastic": "^", "simulant": "D", "rock": ".", "post": "|", "bush": "*", "fiducial": "P"}
    things: list[Any] = [*world.targets, *world.objects]
    for kind in dict.fromkeys(t.kind for t in things):
        some = [t for t in things if t.kind == kind]
        label = f"{kind} ({len(some)})"
        y, x = [t.y for t in some], [t.x for t in some]
        axes.plot(y, x, marks.get(kind, "o"), color=_COLOUR.get(kind, "C4"), ms=6, ls="none", label=label)
