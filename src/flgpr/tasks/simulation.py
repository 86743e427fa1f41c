"""Simulated lanes as files: by our own physics, or as decks for a full-wave solver and its results."""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from flgpr import __version__
from flgpr.chain.progress import Track, silent
from flgpr.door import Folder
from flgpr.formats import GprmaxRun, import_fullwave
from flgpr.formats.gprmax_files import GprmaxTold, import_gprmax_files
from flgpr.model import Sensor, load_sensor
from flgpr.simulate import Decks, Scene, Simulator, World, draw_world, load_scene, make_decks
from flgpr.simulate.bodies.signature import (
    FREQUENCY,
    PERMITTIVITY,
    Body,
    SignatureTable,
    build_table,
    load_body,
    load_table,
    packaged_bodies,
    save_table,
)
from flgpr.simulate.simulator import check_effort, warn_of_aliases
from flgpr.store import (
    RunWriter,
    canonical_json,
    lane_text,
    save_run,
    sha256,
    write_geojson,
    write_table,
    write_whole,
)
from flgpr.store.notes import tell_note
from flgpr.store.outputs import held_folder, other_output, tell_finished, whole_output
from flgpr.store.run_store import RunExistsError, is_stored

PathLike = str | Path
_BESIDE = ("truth.csv", "truth.json", "objects.csv", "objects.json", "lane.toml")
_COLOUR = {
    "metal": "C3",
    "plastic": "C0",
    "simulant": "C2",
    "rock": "0.5",
    "post": "black",
    "bush": "C2",
}


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

    Beside it stand ``NAME-truth.csv`` (or what ``truth`` names) and ``NAME-objects.csv``, as JSON in the lane frame,
    too, and ``NAME-lane.toml``; ``blind``, only the last. A stopped call goes on when made again with the same
    arguments, to the same bits; without ``resume`` it begins again; and a whole lane of the same arguments stays as it
    is. What another lane's call left is a RunStoreError. What would take too much memory or time is a ValueError before
    anything is made, unless ``force`` is given; a footprint that reaches beyond what the steps of the tones keep apart
    is a UserWarning.
    """
    check_effort(scene, sensor, force)
    warn_of_aliases(sensor)
    store = Path(output)
    simulator = Simulator(scene, sensor, seed, errors)
    tx, rx = sensor.pairs()
    attrs = simulator.attributes() | {
        "source": "simulated by flgpr",
        "title": scene.name,
        "scene_sha256": _hash(scene),
    }
    inputs = {"flgpr": __version__, "sensor_sha256": _hash(sensor), "errors": errors}
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
    plan.add_patch(
        Rectangle((lane.y_min, lane.x_min), *size, fc="0.93", ec="0.2", ls="-.", label="lane")
    )
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
    section.set(
        xlabel="down-track y (m)", ylabel="depth (cm)", xlim=(lane.y_min - 2, lane.y_max + 2)
    )
    section.invert_yaxis()
    return figure


def _scatter_things(axes: Any, world: World) -> None:
    marks = {
        "metal": "s",
        "plastic": "^",
        "simulant": "D",
        "rock": ".",
        "post": "|",
        "bush": "*",
        "fiducial": "P",
    }
    things: list[Any] = [*world.targets, *world.objects]
    for kind in dict.fromkeys(t.kind for t in things):
        some = [t for t in things if t.kind == kind]
        label = f"{kind} ({len(some)})"
        y = [t.y for t in some]
        x = [t.x for t in some]
        axes.plot(
            y, x, marks.get(kind, "o"), color=_COLOUR.get(kind, "C4"), ms=6, ls="none", label=label
        )


def write_gprmax_decks(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    folder: str | Path,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
) -> Decks:
    """Write a scene's gprMax decks (``make_decks``) into a new folder, with truth, objects and lane.

    A folder that holds these very decks, and perhaps their results, stays; anything else there is a FileExistsError.
    """
    folder = Path(folder)
    decks = make_decks(scene, sensor, seed, cells_per_wavelength, max_cells)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_output(folder, more=True) as partial:  # it may hold results as well
        partial.mkdir()
        for name, text in decks.files.items():
            (partial / name).write_text(text, encoding="utf-8")
        (partial / "manifest.json").write_text(
            json.dumps(decks.manifest, indent=1), encoding="utf-8"
        )
        texts = tomllib.loads(
            (resources.files("flgpr.tasks") / "gprmax.toml").read_text(encoding="utf-8")
        )
        (partial / "run.sh").write_text(texts["script"], encoding="utf-8")
        size, left_out = (
            "".join(f"- {one}\n" for one in some) for some in (decks.summary, decks.omissions)
        )
        words = f"{texts['readme']}Size:\n{size}\nNot written:\n{left_out}"
        (partial / "README.txt").write_text(words, encoding="utf-8")
        world = draw_world(scene, seed)
        for name, table in (("truth", world.truth()), ("objects", world.objects_table())):
            write_table(table, partial / f"{name}.csv")
            write_geojson(table, partial / f"{name}.json")
        write_whole(partial / "lane.toml", lane_text(scene.lane))
    return decks


def import_gprmax_results(
    folder: str | Path, output: str | Path, keep_direct: bool = False, track: Track = silent
) -> list[Path]:
    """Read the results of a folder of gprMax decks into a new run; truth, objects and lane are written beside it.

    Every input file must have its result; ``keep_direct`` leaves the direct wave in the data. A stopped import goes on
    with the scan it was at, unless a result has changed.
    """
    results = GprmaxRun(folder, keep_direct)
    store = Path(output)
    manifest = results.manifest
    attrs = {
        "source": "gprMax, decks by flgpr",
        "title": manifest["title"],
        "direct_wave": "kept" if keep_direct else "taken off",
        "fullwave": {
            name: manifest.get(name)
            for name in ("seed", "sensor", "grid", "soil", "surface", "omissions")
        },
    }
    parts = (
        results.frequency,
        manifest["polarization"],
        manifest["tx_position"],
        manifest["rx_position"],
        attrs,
    )
    written = [store]
    try:
        begun = RunWriter.resumed(
            store, *parts, inputs={"results": results.digest(), "flgpr": __version__}
        )
    except RunExistsError as error:
        if not error.same:
            raise
        tell_finished(store)
        return written
    with begun as writer:
        done = len(writer)
        total = len(results)
        label = f"reading results, {done} scans were there" if done else "reading results"
        for scan in track(range(done, total), label, total - done):
            writer.append(results.scan(scan), manifest["pose"][scan], manifest["time"][scan])
        for name in _BESIDE:  # before the run, whose presence says that all is there
            data = Folder(folder).read_if_listed(name)
            if data is not None:
                target = store.with_name(f"{store.stem}-{name}")
                write_whole(target, data)
                written.append(target)
    return written


def import_gprmax_models(
    paths: Sequence[str | Path],
    output: str | Path,
    band: tuple[float, float],
    transmit: str,
    ground: float,
    horizontal: str = "x",
    vertical: str = "z",
    waveform: tuple[str, float] | None = None,
) -> list[Path]:
    """Read results of anybody's gprMax models into a new run, a file per scan; the rest is as in ``GprmaxTold``."""
    known = GprmaxTold(band, transmit, ground, horizontal, vertical, waveform)
    run = import_gprmax_files(paths, known)
    for note in run.attrs["import_notes"]:
        tell_note(note)
    return [save_run(run, output, resume=True)]


