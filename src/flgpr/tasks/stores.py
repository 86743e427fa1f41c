"""Making runs and telling what they hold, as functions: files in, files out."""

from __future__ import annotations

import shutil
from pathlib import Path

from flgpr.chain.progress import Track, silent
from flgpr.io import import_fullwave, save_run, write_geojson, write_table
from flgpr.io.files import check_new
from flgpr.model import load_sensor
from flgpr.simulate import Scene, load_scene
from flgpr.simulate.effort import check_effort
from flgpr.simulate.signature import FREQUENCY, PERMITTIVITY, build_table, load_body, packaged_bodies, save_table
from flgpr.tasks.fullwave import write_gprmax_decks
from flgpr.tasks.simulation import preview_figure, simulate_to_store

PathLike = str | Path


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
    world, array = load_scene(scene), load_sensor(sensor)
    check_effort(world, None if output is None else array, force)
    written = []
    if preview is not None:
        written.append(_write_preview(world, seed, preview, force))
    if output is not None:
        written += simulate_to_store(world, array, seed, output, errors, track, resume, truth, force=force)
    return written


def make_signature(
    body: PathLike, output: PathLike | None = None, workers: int = 1, track: Track = silent
) -> list[Path]:
    """Compute the table of a body's scattering in the ground, which a scene's targets may name; a stopped call goes on.

    It is written to the body's name with ``.npz`` unless told, which must not exist; ``OUTPUT.work`` keeps what is
    done.
    """
    described = load_body(body)
    path = Path(f"{described.name}.npz" if output is None else output)
    check_new(path)
    work = path.with_name(path.name + ".work")
    pieces = PERMITTIVITY.size * FREQUENCY.size
    bar = iter(track(range(pieces), f"signature of {described.name}", pieces))
    shown = 0

    def show(done: int, _: int) -> None:
        nonlocal shown
        while shown < done:
            next(bar, None)
            shown += 1

    table = build_table(described, work, workers, show)
    next(bar, None)
    part = path.with_name(path.name + ".part")
    save_table(table, part)
    part.rename(path)
    shutil.rmtree(work)
    return [path]


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
    world, array = load_scene(scene), load_sensor(sensor)
    check_effort(world, None, force)
    written, lines = [], []
    if preview is not None:
        written.append(_write_preview(world, seed, preview, force))
    if output is not None:
        decks = write_gprmax_decks(world, array, seed, output, cells_per_wavelength, max_cells)
        lines = [*decks.summary, *(f"left out: {one}" for one in decks.omissions)]
        written.append(Path(output))
    return written, lines


def _write_preview(scene: Scene, seed: int, path: PathLike, force: bool) -> Path:
    preview_figure(scene, seed, force).savefig(path, dpi=100, format="png", metadata={"Software": None})
    return Path(path)


def import_fullwave_lane(archive: PathLike, output: PathLike) -> list[Path]:
    """Import a full-wave archive (:func:`flgpr.io.import_fullwave`) into a new run store, and give what was written.

    ``NAME-truth.csv`` and ``NAME-objects.csv`` are written beside it if the archive tells of them.
    """
    store = Path(output)
    check_new(store)
    lane, written = import_fullwave(archive), [store]
    store.parent.mkdir(parents=True, exist_ok=True)
    for name, table in (("truth", lane.truth), ("objects", lane.objects)):
        if table is not None:
            path = store.with_name(f"{store.stem}-{name}.csv")
            write_table(table, path)
            write_geojson(table, path.with_suffix(".geojson"))
            written.append(path)
    save_run(lane.run, store, resume=True)
    return written
