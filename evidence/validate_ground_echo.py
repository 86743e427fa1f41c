"""The ground's echo: full-wave lanes beside their twins, plain, and with the ground and its echo below the array.

``python evidence/validate_ground_echo.py [--surfaces 8] [--figure docs/images/ground-echo.png]`` prints the tables of
docs/evidence/validation-simulator.md and draws the figure; two minutes of one core. A twin is the declared scene of a
lane by the simulator, over a surface drawn anew; nothing is fitted. Three quantities are compared, each full wave less
twins, with the goals that were set before:

- power of the signal by path, whole band under a Hann window: within 2 dB from a path of 3 m on;
- power of the image by distance ahead, in the sub-bands of `fused` and the wide band of C_HH: within 3 dB everywhere;
- covariance of clutter, in the chips of `fused` before `early`: its divergence from that of twins below 0.2 nats a
  value. It is Stein's, ``(tr(S) - ln det(S))/d - 1`` with S the covariance whitened by that of the twins; chips are
  divided by their own power. As few chips diverge by themselves, that of single sets of twins is beside it.

One more table holds the echo of the solved lanes at paths of 2.2 to 3.9 m against that of a smooth surface by image
theory. Beside it are three laws of what roughness takes, at nadir: the simulator's ``exp(-2(k s)²)``, second-order
perturbation for the exponential correlation of the heights, and its limit for short waves of the surface,
``exp(-2(k s)² sqrt(ε))``. The last two take the rms height of the solver's grid.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "tests"))
from common import markdown
from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, load_sensor
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground.specular import SpecularEcho
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.simulator import array_state, system_response
from full_wave_twins import (
    BANDS,
    CHIP_BANDS,
    ECHO,
    OWN,
    PLAIN,
    SOLVED,
    SURFACES,
    LaneData,
    chips_at,
    full_wave,
    scale_of,
    solved_lane,
    solved_scene,
    solved_twin,
    twin,
    twin_scene,
)
from validate_fullwave import per_current

LANE_A = "lane a"
TOLD_LABELS = {False: ("HH", "HV"), True: ("HH", "VV")}  # in full-wave-2 H alone was transmitted
WORLDS = {"plain": "C0", "echo": "C1"}
PATHS = np.arange(2.0, 10.01, 0.25)  # m, of the figure
TOLD = np.arange(3.0, 10.01, 0.5)  # m, of the table
AHEAD = np.arange(1.2, 5.01, 0.1)  # m
CELLS = np.array([1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0])  # m, borders of the table's cells
CLEAR = 0.4  # m about targets in which no chip is taken
GATE = (2.2, 3.9)  # m of path, about the specular echo
ROUGH_BANDS = np.array([0.5, 0.8, 1.1, 1.4]) * 1e9
GOALS = {"path": 2.0, "image": 3.0, "covariance": 0.2}


class Measured(NamedTuple):
    """What one run shows."""

    path: np.ndarray  # (polarization, path) power
    image: np.ndarray  # (polarization, band, ahead) power
    chips: np.ndarray  # (chip, value), HH, each of unit power


class Lane(NamedTuple):
    """A full-wave lane with its twins of either kind."""

    name: str
    labels: list[str]
    real: Measured
    twins: dict[str, list[Measured]]


def power_by_path(run: xr.Dataset, unit: float, path: np.ndarray) -> np.ndarray:
    """Return the mean power over scans and pairs (polarization, path)."""
    frequency = run["frequency"].values
    window = np.hanning(frequency.size)
    wave = window[:, None] * np.exp(2j * np.pi * np.outer(frequency, path) / SPEED_OF_LIGHT)
    profile = run["signal"].values @ (wave / window.sum())
    return (np.abs(profile / unit) ** 2).mean(axis=(0, 2))


def power_by_distance(run: xr.Dataset, unit: float) -> np.ndarray:
    """Return the mean power of images (polarization, band, ahead) over scans and 1 m to either side."""
    grid = Grid.spanning((-1.0, 1.0), (AHEAD[0], AHEAD[-1]), 0.1)
    images = [np.abs(image.values / unit) ** 2 for image in ScanImager(run, grid, BANDS, "hann")]
    return np.mean(images, axis=(0, -1))


def clutter_chips(data: LaneData, unit: float) -> np.ndarray:
    """Return the chips (chip, value) of HH at places away from the targets, each of unit power."""
    lane = data.lane
    x, y = np.meshgrid(
        np.arange(lane.x_min + 0.2, lane.x_max - 0.19, 0.2),
        np.arange(lane.y_min + 0.2, lane.y_max - 0.19, 0.2),
    )
    places = np.column_stack([x.ravel(), y.ravel()])
    off = np.linalg.norm(places[:, None] - data.targets[["x", "y"]].to_numpy(), axis=-1)
    free = places[off.min(axis=1) > CLEAR]
    chips = []
    for scan, pose in enumerate(data.run["pose"].values):
        ahead = free[:, 1] - pose[1]
        seen = free[(ahead >= CELLS[0] + 0.2) & (ahead <= CELLS[-1])]
        chips.append(chips_at(data.run, scan, seen)[:, 0, :CHIP_BANDS].reshape(len(seen), -1))
    values = np.concatenate(chips) / unit
    return values / np.linalg.norm(values, axis=1, keepdims=True) * np.sqrt(values.shape[1])


def measured(data: LaneData, unit: float = 1.0) -> Measured:
    """Measure a lane, whose data are so many times the simulator's unit."""
    run = data.run.load()
    return Measured(
        power_by_path(run, unit, PATHS), power_by_distance(run, unit), clutter_chips(data, unit)
    )


