"""Make the full-wave echoes of buried bodies by difference, with gprMax: the field with a body less that without it.

``FLGPR_GPRMAX_PYTHON=<python that has gprMax 4> python evidence/make_signatures.py FOLDER``
writes 20 input files into FOLDER, runs those that have no result yet (OMP_NUM_THREADS sets the
cores) and writes an archive per body into tests/data/signatures. ``--decks`` writes the input files
only, ``--archives`` reads the results only.

Flat homogeneous soil; one transmitter and nine receivers, ideal short dipoles along x (H) and z (V), about 1 m high;
the body stands 1.8 m ahead, at 60 degrees of incidence. One run has all four polarizations, for the scene is its own
mirror image in the plane x = 0, where the transmitters stand: both radiate at once, and what the horizontal one sends
is even in x in Ex and odd in Ez, what the vertical one sends odd in Ex and even in Ez.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr_exchange.gprmax.grid import rectangles
from flgpr_exchange.gprmax.output import fourier_integral, pulse, read_gprmax

ARCHIVES = Path(__file__).parent.parent / "tests" / "data" / "signatures"
FREQUENCY = 442.5e6 + 7.5e6 * np.arange(115)  # Hz, to 1.2975 GHz
SOILS = ((3.5, 0.002), (5.0, 0.004))  # permittivity, conductivity in S/m
COVERS = (0.015, 0.045, 0.0975)  # m
BODIES = {
    "metal": (0.12, 0.0),
    "gap": (0.15, 0.015),
    "solid": (0.15, 0.0),
}  # height, air under the top, m
PLASTIC = 2.9  # permittivity
RADIUS = 0.16  # m
AHEAD = 1.8  # m from the array to the body's centre
# m
TX_HEIGHT = 1.05
RX_HEIGHT = 0.99
RX_X = 0.1 * np.arange(-4, 5)  # m
ABSORBER = 10  # cells
CENTRE = 0.87e9  # Hz, of the pulse


EDGES = np.array([0.01, 0.01, 0.0075])  # m, of a cell
WINDOW = 25e-9  # s
# cells
BESIDE, BEHIND, ABOVE, BEYOND, UNDER = 11, 14, 14, 13, 8


def bounds():
    """Return the corners of the model in the frame of the array, m."""
    deep = max(COVERS) + max(height for height, _ in BODIES.values())
    absorber = ABSORBER * EDGES
    room = EDGES * [BESIDE, BEHIND, UNDER]
    low = np.array([RX_X[0], 0.0, -deep]) - room - absorber
    room = EDGES * [BESIDE, BEYOND, ABOVE]
    high = np.array([RX_X[-1], AHEAD + RADIUS, TX_HEIGHT]) + room + absorber
    return low, high


def node(*point):
    """Count the nodes (3,) from the model's corner to a point in the frame of the array."""
    return np.rint(np.array(point) / EDGES).astype(int) + np.rint(-bounds()[0] / EDGES).astype(int)


def place(node):
    """Write where a node lies in the model, m."""
    return " ".join(f"{value:.9g}" for value in node * EDGES)


def deck(soil, body=None, cover=0.0) -> str:
    """Write the input file of one model; body None is the soil alone."""
    low, high = bounds()
    shape = np.rint((high - low) / EDGES).astype(int)
    ground = np.array([shape[0], shape[1], node(0, 0, 0)[2]])
    lines = [
        f"#title: {body} {cover}",
        f"#domain: {place(shape)}",
        f"#dx_dy_dz: {place(np.ones(3))}",
        f"#time_window: {WINDOW:.9g}",
        f"#pml_cells: {ABSORBER}",
        f"#material: {soil[0]:g} {soil[1]:g} 1 0 soil",
        f"#material: {PLASTIC:g} 0 1 0 plastic",
        f"#box: 0 0 0 {place(ground)} soil",
        *_body(body, cover),
        f"#waveform: gaussiandotnorm 0.5 {CENTRE:.9g} pulse",
    ]
    # Ex lies half a cell further in x than its node and Ez in z: two cells stand for the point
    # between them.
    tx = node(0, 0, TX_HEIGHT)
    for axis in (0, 2):
        lines += [
            f"#hertzian_dipole: {'xyz'[axis]} {place(at)} pulse"
            for at in (tx - np.eye(3)[axis], tx)
        ]
    for number, x in enumerate(RX_X):
        rx = node(x, 0, RX_HEIGHT)
        for axis in (0, 2):
            name = f"r{number}{'xyz'[axis]}"
            lines += [
                f"#rx: {place(rx - np.eye(3)[axis])} {name}0 E{'xyz'[axis]}",
                f"#rx: {place(rx)} {name}1 E{'xyz'[axis]}",
            ]
    return "\n".join(lines) + "\n"


