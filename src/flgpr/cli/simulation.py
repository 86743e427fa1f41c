"""The command that simulates: lanes by our own physics or as decks for a full-wave solver, and bodies' tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.chain.progress import Track
from flgpr.cli.common import Quiet, plain_errors, progress

ENGINES = ("flgpr", "gprmax")


def simulate(
    scene: Annotated[Path, Argument(help="Scene (TOML), or the word signature.")],
    body: Annotated[
        str | None,
        Argument(help="After signature: body (TOML) whose table to make, or none to list them."),
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Run store, folder of decks or table to make.")
    ] = None,
    sensor: Annotated[str, Option(help="Sensor preset or TOML file.")] = "sri-array",
    seed: Annotated[int, Option(help="The same seed gives the same lane, bit for bit.")] = 1,
    errors: Annotated[
        bool, Option("--errors/--no-errors", help="Whether the sensor's errors are added.")
    ] = True,
    preview: Annotated[Path | None, Option(help="PNG of the scene to write.")] = None,
    truth: Annotated[
        Path | None, Option(help="CSV of the truth; by default NAME-truth.csv.")
    ] = None,
    restart: Annotated[
        bool, Option("--restart", help="Begin again where a stopped run left scans.")
    ] = False,
    force: Annotated[
        bool,
        Option(
            "--force",
            help="Simulate or draw even what is estimated to take very much memory or time.",
        ),
    ] = False,
    engine: Annotated[
        str, Option(help="flgpr simulates; gprmax writes a full-wave solver's input files.")
    ] = ("flgpr"),
    cells: Annotated[
        float, Option(help="gprmax: cells per wavelength at the highest tone in the soil.")
    ] = 10.0,
    max_cells: Annotated[float, Option(help="gprmax: largest model that is written.")] = 3e8,
    workers: Annotated[int, Option(min=1, help="signature: processes.")] = 1,
    quiet: Quiet = False,
) -> None:
    """Simulate a lane with truth; a stopped simulation goes on. With --preview alone only draw the scene.

    simulate signature BODY computes what a body scatters in the ground; it goes on where it was stopped, too.
    """
    with plain_errors(quiet), progress(quiet) as track:
        if str(scene) == "signature":
            _signature(body, output, workers, quiet, track)
            return
        if body is not None:
            raise ValueError(f"only simulate signature takes a second argument, got {body!r}")
        if engine not in ENGINES:
            raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
        if output is None and preview is None:
            raise ValueError("simulate needs --output or --preview, got neither")
        if engine == "gprmax":
            written, lines = tasks.write_gprmax_lane(
                scene, sensor, seed, output, preview, cells, max_cells, force
            )
        else:
            written = tasks.simulate_lane(
                scene, sensor, seed, output, preview, errors, track, not restart, truth, force
            )
            lines = []
    if not quiet:
        for line in [*lines, *(f"wrote {path}" for path in written)]:
            typer.echo(line)


def _signature(
    body: str | None, output: Path | None, workers: int, quiet: bool, track: Track
) -> None:
    """Make a body's table, or list the bodies there are."""
    if body is None:
        for line in tasks.list_bodies():
            typer.echo(line)
        return
    for path in tasks.make_signature(body, output, workers, track):
        if not quiet:
            typer.echo(f"wrote {path}")