def simulate_lane(
    scene: PathLike,
    sensor: PathLike,
    seed: int,
    output: PathLike | None,
    preview: PathLike | None = None,
    errors: bool = True,
    track: Track = silent,
    resume: bool = True,
    truth: PathLike | None = None,
    force: bool = False,
) -> list[Path]:
    """Simulate a scene (TOML) seen by a sensor (preset or TOML) into a new run store, or draw it as PNG.

    Without ``resume`` what a stopped call left is thrown away; ``truth`` is a CSV of it in place of that beside the
    store. What would take too much memory or time is refused unless ``force`` is given.
    """
    world = load_scene(scene)
    array = load_sensor(sensor)
    check_effort(world, None if output is None else array, force)
    written = []
    if preview is not None:
        written.append(_write_preview(world, seed, preview, force))
    if output is not None:
        written += simulate_to_store(
            world, array, seed, output, errors, track, resume, truth, force=force
        )
    return written


def make_signature(
    body: PathLike, output: PathLike | None = None, workers: int = 1, track: Track = silent
) -> list[Path]:
    """Compute the table of a body's scattering in the ground, which a scene's targets may name; a stopped call goes on.

    It is written to the body's name with ``.npz`` unless told; a table of this body there stays, another file is a
    FileExistsError. ``OUTPUT.work`` keeps what is done.
    """
    described = load_body(body)
    path = Path(f"{described.name}.npz" if output is None else output)
    work = path.with_name(path.name + ".work")
    if os.path.lexists(path):
        if not _is_table_of(described, path):
            raise other_output(path)
        shutil.rmtree(work, ignore_errors=True)
        tell_finished(path)
        return [path]
    path.parent.mkdir(parents=True, exist_ok=True)
    with held_folder(work):
        table = _solve(described, work, workers, track)
        with whole_output(path) as made:
            save_table(table, made)
        shutil.rmtree(work)
    return [path]