def lane_a(surfaces: int) -> Lane:
    """Return the packaged lane, whose data have the direct wave, with its twins."""
    real = full_wave()
    real = real._replace(run=per_current(real.run.load()))
    scene = twin_scene(SURFACES[OWN])
    echo = load_sensor(ECHO).model_copy(update={"direct_wave": True})
    sensors = {"plain": load_sensor(PLAIN), "echo": echo}
    twins = {}
    for world, sensor in sensors.items():
        twins[world] = [measured(twin(scene, seed, sensor)) for seed in range(surfaces)]
    labels = [str(label) for label in real.run["polarization"].values]
    return Lane(LANE_A, labels, measured(real, scale_of(real.run)[0]), twins)


def solved(number: int, surfaces: int) -> Lane:
    """Return a solved lane of full-wave-2 with its twins."""
    twins = {}
    for world in WORLDS:
        runs = [solved_twin(number, seed, world == "echo") for seed in range(1, surfaces + 1)]
        twins[world] = [measured(data) for data in runs]
    return Lane(f"{number}", ["HH", "HV"], measured(solved_lane(number)), twins)


def over(real: np.ndarray, twins: list[np.ndarray]) -> np.ndarray:
    """Return the power of full wave over the mean of its twins, dB."""
    return 10 * np.log10(real / np.mean(twins, axis=0))


def divergence(chips: np.ndarray, of: np.ndarray) -> tuple[float, float]:
    """Return Stein's divergence a value of the covariance of chips from that of others, and its largest eigenvalue."""
    own, other = (values.T @ values.conj() / len(values) for values in (chips, of))
    eigenvalues = np.linalg.eigvals(np.linalg.solve(other, own)).real
    size = len(eigenvalues)
    scaled = eigenvalues * size / eigenvalues.sum()  # the level is that of the images
    return float((scaled - np.log(scaled)).mean() - 1), float(scaled.max())


def print_paths(lanes: list[Lane]) -> None:
    """Print full wave over twins by path, mean over the solved lanes, and lane a."""
    at = [int(np.abs(PATHS - path).argmin()) for path in TOLD]
    rows = []
    for some, title in ((lanes[1:], "full-wave-2"), (lanes[:1], LANE_A)):
        for label in TOLD_LABELS[title == LANE_A]:
            row = some[0].labels.index(label)
            for world in WORLDS:
                lines = [
                    over(lane.real.path, [one.path for one in lane.twins[world]])[row, at]
                    for lane in some
                ]
                mean = np.mean(lines, axis=0)
                met = int((np.abs(mean) <= GOALS["path"]).sum())
                cells = [f"{value + 0.0:+.1f}" for value in mean]
                rows.append([title, label, world, *cells, f"{met} of {len(cells)}"])
    print("\nPower by path, full wave over twins (dB)\n")
    print(
        markdown(
            ["lanes", "polarization", "twins", *(f"{p:g} m" for p in TOLD), "within 2 dB"], rows
        )
    )


