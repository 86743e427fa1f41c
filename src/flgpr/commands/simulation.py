"""Simulated lanes as files: by our own physics, or as decks for a full-wave solver; tables of bodies."""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from flgpr.chain.progress import Track, silent
from flgpr.model import Sensor
from flgpr.simulate import Decks, Scene, World, draw_world, make_decks
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
from flgpr.simulate.effort import check_effort
from flgpr.store import lane_text, write_geojson, write_table, write_whole
from flgpr.store.outputs import held_folder, other_output, tell_finished, whole_output

PathLike = str | Path
_COLOUR = {
    "metal": "C3",
    "plastic": "C0",
    "simulant": "C2",
    "rock": "0.5",
    "post": "black",
    "bush": "C2",
}


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
            (resources.files("flgpr.commands") / "gprmax.toml").read_text(encoding="utf-8")
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


def write_preview(scene: Scene, seed: int, path: PathLike, force: bool) -> Path:
    """Draw a scene and write it as PNG."""
    from flgpr.report import figure_png  # loads what pages are made with

    with whole_output(Path(path)) as made:
        made.write_bytes(figure_png(preview_figure(scene, seed, force), dpi=100))
    return Path(path)
