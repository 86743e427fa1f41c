"""Compare the simulator with the packaged full-wave lane: same geometry, soil and targets, 50 surfaces.

Writes docs/images/fullwave-images.png and docs/images/fullwave-levels.png and prints the table of
docs/evidence/validation-simulator.md. Everything is set from the full-wave lane's own description;
the surface's correlation length, which it does not give, is assumed. Nothing is fitted but one
common scale, since the full-wave data have none: the median over targets and channels. The plastic
mine is left out: with it taken away, the level at its place is the same, so that clutter would be
compared with clutter. The lane's data are the field over the change of the transmitter's current; they are compared
as the field over the current (`per_current`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from flgpr.imaging import ScanImager
from flgpr.model import Grid, lane_to_scan, load_sensor
from flgpr.simulate import Scene, Simulator
from flgpr.store import open_run, read_table, sample_lane

BAND = {"0.45-1.2": (0.45e9, 1.2e9)}  # the full-wave cells are fine enough below 1.2 GHz
GRID = Grid.spanning((-1.4, 1.4), (1.2, 5.84), 0.025)
REACH = 0.40  # m around each target
SURFACES = 50
IMAGES = Path(__file__).parent.parent / "docs" / "images"


def lane_scene(run, truth, objects) -> Scene:
    soil = run.attrs["soil"]
    targets = [
        {name: row[name] for name in ("kind", "x", "y", "depth", "radius", "height")}
        for row in truth.to_dict("records")
    ]
    rock = next(row for row in objects.to_dict("records") if row["kind"] == "rock")
    post = next(row for row in objects.to_dict("records") if row["kind"] == "post")
    return Scene(
        name="lane a, simulated",
        length=7.0,
        soil={
            "model": "fixed",
            "permittivity": soil["permittivity"],
            "conductivity": soil["conductivity"],
        },
        # Heights within ±1.8 cm: three standard deviations. The correlation length is not stated.
        surface={
            "rms_height": 0.006,
            "correlation_length": 0.1,
            "slope": 0.0,
            "texture_shape": None,
        },
        targets=targets,
        objects=[
            {"kind": "rock", "x": rock["x"], "y": rock["y"], "radius": rock["radius"]},
            {
                "kind": "post",
                "x": post["x"],
                "y": post["y"],
                "radius": 0.03,
                "height": post["height"],
            },
        ],
        track={"positions": tuple(run["pose"].values[:, 1])},
    )


def per_current(run):
    """Return the packaged lane's run as the field over the transmitter's current, on the lane's scale at 1 GHz.

    Its direct wave is the closed form of a short dipole times f to the power -1.00, to 0.005 dB (rms over tones), and
    turned by half a turn: the field was divided by the change of the current, jω times the current.
    """
    factor = -(run["frequency"] / 1e9)
    return run.assign(signal=(run["signal"] * factor).astype(np.complex64))


def levels(run, places) -> tuple[np.ndarray, np.ndarray, list]:
    """Peak near each place per scan and polarization, dB, and where it lies; (place, polarization), images."""
    imager = ScanImager(run, GRID, BAND, window="hann", tolerance=1e-3)
    images = list(imager)
    peak = np.zeros((len(images), len(places), run.sizes["polarization"]))
    at = np.zeros((*peak.shape, 2))
    points = GRID.points()
    for k, image in enumerate(images):
        for i, place in enumerate(places):
            local = lane_to_scan([*place, 0.0], image.attrs["pose"])
            near = np.hypot(points[..., 0] - local[0], points[..., 1] - local[1]) <= REACH
            for p in range(peak.shape[2]):
                values = np.where(near, np.abs(image.values[p, 0]), 0)
                row, column = np.unravel_index(values.argmax(), values.shape)
                peak[k, i, p] = values[row, column]
                at[k, i, p] = points[row, column, :2] - local[:2]
    return 20 * np.log10(np.sqrt(np.mean(peak**2, axis=0))), np.median(at, axis=0), images


def main() -> None:
    folder = sample_lane()
    run = per_current(open_run(folder / "run.zarr"))
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    scene = lane_scene(run, truth, objects)
    sensor = load_sensor("full-wave")
    truth = truth[truth["kind"] == "metal"]
    names = [f"{kind} mine {i + 1}" for i, kind in enumerate(truth["kind"])] + list(objects["kind"])
    places = np.concatenate([truth[["x", "y"]].to_numpy(), objects[["x", "y"]].to_numpy()])
    want, want_at, want_images = levels(run, places)
    got = []
    got_at = []
    first = None
    for seed in range(SURFACES):
        level, at, images = levels(Simulator(scene, sensor, seed).run(), places)
        got.append(level)
        got_at.append(at)
        first = first or images
        print(f"surface {seed + 1} of {SURFACES}", end="\r", flush=True)
    got = np.array(got)
    got_at = np.array(got_at)
    pols = list(run["polarization"].values)
    co = [pols.index("HH"), pols.index("VV")]
    scale = np.median((want - np.median(got, axis=0))[:, co])
    draw_images(want_images[1], first[1], places)
    draw_levels(names, pols, want - scale, got)
    report(names, pols, want - scale, got, want_at, got_at)


def report(names, pols, want, got, want_at, got_at) -> None:
    hh = pols.index("HH")
    vv = pols.index("VV")
    print("| target | quantity | full wave | simulated, median (95 % of 50 surfaces) | within |")
    print("|---|---|---|---|---|")
    rows = []
    for i, name in enumerate(names):
        rows += [
            (name, "HH level (dB)", want[i, hh], got[:, i, hh]),
            (name, "VV level (dB)", want[i, vv], got[:, i, vv]),
            (name, "HH/VV (dB)", want[i, hh] - want[i, vv], got[:, i, hh] - got[:, i, vv]),
        ]
    for label, p in (("HH (dB)", hh), ("VV (dB)", vv)):
        over = want[1, p] - want[0, p], got[:, 1, p] - got[:, 0, p]
        rows.append(("metal 2 over metal 1", label, *over))
    for name, quantity, value, values in rows:
        low, middle, high = np.percentile(values, [2.5, 50, 97.5])
        verdict = (
            "yes"
            if low <= value <= high
            else f"no, by {min(abs(value - low), abs(value - high)):.1f} dB"
        )
        print(
            f"| {name} | {quantity} | {value:.1f} | {middle:.1f} ({low:.1f} to {high:.1f}) | {verdict} |"
        )
    print()
    for i, name in enumerate(names):
        for label, p in (("HH", hh), ("VV", vv)):
            away = np.hypot(*(want_at[i, p] - np.median(got_at[:, i, p], axis=0)))
            print(
                f"{name} {label}: peak at {want_at[i, p].round(3)} m from truth; simulated "
                f"{np.median(got_at[:, i, p], axis=0).round(3)}; apart {away:.3f} m"
            )


def draw_images(full, simulated, places) -> None:
    figure = Figure(figsize=(13, 6.2), layout="constrained")
    for j, (label, image) in enumerate((("full wave", full), ("simulated", simulated))):
        for i, polarization in enumerate(("HH", "VV")):
            axes = figure.add_subplot(1, 4, 2 * i + j + 1)
            level = 20 * np.log10(np.abs(image.sel(polarization=polarization).values[0]))
            inside = np.abs(image["x"].values) < 1.0
            level = level - level[20:, inside].max()
            y = image["y"].values + image.attrs["pose"][1]
            mesh = axes.pcolormesh(
                image["x"],
                y,
                level,
                vmin=-30,
                vmax=0,
                cmap="viridis",
                shading="nearest",
                rasterized=True,
            )
            axes.plot(*places.T, "s", mfc="none", mec="red", ms=9)
            axes.set(
                aspect="equal",
                title=f"{polarization}, {label}",
                xlabel="x (m)",
                ylabel="y (m)" if not (i + j) else "",
            )
    figure.colorbar(mesh, ax=figure.axes, shrink=0.7, label="dB re strongest pixel of the lane")
    figure.savefig(IMAGES / "fullwave-images.png", dpi=75, metadata={"Software": None})


def draw_levels(names, pols, want, got) -> None:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for shift, polarization in ((-0.15, "HH"), (0.15, "VV")):
        p = pols.index(polarization)
        place = np.arange(len(names)) + shift
        low, middle, high = np.percentile(got[:, :, p], [2.5, 50, 97.5], axis=0)
        colour = "C0" if polarization == "HH" else "C1"
        axes.errorbar(
            place,
            middle,
            [middle - low, high - middle],
            fmt="o",
            color=colour,
            capsize=4,
            label=f"{polarization}, 50 surfaces (median, 95 %)",
        )
        axes.plot(
            place, want[:, p], "x", color=colour, ms=9, mew=2, label=f"{polarization}, full wave"
        )
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel("level (dB, one common scale)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(IMAGES / "fullwave-levels.png", dpi=80, metadata={"Software": None})


if __name__ == "__main__":
    main()