def _body(body, cover):
    """Write the boxes of a body: its cells are those whose centres lie within the radius."""
    if body is None:
        return []
    height, gap = BODIES[body]
    count = int(np.ceil(RADIUS / EDGES[0]))
    centres = (np.arange(-count, count) + 0.5) * EDGES[0]
    inside = rectangles(np.hypot(centres[:, None], centres) <= RADIUS)
    middle = node(0, AHEAD, 0)
    parts = [("pec" if body == "metal" else "plastic", gap, height)]
    if gap > 0:
        parts.append(("free_space", 0.0, gap))
    lines = []
    for material, upper, lower in parts:
        bottom, top = (middle[2] - round((cover + drop) / EDGES[2]) for drop in (lower, upper))
        for i0, i1, j0, j1 in inside:
            first = np.array([middle[0] + i0 - count, middle[1] + j0 - count, bottom])
            last = np.array([middle[0] + i1 - count, middle[1] + j1 - count, top])
            lines.append(f"#box: {place(first)} {place(last)} {material}")
    return lines


def received(path):
    """Field over current moment (polarization HH HV VH VV, receiver, frequency), Ω/m², sorted by parity in x."""
    output = read_gprmax(path)
    start = 0.5 * output.time_step  # the current's samples lie at half steps
    time = start + output.time_step * np.arange(output.steps)
    current = fourier_integral(
        pulse("gaussiandotnorm", CENTRE, time), output.time_step, FREQUENCY, start
    )
    field = {}
    for axis in (0, 2):
        component = "xyz"[axis]
        rows = [
            [
                output.spectrum(f"r{n}{component}{side}", f"E{component}", FREQUENCY)
                for side in (0, 1)
            ]
            for n in range(RX_X.size)
        ]
        field[component] = np.mean(rows, axis=1)
    even = {c: (f + f[::-1]) / 2 for c, f in field.items()}
    odd = {c: (f - f[::-1]) / 2 for c, f in field.items()}
    # moments of the two transmitters
    along = output.cell[0] * current
    up = output.cell[2] * current
    return 1j * np.stack([even["x"] / along, odd["z"] / along, odd["x"] / up, even["z"] / up])


def numerical_wavenumber(frequency, ray):
    """Wavenumber (frequency,) of a plane wave in the grid's air along a unit vector (Taflove & Hagness 2005, Ch. 4)."""
    step = 1 / (SPEED_OF_LIGHT * np.sqrt((EDGES**-2.0).sum()))
    wanted = (np.sin(np.pi * frequency * step) / (SPEED_OF_LIGHT * step)) ** 2
    k = 2 * np.pi * frequency / SPEED_OF_LIGHT
    for _ in range(20):  # Newton
        half = k[:, None] * ray * EDGES / 2
        value = ((np.sin(half) / EDGES) ** 2).sum(axis=1) - wanted
        k = k - value / (np.sin(2 * half) * ray / (2 * EDGES)).sum(axis=1)
    return k