def _is_table_of(body: Body, path: Path) -> bool:
    try:
        return load_table(path).body == body
    except ValueError:
        return False


def _solve(body: Body, work: Path, workers: int, track: Track) -> SignatureTable:
    """Compute a body's table under a bar that counts the pieces."""
    pieces = PERMITTIVITY.size * FREQUENCY.size
    bar = iter(track(range(pieces), f"signature of {body.name}", pieces))
    shown = 0

    def show(done: int, _: int) -> None:
        nonlocal shown
        while shown < done:
            next(bar, None)
            shown += 1

    table = build_table(body, work, workers, show)
    next(bar, None)
    return table


def list_bodies() -> list[str]:
    """Tell the packaged bodies, a line each: name, size and source."""
    bodies = [load_body(name) for name in packaged_bodies()]
    return [
        f"{body.name:18} {2 * body.radius * body.elongation * 100:5.1f} cm across, {body.height * 100:4.1f} cm high: "
        f"{body.source}"
        for body in bodies
    ]


def write_gprmax_lane(
    scene: PathLike,
    sensor: PathLike,
    seed: int,
    output: PathLike | None,
    preview: PathLike | None = None,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
    force: bool = False,
) -> tuple[list[Path], list[str]]:
    """Write a scene file as gprMax input files into a new folder, or draw it; give what was written, and words."""
    world = load_scene(scene)
    array = load_sensor(sensor)
    check_effort(world, None, force)
    written = []
    lines = []
    if preview is not None:
        written.append(_write_preview(world, seed, preview, force))
    if output is not None:
        decks = write_gprmax_decks(world, array, seed, output, cells_per_wavelength, max_cells)
        lines = [*decks.summary, *(f"left out: {one}" for one in decks.omissions)]
        written.append(Path(output))
    return written, lines


def _write_preview(scene: Scene, seed: int, path: PathLike, force: bool) -> Path:
    with whole_output(Path(path)) as made:
        preview_figure(scene, seed, force).savefig(
            made, dpi=100, format="png", metadata={"Software": None}
        )
    return Path(path)


def import_fullwave_lane(archive: PathLike, output: PathLike) -> list[Path]:
    """Import a full-wave archive into a new run store; return the paths that were written.

    :func:`flgpr.formats.import_fullwave` reads the archive.

    ``NAME-truth.csv`` and ``NAME-objects.csv`` are written beside it if the archive tells of them.
    """
    store = Path(output)
    lane = import_fullwave(archive)
    written = [store]
    if is_stored(lane.run, store):
        tell_finished(store)
        return written
    store.parent.mkdir(parents=True, exist_ok=True)
    for name, table in (("truth", lane.truth), ("objects", lane.objects)):
        if table is not None:
            path = store.with_name(f"{store.stem}-{name}.csv")
            write_table(table, path)
            write_geojson(table, path.with_suffix(".json"))
            written.append(path)
    save_run(lane.run, store, resume=True)
    return written
