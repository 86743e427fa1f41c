"""Lanes that gprMax computes, a solver of Maxwell's equations: test lanes of the full-wave tracks.

LANES is a declaration, ``full_wave_2.toml``, ``full_wave_3.toml`` or ``pose_full_wave.toml``, beside this file.

``python evidence/full_wave_lanes.py decks LANES OUT`` writes the input files, a folder a lane.
``python evidence/full_wave_lanes.py solve LANES OUT --python PYTHON`` runs gprMax (by an interpreter that has it) on
every file without a result, lane by lane, and keeps the tones of a run in ``evidence/full_wave_tones`` as soon as it
ends. It resumes; a run takes four to eight minutes of two cores and more.
``python evidence/full_wave_lanes.py pack LANES SAMPLES`` writes lanes all of whose tones are there as run stores with
truth and objects, and tells what is missing of the others.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import SPEED_OF_LIGHT, Sensor, load_sensor, make_run
from flgpr.simulate import Decks, Scene, draw_world, make_decks
from flgpr.store import save_run, write_table
from flgpr_exchange.commands.importing import attributes_of_decks
from flgpr_exchange.gprmax.deck_results import MANIFEST, GprmaxRun
from flgpr_exchange.gprmax.decks import SCENE_FILE

TONES = Path(__file__).parent / "full_wave_tones"


def declared(lanes: Path) -> dict[str, Any]:
    """Return the declaration of all lanes."""
    return tomllib.loads(lanes.read_text("utf-8"))


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


def array_of(common: dict[str, Any]) -> Sensor:
    """Return the array with what is received while the declared polarizations are transmitted."""
    sensor = load_sensor("full-wave")
    received = [name for name in sensor.polarization if name[0] in common["transmit"]]
    changed: dict[str, Any] = {"polarization": tuple(received)}
    if "transmitters" in common:
        changed["tx"] = [tuple(place) for place in common["transmitters"]]
    return sensor.model_copy(update=changed)


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


def write_decks(common: dict[str, Any], out: Path) -> None:
    """Write the input files of all lanes, a folder each."""
    sensor = array_of(common)
    for lane in common["lanes"]:
        folder = out / lane["name"]
        folder.mkdir(parents=True)
        decks = decks_of(common, lane, sensor)
        for name, text in decks.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / MANIFEST).write_text(json.dumps(decks.manifest, indent=1))
        print(lane["name"], *decks.summary, *decks.omissions, sep="\n  ")


def solve(common: dict[str, Any], out: Path, interpreter: str) -> None:
    """Run gprMax on every input file whose tones are not there, lane by lane, and keep the tones."""
    for lane in common["lanes"]:
        folder = out / lane["name"]
        manifest = json.loads((folder / MANIFEST).read_text("utf-8"))
        for run in manifest["runs"]:
            tones = tones_file(lane, run)
            if tones.exists():
                continue
            for name in (run["free"], run["file"]):
                if not (folder / f"{name}.h5").exists():
                    _solve(folder / f"{name}.in", interpreter)
            _keep_tones(folder, manifest, run, tones)


def tones_file(lane: dict[str, Any], run: dict[str, Any]) -> Path:
    """Return where the tones of a run are kept."""
    return TONES / f"{lane['name']}-{run['file']}.npy"


def _solve(deck: Path, interpreter: str) -> None:
    """Run gprMax on an input file; a run that is cut short leaves no result."""
    begun = time.perf_counter()
    partial = deck.parent / f"partial-{deck.stem}"
    command = [interpreter, "-m", "gprMax", str(deck), "-o", str(partial), "--hide-progress-bars"]
    # gprMax refuses stones of permittivity 8 for what its pulse has above the tones that are kept.
    # At the highest of these a wavelength in such a stone has 4.7 cells.
    command.append("--allow-underresolved")
    log = deck.with_suffix(".log")
    with log.open("w") as stream:
        subprocess.run(command, stdout=stream, stderr=stream, check=True, cwd=deck.parent)
    os.replace(partial.with_suffix(".h5"), deck.with_suffix(".h5"))
    print(f"{deck.parent.name} {deck.stem}: {time.perf_counter() - begun:.0f} s", flush=True)


def _keep_tones(folder: Path, manifest: dict[str, Any], run: dict[str, Any], tones: Path) -> None:
    """Write the tones (polarization, pair, frequency) of one run, NaN where it measured nothing."""
    with tempfile.TemporaryDirectory() as alone:
        Path(alone, MANIFEST).write_text(json.dumps(manifest | {"runs": [run]}))
        for name in {run["free"], run["file"]}:
            os.link(folder / f"{name}.h5", Path(alone, f"{name}.h5"))
        signal = GprmaxRun(alone).scan(run["scan"])
    TONES.mkdir(exist_ok=True)
    measured = np.isfinite(signal).all(axis=2)
    partial = tones.with_suffix(".partial")
    with partial.open("wb") as file:
        np.save(file, signal[measured])
    os.replace(partial, tones)


def pack(common: dict[str, Any], samples: Path) -> None:
    """Write every lane whose tones are there as a run store with its tables, and tell of the rest."""
    sensor = array_of(common)
    for lane in common["lanes"]:
        manifest = decks_of(common, lane, sensor).manifest
        missing = [run["file"] for run in manifest["runs"] if not tones_file(lane, run).exists()]
        if missing:
            done = len(manifest["runs"]) - len(missing)
            print(f"{lane['name']}: left out, {done} of {len(manifest['runs'])} runs are solved")
            continue
        target = samples / lane["name"]
        target.mkdir(parents=True)
        save_run(run_of(lane, manifest), target / "run.zarr")
        _write_tables(common, lane, target)
        (target / "README.md").write_text(readme_of(common, lane), encoding="utf-8")
        print(f"{lane['name']}: packed")


def run_of(lane: dict[str, Any], manifest: dict[str, Any]) -> Any:
    """Put the tones of all runs of a lane together."""
    labels = manifest["polarization"]
    tones = manifest["tones"]
    pairs = len(manifest["tx_position"])
    signal = np.full((len(manifest["pose"]), len(labels), pairs, tones["count"]), np.nan, complex)
    for run in manifest["runs"]:
        rows = [row for row, label in enumerate(labels) if label[0] == run["transmit"]]
        values = np.load(tones_file(lane, run), allow_pickle=False)
        of_run = values.reshape(len(rows), len(run["pairs"]), -1)
        signal[run["scan"]][np.ix_(rows, run["pairs"])] = of_run
    return make_run(
        signal.astype(np.complex64),
        tones["start"] + tones["step"] * np.arange(tones["count"], dtype=np.float64),
        labels,
        np.array(manifest["tx_position"]),
        np.array(manifest["rx_position"]),
        np.array(manifest["pose"]),
        np.array(manifest["time"]),
        attributes_of_decks(manifest, keep_direct=False),
    )


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


def readme_of(common: dict[str, Any], lane: dict[str, Any]) -> str:
    """Return the README of a packaged lane."""
    conductivity = 1000 * lane["conductivity"]
    roughness = 1000 * lane["rms_height"]
    mines = len(lane["targets"])
    return f"""# {lane["name"].capitalize()}

