"""``flgpr simulate``: simulate lanes, or write decks for a full-wave solver or tables of bodies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import OptionalOutput, PathLike, Progress
from flgpr.commands.shell import Arguments, command, options_given

if TYPE_CHECKING:
    from flgpr.model import Sensor

_OWN_ENGINE = "flgpr"
_OF_SIGNATURES = {"scene", "body", "output", "workers"}
_OF_DRAWINGS = {"scene", "sensor", "seed", "drive", "worlds", "preview", "force"}
_OF_DECKS = _OF_DRAWINGS | {"output", "engine", "cells", "max_cells"}
_OF_LANES = _OF_DRAWINGS | {"output", "errors", "truth", "restart"}


@dataclass(frozen=True)
class SimulationOutput:
    """The files that a simulation wrote, and lines of text about them."""

    paths: list[Path]
    lines: list[str]


def _lines(written: SimulationOutput, _: Arguments) -> Iterator[str]:
    """Yield the lines about the files, then the files."""
    yield from written.lines
    for path in written.paths:
        yield f"wrote {path}"


@command(
    lines=_lines,
    resumes=True,
)
def simulate_lane(
    scene: PathLike,
    body: Annotated[str | None, Argument()] = None,
    output: OptionalOutput = None,
    sensor: str = "sri-array",
    seed: int = 1,
    drive: Annotated[int, Option(min=1)] = 1,
    worlds: PathLike | None = None,
    errors: Annotated[bool, Option("--errors/--no-errors")] = True,
    preview: PathLike | None = None,
    truth: PathLike | None = None,
    restart: bool = False,
    force: bool = False,
    engine: str = ("flgpr"),
    cells: float = 10.0,
    max_cells: float = 3e8,
    workers: Annotated[int, Option(min=1)] = 1,
    *,
    track: Progress = None,
) -> SimulationOutput:
    """Simulate a lane with truth. With --preview alone only draw the scene.

    An interrupted simulation resumes. simulate signature BODY computes what a body scatters in the
    ground; it resumes, too.

    Parameters
    ----------
    scene
        Scene (TOML), or the word signature.
    output
        run store, folder of decks or table
    body
        After signature: body (TOML) whose table to make, or none to list them.

    Scene and sensor
    ----------------
    sensor
        Sensor preset, TOML file, or run store whose array it is.
    seed
        The same seed gives the same lane, bit for bit.
    drive
        Of a scene with later drives over the road: which one.
    worlds
        What of scene and sensor the seed draws anew, for training: any-road, or a TOML file.
    errors
        Whether the sensor's errors are added.
    truth
        CSV of the truth; by default NAME-truth.csv.
    preview
        PNG of the scene to write.

    Full-wave solver
    ----------------
    engine
        flgpr simulates; gprmax writes a full-wave solver's input files.
    cells
        gprmax: cells per wavelength at the highest tone in the soil.
    max_cells
        gprmax: largest model that is written.

    Work
    ----
    restart
        Begin again where an interrupted run left scans.
    force
        Simulate or draw even where the estimate of memory or time is very large.
    workers
        signature: processes.

    Returns
    -------
    SimulationOutput
        Paths of the files that were written, and lines of text about them.

    Raises
    ------
    ValueError
        If scene or sensor break a rule, or the lane would take too much memory or time.
    FileExistsError
        If another lane is at the output.
    """
    asked = locals()
    from flgpr.progress import silent

    if str(scene) == "signature":
        from flgpr.commands.simulation import list_bodies, make_signature

        if body is None:
            _refuse_idle(asked, {"scene"}, "bodies are listed")
            return SimulationOutput([], list_bodies())
        _refuse_idle(asked, _OF_SIGNATURES, "a body is computed")
        return SimulationOutput(make_signature(body, output, workers, track or silent), [])
    if body is not None:
        raise ValueError(f"only simulate signature takes a second argument, got {body!r}")
    engines = {one.name: one for one in entry_points(group="flgpr.engines")}
    if engine != _OWN_ENGINE and engine not in engines:
        raise ValueError(
            f"engine must be one of {', '.join([_OWN_ENGINE, *sorted(engines)])}, got {engine!r}"
        )
    if output is None and preview is None:
        raise ValueError("simulate needs `output` or `preview`, got neither")
    if output is None:
        _refuse_idle(asked, _OF_DRAWINGS, "a scene is only drawn")
    elif engine == _OWN_ENGINE:
        _refuse_idle(asked, _OF_LANES, "flgpr simulates a lane")
    else:
        _refuse_idle(asked, _OF_DECKS, f"{engine} makes the output")
    from flgpr.commands.simulation import ground_echo_lines, write_preview
    from flgpr.jobs.simulated_lane import simulate_to_store
    from flgpr.simulate import load_scene
    from flgpr.simulate.effort import check_effort
    from flgpr.simulate.scene.randomised import draw_into, load_worlds
    from flgpr.simulate.scene.scene_doubts import scene_doubts

    loaded_scene = load_scene(scene).at_drive(drive)
    array = _array(sensor)
    lines: list[str] = []
    if worlds is not None:
        loaded_scene, array, drawn = draw_into(load_worlds(worlds), loaded_scene, array, seed)
        lines.append(f"drawn by seed {seed}: {', '.join(drawn)}")
    is_simulated = output is not None and engine == _OWN_ENGINE
    check_effort(loaded_scene, array if is_simulated else None, force)
    lines += scene_doubts(loaded_scene, seed)
    if is_simulated and errors:
        lines += array.idle_errors()

    paths = []
    if preview is not None:
        paths.append(write_preview(loaded_scene, seed, preview, force))
    if output is not None and engine != _OWN_ENGINE:
        decks = engines[engine].load()(loaded_scene, array, seed, output, cells, max_cells)
        lines += decks.summary
        lines += [f"left out: {reason}" for reason in decks.omissions]
        paths.append(Path(output))
    elif output is not None:
        lines += ground_echo_lines(array)
        with _restart_named():
            paths += simulate_to_store(
                loaded_scene,
                array,
                seed,
                output,
                errors,
                track or silent,
                resume=not restart,
                truth=truth,
                force=force,
            )
    return SimulationOutput(paths, lines)


def _refuse_idle(asked: dict[str, Any], used: set[str], task: str) -> None:
    """Refuse an option that does nothing in a task."""
    for name in options_given(simulate_lane, asked):
        if name not in used:
            raise ValueError(f"`{name}` does nothing where {task}, got {asked[name]}")


def _array(sensor: str) -> Sensor:
    """Return the sensor of a name or file, or that of the array of a stored run."""
    from flgpr.model import load_sensor

    if not Path(sensor).is_dir():
        return load_sensor(sensor)
    from flgpr.model.faults import faults_of
    from flgpr.recipe.make import sensor_for
    from flgpr.store import open_run

    run = open_run(sensor)
    with faults_of(sensor):
        return sensor_for(run)


@contextmanager
def _restart_named() -> Iterator[None]:
    """Name the option that begins again where an unfinished lane of other options is refused."""
    from flgpr.store import RunStoreError
    from flgpr.store.journal import OtherRunError

    try:
        yield
    except RunStoreError as error:
        if not isinstance(error.__cause__, OtherRunError):
            raise
        raise ValueError(f"{error}; `restart` begins again, or choose another output") from None