def excess_phase():
    """Phase (receiver, frequency) by which the grid delays the way through the air and back, rad."""
    body = np.array([0.0, AHEAD, 0.0])
    phase = np.zeros((RX_X.size, FREQUENCY.size))
    k = 2 * np.pi * FREQUENCY / SPEED_OF_LIGHT
    for n, x in enumerate(RX_X):
        for antenna in (np.array([0, 0, TX_HEIGHT]), np.array([x, 0, RX_HEIGHT])):
            way = np.linalg.norm(body - antenna)
            phase[n] += way * (numerical_wavenumber(FREQUENCY, (body - antenna) / way) - k)
    return phase


def models():
    """Names of all models with soil, body and cover."""
    for soil in SOILS:
        yield f"eps{soil[0]:g}-empty", soil, None, 0.0
        for cover in COVERS:
            for body in BODIES:
                yield f"eps{soil[0]:g}-{body}-{1000 * cover:.0f}mm", soil, body, cover


def run(name, folder, python):
    """Run one model unless its result is there; gprMax writes it when all is done."""
    if not (folder / f"{name}.h5").is_file():
        print(name, flush=True)
        subprocess.run(
            [python, "-m", "gprMax", f"{name}.in"],
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
        )


def archive(name, soil, body, cover, folder):
    """Write the echo of a body."""
    echo = received(folder / f"{name}.h5") - received(folder / f"eps{soil[0]:g}-empty.h5")
    phase = excess_phase()
    height, gap = BODIES[body]
    output = read_gprmax(folder / f"{name}.h5")
    about = {
        "solver": f"gprMax {output.version}",
        "quantity": "j times the electric field over the transmitter's current moment, with the body less without it",
        "time_convention": "exp(+j 2 pi f t)",
        "frame": "x across, y ahead, z up, m; the ground is z = 0 and the transmitter stands over x = y = 0",
        "soil": {"permittivity": soil[0], "conductivity_s_per_m": soil[1]},
        "body": {
            "name": body,
            "position_m": [0.0, AHEAD, -cover],
            "cover_m": cover,
            "radius_m": RADIUS,
            "height_m": height,
            "air_under_top_m": gap,
            "permittivity": None if body == "metal" else PLASTIC,
        },
        "cells_m": EDGES.tolist(),
        "time_step_s": output.time_step,
        "steps": output.steps,
        "pulse": {"type": "gaussiandotnorm", "frequency_hz": CENTRE},
        "correction": "the grid's delay of the way through the air is taken off by its dispersion relation",
        "corrected_path_m": {
            f"{f / 1e6:g} MHz": round(float(p * SPEED_OF_LIGHT / (2 * np.pi * f)), 5)
            for f, p in zip(FREQUENCY[[0, 57, -1]], phase[4, [0, 57, -1]], strict=True)
        },
    }
    np.savez_compressed(
        ARCHIVES / f"{name}.npz",
        signal_ohm_per_m2=(echo * np.exp(1j * phase)).astype(np.complex64),
        frequency_hz=FREQUENCY,
        polarization=np.array(["HH", "HV", "VH", "VV"]),
        tx_position_m=np.tile([0.0, 0.0, TX_HEIGHT], (RX_X.size, 1)),
        rx_position_m=np.stack([RX_X, np.zeros(RX_X.size), np.full(RX_X.size, RX_HEIGHT)], axis=1),
        about=np.array(json.dumps(about)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where input files and results lie")
    parser.add_argument("--decks", action="store_true", help="write the input files only")
    parser.add_argument("--archives", action="store_true", help="read the results only")
    told = parser.parse_args()
    told.folder.mkdir(parents=True, exist_ok=True)
    ARCHIVES.mkdir(parents=True, exist_ok=True)
    for name, soil, body, cover in models():
        if not told.archives:
            (told.folder / f"{name}.in").write_text(deck(soil, body, cover))
        if not (told.decks or told.archives):
            run(name, told.folder, os.environ.get("FLGPR_GPRMAX_PYTHON", sys.executable))
        if body is not None and not told.decks:
            archive(name, soil, body, cover, told.folder)


if __name__ == "__main__":
    main()