def print_images(lanes: list[Lane]) -> None:
    """Print full wave over twins by sub-band and distance ahead."""
    rows = []
    for some, title in ((lanes[1:], "full-wave-2"), (lanes[:1], LANE_A)):
        for label in TOLD_LABELS[title == LANE_A]:
            row = some[0].labels.index(label)
            for band, name in enumerate(BANDS):
                for world in WORLDS:
                    lines = [
                        over(lane.real.image, [one.image for one in lane.twins[world]])[row, band]
                        for lane in some
                    ]
                    mean = np.mean(lines, axis=0)
                    number = np.clip(np.digitize(AHEAD + 1e-6, CELLS) - 1, 0, len(CELLS) - 2)
                    cells = [mean[number == cell].mean() for cell in range(len(CELLS) - 1)]
                    met = int((np.abs(cells) <= GOALS["image"]).sum())
                    told = [f"{value + 0.0:+.1f}" for value in cells]
                    rows.append([title, label, name, world, *told, f"{met} of {len(cells)}"])
    heads = [f"{low:g}-{high:g} m" for low, high in itertools.pairwise(CELLS)]
    print("\nPower of images by distance ahead, full wave over twins (dB)\n")
    print(markdown(["lanes", "polarization", "sub-band", "twins", *heads, "within 3 dB"], rows))


def print_covariances(lanes: list[Lane]) -> None:
    """Print how far the covariance of full wave is from that of twins, and of one set of twins from the others'."""
    rows = []
    for some, title in ((lanes[1:], "full-wave-2"), (lanes[:1], LANE_A)):
        real = np.concatenate([lane.real.chips for lane in some])
        for world in WORLDS:
            sets = [
                np.concatenate(chips)
                for chips in zip(
                    *([one.chips for one in lane.twins[world]] for lane in some), strict=True
                )
            ]
            value, largest = divergence(real, np.concatenate(sets))
            own = []
            for number in range(len(sets)):
                rest = np.concatenate(sets[:number] + sets[number + 1 :])
                own.append(divergence(sets[number], rest))
            floor, own_largest = np.mean(own, axis=0)
            verdict = "yes" if value < GOALS["covariance"] else "no"
            cells = [f"{value:.2f}", f"{floor:.2f}", f"{largest:.1f}", f"{own_largest:.1f}"]
            rows.append([title, str(len(real)), world, *cells, verdict])
    print("\nCovariance of clutter in chips of HH, before `early`\n")
    heads = ("divergence (nats a value)", "of one set of twins", "largest eigenvalue", "of twins")
    print(markdown(["lanes", "chips", "twins", *heads, "below 0.2"], rows))


