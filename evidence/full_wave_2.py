"""Lanes that gprMax computes, a solver of Maxwell's equations: the test lanes of the proving ground full-wave-2.

``python evidence/full_wave_2.py decks OUT`` writes its input files by evidence/full_wave_2.toml, a folder a lane.
``python evidence/full_wave_2.py solve OUT --python PYTHON`` runs gprMax (by an interpreter that has it) on every file
without a result, lane by lane: H is transmitted. It resumes; a run takes four minutes of two cores and more.
``python evidence/full_wave_2.py pack OUT SAMPLES`` imports what is complete as run stores with truth and objects.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import SPEED_OF_LIGHT, Sensor, load_sensor
from flgpr.simulate import Decks, Scene, draw_world, make_decks
from flgpr.store import write_table
from flgpr_exchange.commands.importing import import_gprmax_decks
from flgpr_exchange.gprmax.decks import SCENE_FILE

DECLARED = Path(__file__).with_suffix(".toml")


def declared() -> dict[str, Any]:
    """Return the declaration of all lanes."""
    return tomllib.loads(DECLARED.read_text("utf-8"))


def scene_of(common: dict[str, Any], lane: dict[str, Any]) -> Scene:
    """Return the scene of a lane, without its buried stones."""
    targets = []
    for sort, x, y, cover in lane["targets"]:
        targets.append({**common["sorts"][sort], "x": x, "y": y, "depth": cover})
    rocks = []
    for x, y, radius in lane["rocks"]:
        rocks.append({"kind": "rock", "x": x, "y": y, "radius": radius})
    return Scene.model_validate(
        {
            "name": lane["name"],
            "x_min": -common["half_width"],
            "x_max": common["half_width"],
            "length": common["length"],
            "soil": {
                "model": "fixed",
                "permittivity": lane["permittivity"],
                "conductivity": lane["conductivity"],
            },
            "surface": {
                "rms_height": lane["rms_height"],
                "correlation_length": common["correlation_length"],
            },
            "track": {"positions": common["stops"]},
            "targets": targets,
            "objects": rocks,
        }
    )


def transmitting_h() -> Sensor:
    """Return the array with what is received while H is transmitted: HH and HV."""
    return load_sensor("full-wave").model_copy(update={"polarization": ("HH", "HV")})


def decks_of(common: dict[str, Any], lane: dict[str, Any], sensor: Sensor) -> Decks:
    """Return the input files of a lane, with its buried stones."""
    scene = scene_of(common, lane)
    fastest = SPEED_OF_LIGHT / sensor.tones.axis()[-1]
    # A trifle less, so that the cell is rounded to the one that is declared and not below it.
    cells_per_wavelength = 0.999 * fastest / np.sqrt(lane["permittivity"]) / common["cell"]
    decks = make_decks(
        scene,
        sensor,
        lane["seed"],
        cells_per_wavelength=cells_per_wavelength,
        time_window=common["time_window"],
    )
    cell = decks.manifest["grid"]["cell"]
    if cell != common["cell"]:
        raise ValueError(f"cell must be {common['cell']}, got {cell}")
    decks.files[SCENE_FILE] += stone_lines(lane, decks.manifest["grid"]["origin"])
    return decks


def stone_lines(lane: dict[str, Any], origin: list[float]) -> str:
    """Return the lines of the buried stones of a lane."""
    lines = [f"#material: {lane['stone']:g} 0 1 0 stone"]
    for x, y, cover, radius in lane["stones"]:
        centre = np.array([x, y, -cover - radius]) - origin
        place = " ".join(f"{v:.9g}" for v in centre)
        lines.append(f"#sphere: {place} {radius:g} stone")
    return "\n".join(lines) + "\n"


def write_decks(out: Path) -> None:
    """Write the input files of all lanes, a folder each."""
    common = declared()
    sensor = transmitting_h()
    for lane in common["lanes"]:
        folder = out / lane["name"]
        folder.mkdir(parents=True)
        decks = decks_of(common, lane, sensor)
        for name, text in decks.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / "manifest.json").write_text(json.dumps(decks.manifest, indent=1))
        world = draw_world(scene_of(common, lane), lane["seed"])
        write_table(world.truth(), folder / "truth.csv")
        write_table(world.objects_table(), folder / "objects.csv")
        print(lane["name"], *decks.summary, *decks.omissions, sep="\n  ")


def solve(out: Path, interpreter: str) -> None:
    """Run gprMax on every input file that has no result, lane by lane."""
    for deck in sorted(out.glob("*/*-H.in")):
        if not deck.with_suffix(".h5").exists():
            _solve(deck, interpreter)


def _solve(deck: Path, interpreter: str) -> None:
    """Run gprMax on an input file; a run that is cut short leaves no result."""
    begun = time.perf_counter()
    partial = deck.parent / f"partial-{deck.stem}"
    command = [interpreter, "-m", "gprMax", str(deck), "-o", str(partial), "--hide-progress-bars"]
    log = deck.with_suffix(".log")
    with log.open("w") as stream:
        subprocess.run(command, stdout=stream, stderr=stream, check=True, cwd=deck.parent)
    os.replace(partial.with_suffix(".h5"), deck.with_suffix(".h5"))
    print(f"{deck.parent.name} {deck.stem}: {time.perf_counter() - begun:.0f} s", flush=True)


def pack(out: Path, samples: Path) -> None:
    """Import every lane whose results are there as a run store with its tables, and tell of the rest."""
    common = declared()
    for lane in common["lanes"]:
        folder = out / lane["name"]
        if not _is_solved(folder):
            print(f"{folder.name}: left out, results are missing")
            continue
        target = samples / lane["name"]
        target.mkdir(parents=True)
        for path in import_gprmax_decks(folder, target / "run.zarr")[1:]:
            path.unlink()  # the sample has tables of its own
        _write_tables(common, lane, target)
        (target / "README.md").write_text(readme_of(lane), encoding="utf-8")
        print(f"{folder.name}: packed")


def _write_tables(common: dict[str, Any], lane: dict[str, Any], folder: Path) -> None:
    """Write the targets, with the body of each, and the objects, with the buried stones."""
    world = draw_world(scene_of(common, lane), lane["seed"])
    bodies = [common["sorts"][sort]["body"] for sort, *_ in lane["targets"]]
    truth = world.truth().assign(body=bodies).round(6)  # to a micrometre: sums leave 0.1500…2
    write_table(truth, folder / "truth.csv")
    stones = []
    for number, (x, y, cover, radius) in enumerate(lane["stones"], start=1):
        stone = {"object_id": f"S{number:04d}", "x": x, "y": y, "kind": "stone", "radius": radius}
        stones.append(stone | {"height": -cover})
    objects = pd.concat([world.objects_table(), pd.DataFrame(stones)], ignore_index=True)
    write_table(objects, folder / "objects.csv")


def readme_of(lane: dict[str, Any]) -> str:
    """Return the README of a packaged lane."""
    conductivity = 1000 * lane["conductivity"]
    roughness = 1000 * lane["rms_height"]
    return f"""# {lane["name"].capitalize()}

