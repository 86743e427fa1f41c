"""Simulated lanes as files.

Pictures of scenes, and tables of what bodies scatter.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from matplotlib.figure import Figure

from flgpr.door import refuse_links
from flgpr.model import Sensor
from flgpr.model.sensor import LOW_ARRAY
from flgpr.progress import Track, silent
from flgpr.report.scene_preview import scene_figure
from flgpr.simulate import Scene
from flgpr.simulate.bodies.signature import (
    FREQUENCY,
    PERMITTIVITY,
    Body,
    SignatureTable,
    load_body,
    load_table,
    packaged_bodies,
    save_table,
)
from flgpr.simulate.preview import preview_scene
from flgpr.store.files import naming_output
from flgpr.store.outputs import (
    atomic_output,
    locked_folder,
    log_finished,
    output_exists_error,
    write_new,
)
from flgpr.types import PathLike


def ground_echo_lines(sensor: Sensor) -> list[str]:
    """Return what is simulated of the waves below and between the antennas, and what is assumed."""
    waves = []
    switches = []
    if sensor.has_specular_echo:
        waves.append("the echo of the mean surface below the array (specular_echo)")
        switches.append(sensor.specular_echo)
    if sensor.has_direct_wave:
        waves.append("the wave from antenna to antenna (direct_wave)")
        switches.append(sensor.direct_wave)
    if not waves:
        return []
    line = f"with {' and '.join(waves)}"
    if "auto" in switches:
        line += f": the array is lower than {LOW_ARRAY:g} m"
    lines = [line]
    if sensor.antenna.kind == "horn":
        level = f"{sensor.antenna.side_db:g} dB"
        lines.append(f"assumed: beside and behind, the horns' pattern is {level} (antenna.side_db)")
    return lines


def preview_figure(scene: Scene, seed: int, force: bool = False) -> Figure:
    """Draw a scene from above and in section, before anything is simulated.

    Parameters
    ----------
    scene : Scene
        The scene.
    seed : int
        Of everything random in it.
    force : bool
        Whether a scene is drawn that takes much memory and time.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ValueError
        If the scene holds more than can be drawn in reasonable memory and time.
    """
    preview = preview_scene(scene, seed, force)
    return scene_figure(
        preview.title,
        preview.lane,
        preview.targets,
        preview.objects,
        preview.patches,
        preview.half_width,
    )


def write_preview(scene: Scene, seed: int, path: PathLike, force: bool) -> Path:
    """Draw a scene and write it as PNG.

    Parameters
    ----------
    scene : Scene
        The scene.
    seed : int
        Of everything random in it.
    path : path
        PNG to write.
    force : bool
        As for :func:`preview_figure`.

    Returns
    -------
    pathlib.Path
        The file.
    """
    from flgpr.report import figure_png  # loads what pages are made with

    target = Path(path)
    figure = preview_figure(scene, seed, force)
    write_new(target, figure_png(figure, dpi=100))
    return target


def make_signature(
    body: PathLike, output: PathLike | None = None, workers: int = 1, track: Track = silent
) -> list[Path]:
    """Compute the table of what a body scatters in the ground, which a scene's targets may name.

    An interrupted call resumes: ``OUTPUT.work`` keeps the finished pieces.

    Parameters
    ----------
    body : path
        Packaged body or TOML.
    output : path, optional
        Table to write, by default the body's name with ``.npz``.
    workers : int
        Number of processes.
    track : Track
        Shows progress.

    Returns
    -------
    list of pathlib.Path
        The table; one of this body that exists stays.

    Raises
    ------
    FileExistsError
        If another file is at the output, or it or its work folder is a symbolic link.
    """
    loaded_body = load_body(body)
    path = Path(f"{loaded_body.name}.npz" if output is None else output)
    work_folder = path.with_name(path.name + ".work")
    refuse_links(path, work_folder)
    if os.path.lexists(path):
        if not _is_table_of(loaded_body, path):
            raise output_exists_error(path)
        # An earlier call may have been interrupted between the table and this.
        shutil.rmtree(work_folder, ignore_errors=True)
        log_finished(path)
        return [path]

    path.parent.mkdir(parents=True, exist_ok=True)
    with naming_output(path), locked_folder(work_folder, output=path):
        table = _computed_table(loaded_body, work_folder, workers, track)
        with atomic_output(path) as partial:
            save_table(table, partial)
        shutil.rmtree(work_folder)
    return [path]


def _is_table_of(body: Body, path: Path) -> bool:
    """Return whether a file is the table of a body."""
    try:
        return load_table(path).body == body
    except ValueError:
        return False


def _computed_table(body: Body, work_folder: Path, workers: int, track: Track) -> SignatureTable:
    """Compute a body's table with a progress bar that counts the pieces."""
    try:
        from flgpr.simulate.bodies.signature import build_table  # a name of flgpr_ground
    except ImportError:
        raise ValueError(
            f"the table of {body.name} must be computed by the package flgpr_ground, "
            "which is not installed"
        ) from None
    pieces = PERMITTIVITY.size * FREQUENCY.size
    bar = iter(track(range(pieces), f"signature of {body.name}", pieces))
    shown = 0

    def show_progress(done: int, _: int) -> None:
        nonlocal shown
        while shown < done:
            next(bar, None)
            shown += 1

    # The bar goes on by steps; pieces of an earlier call are counted at once.
    table = build_table(body, work_folder, workers, show_progress)
    next(bar, None)
    return table


def list_bodies() -> list[str]:
    """Return a line for each packaged body: name, size (cm) and source."""
    lines = []
    for name in packaged_bodies():
        body = load_body(name)
        width = 2 * body.radius * body.elongation * 100
        height = body.height * 100
        lines.append(f"{body.name:18} {width:5.1f} cm across, {height:4.1f} cm high: {body.source}")
    return lines