def gated(signal: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Return what of a signal comes by paths within the gate of the specular echo."""
    path = np.arange(4096) / 4096 * SPEED_OF_LIGHT / (frequency[1] - frequency[0])
    inside = (path > GATE[0]) & (path < GATE[1])
    profile = np.fft.ifft(signal, path.size, axis=-1)
    return np.fft.fft(profile * inside, axis=-1)[..., : frequency.size]


def smooth_echo(number: int) -> np.ndarray:
    """Return the echo (pair, frequency) in HH of a solved lane's ground, were it smooth."""
    scene = solved_scene(number)
    surface = scene.surface.model_copy(update={"rms_height": 0.0})
    sensor = load_sensor(ECHO)
    ground = LayeredGround(scene.soil, None, sensor.tones.axis())
    flat = TerrainHeights(scene.terrain, scene.lane, 0)
    echo = SpecularEcho(surface, scene.grass, ground, flat, sensor.antenna.side_db)
    array = array_state(sensor, np.array([0, 0, sensor.height, 0, 0, 0.0]))
    return echo(array)[0] * system_response(sensor, sensor.tones.axis())


def second_order_loss(k: float, permittivity: float, rms: float, length: float) -> float:
    """Return what exponential roughness takes from the echo at nadir, nepers, by second-order perturbation.

    ``2·k·s²·(q - (q² - k²)·<1/(q1' + q2')>)`` with q = k·sqrt(ε), the mean over the surface's waves, for fields along
    the ridges of each wave. Long waves leave ``2(k s)²``, short ones ``2·k·q·s²``.
    """
    level = (np.arange(4000) + 0.5) / 4000
    waves = np.sqrt((1 - level) ** -2.0 - 1) / length
    above = np.conj(np.sqrt(k**2 - waves**2 + 0j))
    below = np.conj(np.sqrt(permittivity * k**2 - waves**2 + 0j))
    q = k * np.sqrt(permittivity)
    loss = 2 * k * rms**2 * (q - (q**2 - k**2) * (1 / (above + below)).mean())
    return float(loss.real)


def print_roughness() -> None:
    """Print what the roughness of the solved lanes takes from the specular echo, and what laws say."""
    rows = []
    for number in SOLVED:
        run = solved_lane(number).run.load()
        scene = solved_scene(number)
        surface = run.attrs["fullwave"]["surface"]
        frequency = run["frequency"].values
        smooth = gated(smooth_echo(number), frequency)
        echo = gated(run["signal"].values[:, 0], frequency)
        cells = []
        for low, high in itertools.pairwise(ROUGH_BANDS):
            band = (frequency >= low) & (frequency < high)
            some = smooth[..., band]
            share = np.vdot(np.broadcast_to(some, echo[..., band].shape), echo[..., band])
            share = share / (len(echo) * np.vdot(some, some).real)
            k = 2 * np.pi * (low + high) / 2 / SPEED_OF_LIGHT
            eps = scene.soil.permittivity
            length = scene.surface.correlation_length
            rms = surface["rms_height_on_grid"]
            losses = [
                2 * (k * scene.surface.rms_height) ** 2,
                second_order_loss(k, eps, rms, length),
                2 * (k * rms) ** 2 * np.sqrt(eps),
            ]
            told = [20 * np.log10(np.abs(share)), *(-20 * np.log10(np.e) * np.array(losses))]
            cells.append(" / ".join(f"{value:.1f}" for value in told))
        names = [
            f"{number}",
            f"{scene.soil.permittivity:g}",
            f"{1000 * scene.surface.rms_height:g}",
        ]
        rows.append([*names, f"{1000 * surface['rms_height_on_grid']:.1f}", *cells])
    bands = [f"{low / 1e9:g}-{high / 1e9:g} GHz" for low, high in itertools.pairwise(ROUGH_BANDS)]
    print(
        "\nSpecular echo over that of a smooth surface: solved / law / second order / its limit (dB)\n"
    )
    print(markdown(["lane", "ε", "rms (mm)", "on the grid (mm)", *bands], rows))


def draw(lanes: list[Lane], path: Path) -> None:
    """Draw full wave over twins by path and by distance ahead."""
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    axes = figure.subplots(1, 3)
    for label, style in (("HH", "-"), ("HV", "--")):
        row = lanes[1].labels.index(label)
        for world, colour in WORLDS.items():
            by_path = []
            for lane in lanes[1:]:
                by_path.append(over(lane.real.path, [one.path for one in lane.twins[world]])[row])
            mean = np.mean(by_path, axis=0)
            axes[0].plot(PATHS, mean, style, color=colour, label=f"{world} twins, {label}")
    for band, name in enumerate(list(BANDS)[:CHIP_BANDS]):
        for world, number in (("plain", 1), ("echo", 2)):
            lines = []
            for lane in lanes[1:]:
                lines.append(over(lane.real.image, [one.image for one in lane.twins[world]]))
            low, high = (edge / 1e9 for edge in BANDS[name])
            mean = np.mean(lines, axis=0)[0, band]
            axes[number].plot(AHEAD, mean, color=f"C{band + 2}", label=f"{low:g} to {high:g} GHz")
    axes[0].axhspan(-2, 2, color="0.9")
    axes[0].set(xlabel="path (m)", ylabel="full wave over twins (dB)", xlim=(PATHS[0], PATHS[-1]))
    axes[0].set_ylim(-10, 60)
    axes[0].set_title("signal, whole band")
    for number, world in ((1, "plain"), (2, "echo")):
        axes[number].axhspan(-3, 3, color="0.9")
        axes[number].set(xlabel="distance ahead (m)", ylim=(-8, 45))
        axes[number].set_title(f"images in HH, {world} twins")
    for one in axes:
        one.grid(alpha=0.3)
        one.legend(fontsize=8)
    figure.savefig(path, dpi=85, metadata={"Software": None})


def main() -> None:
    """Print the tables and draw the figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--surfaces", type=int, default=8, help="twins of each lane")
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    lanes = [
        lane_a(given.surfaces),
        *(solved(number, given.surfaces) for number in SOLVED),
    ]
    print_paths(lanes)
    print_images(lanes)
    print_covariances(lanes)
    print_roughness()
    if given.figure is not None:
        draw(lanes, given.figure)


if __name__ == "__main__":
    main()