A miniature forward-looking lane computed with gprMax 4.0.1 (finite differences in the time domain, 1.5 cm cells). No
code of flgpr made its fields; flgpr wrote the input files, by `evidence/full_wave_2.toml`, and read the results.

- `run.zarr`: 2 transmitters x 16 receivers 1.5 m above the ground, HH HV, 442.5 MHz to 1.5 GHz in 7.5 MHz steps,
  two scans. The direct wave, computed in air alone, is taken off; the reflection of the ground beneath is not.
- `truth.csv`: eight mines, two of each body, one under 3 cm of cover and one under 7.5 cm.
- `objects.csv`: four rocks half out of the ground, and four buried stones whose height is that of their top. They are
  no targets.

Soil: permittivity {lane["permittivity"]:g}, conductivity {conductivity:g} mS/m. Roughness: {roughness:g} mm rms, its
heights rounded to cells.
"""


def _is_solved(folder: Path) -> bool:
    """Return whether every result of a lane is there."""
    runs = json.loads((folder / "manifest.json").read_text("utf-8"))["runs"]
    names = {run["file"] for run in runs} | {run["free"] for run in runs}
    return all((folder / f"{name}.h5").exists() for name in names)


def main() -> None:
    """Run one of the three steps."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=["decks", "solve", "pack"])
    parser.add_argument("out", type=Path)
    parser.add_argument("samples", type=Path, nargs="?")
    parser.add_argument("--python", default=sys.executable, help="interpreter that has gprMax")
    options = parser.parse_args()
    if options.step == "decks":
        write_decks(options.out)
    elif options.step == "solve":
        solve(options.out, options.python)
    elif options.samples is None:
        parser.error("pack needs the folder of the samples")
    else:
        pack(options.out, options.samples)


if __name__ == "__main__":
    main()