A miniature forward-looking lane computed with gprMax 4.0.1 (finite differences in the time domain, 1.5 cm cells). No
code of flgpr made its fields; flgpr wrote the input files, by the declaration in `evidence/`, and read the results.

- `run.zarr`: 2 transmitters x 16 receivers 1.5 m above the ground, {" ".join(array_of(common).polarization)},
  442.5 MHz to 1.5 GHz in 7.5 MHz steps, two scans. The direct wave, computed in air alone, is taken off; the
  reflection of the ground beneath is not.
- `truth.csv`: {mines} mines.
- `objects.csv`: {len(lane["rocks"])} rocks half out of the ground, and {len(lane["stones"])} buried stones whose
  height is that of their top. They are no targets.

Soil: permittivity {lane["permittivity"]:g}, conductivity {conductivity:g} mS/m. Roughness: {roughness:g} mm rms, its
heights rounded to cells.
"""


def main() -> None:
    """Run one of the three steps."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=["decks", "solve", "pack"])
    parser.add_argument("lanes", type=Path, help="declaration, a TOML file")
    parser.add_argument("out", type=Path, help="folder of the decks, or of the samples")
    parser.add_argument("--python", default=sys.executable, help="interpreter that has gprMax")
    options = parser.parse_args()
    common = declared(options.lanes)
    if options.step == "decks":
        write_decks(common, options.out)
    elif options.step == "solve":
        solve(common, options.out, options.python)
    else:
        pack(common, options.out)


if __name__ == "__main__":
    main()
