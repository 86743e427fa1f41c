"""Lanes of point scatterers for the array of ``systems.lanes``, and recipes cut down to it.

No simulator makes them, so that a change of the simulator does not change what is found here.
"""

from pathlib import Path

import numpy as np

from flgpr.live.feeding import feed
from flgpr.model import SPEED_OF_LIGHT, lane_to_scan, make_run, vehicle_to_scan
from flgpr.store import save_run
from systems.lanes import SENSOR, SMALL, small_recipe

TX = np.repeat([[-0.9, 0.0, 0.0], [0.9, 0.0, 0.0]], 4, axis=0)
RX = np.tile([[x, 0.0, 0.0] for x in np.linspace(-1.1, 1.1, 4)], (2, 1))
POLARIZATIONS = ["HH", "VV", "HV", "VH"]
FREQUENCY = 0.6e9 + 14e6 * np.arange(81)
HEIGHT = 2.5  # m
STEP = {"train": 0.8, "test": 1.0}  # m from scan to scan
NOISE = 0.02
COUPLING = 0.5
QUANTUM = 2.0**-12
"""Samples are multiples of it, so that sums which differ in their last bits give the same lane."""
PACKAGED_AREA = "x_min = -1.0\nx_max = 1.0\ny_min = 2.0\ny_max = 6.2\n"
"""Lane of the packaged run, as the recipe ``demo`` has it."""
MINE = np.array([1.0, 0.8, 0.06, 0.06])
"""Echo of a mine in each polarization; clutter is 0.25 times as strong on average."""


def make_lanes(folder: Path) -> None:
    """Write lanes to train and to test on, both in two bands, live scans, and recipes."""
    _write_lane(folder, "train", seed=21, length=20.0, mines=11)
    _write_lane(folder, "test", seed=22, length=14.0, mines=6)
    feed(folder / "test.zarr", folder / "incoming", rate=np.inf)
    (folder / "packaged-lane.toml").write_text(PACKAGED_AREA)
    (folder / "sensor.toml").write_text(SENSOR)
    for name in SMALL:
        text = small_recipe(name).replace("SENSOR", str(folder / "sensor.toml"))
        (folder / f"{name}.toml").write_text(text.replace("copies = 4", "copies = 2"))


def _write_lane(folder: Path, name: str, seed: int, length: float, mines: int) -> None:
    rng = np.random.default_rng(seed)
    targets = np.column_stack(
        [rng.uniform(-1.1, 1.1, mines), np.linspace(1.0, length - 1.0, mines)]
    )
    run = make_lane(rng, targets, length, STEP[name])
    save_run(run.assign_attrs(title=name), folder / f"{name}.zarr")
    # The upper half of the band in one polarization, as a radar of its own.
    second = run.sel(polarization=["VV"], frequency=slice(1.2e9, None))
    save_run(second.assign_attrs(title=f"{name} x"), folder / f"{name}-x.zarr")
    rows = [f"mine-{k},metal,{x:.3f},{y:.3f},0.05" for k, (x, y) in enumerate(targets)]
    (folder / f"{name}.csv").write_text("\n".join(["target_id,kind,x,y,depth", *rows]) + "\n")
    borders = {"x_min": -1.5, "x_max": 1.5, "y_min": 0.0, "y_max": length}
    text = "".join(f"{border} = {value}\n" for border, value in borders.items())
    (folder / f"{name}-lane.toml").write_text(text)


def make_lane(rng, targets, length, step):
    """Make the run of a lane: echoes of mines, clutter and roadsides, coupling, and noise."""
    y = np.arange(-6.0, length - 3.0, step)
    pose = np.zeros((y.size, 6))
    pose[:, 0] = 0.05 * rng.normal(size=y.size)
    pose[:, 1] = y + 0.05 * rng.normal(size=y.size)
    pose[:, 2] = HEIGHT
    pose[:, 3] = 0.01 * rng.normal(size=y.size)
    places, echoes = _scatterers(rng, targets, length)
    coupling = _coupling()
    signal = np.zeros((y.size, 4, len(TX), FREQUENCY.size), np.complex128)
    for scan, one in enumerate(pose):
        signal[scan] = _scan(one, places, echoes) + coupling
    noise = rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape)
    signal += NOISE * noise
    rounded = np.round(signal / QUANTUM) * QUANTUM
    time = 0.5 * np.arange(y.size)
    return make_run(rounded, FREQUENCY, POLARIZATIONS, TX, RX, pose, time)


def _scatterers(rng, targets, length):
    """Place clutter, bright roadsides and mines: positions (n, 3), echoes (n, polarization)."""
    clutter = np.column_stack([rng.uniform(-3.5, 3.5, 160), rng.uniform(-3.0, length + 3.0, 160)])
    side = rng.choice([-1.0, 1.0], 14)
    roadside = np.column_stack([side * rng.uniform(2.0, 3.4, 14), rng.uniform(0.0, length, 14)])
    places = np.vstack([clutter, roadside, targets])
    strength = np.concatenate([np.full(160, 0.25), np.full(14, 1.5)])
    random = rng.normal(size=(174, 3)) + 1j * rng.normal(size=(174, 3))
    random[:, 2] *= 0.3  # across polarizations
    random *= strength[:, None] / np.sqrt(2)
    scattering = random[:, [0, 1, 2, 2]]  # HV and VH of one body are alike
    mines = np.tile(MINE, (len(targets), 1))
    ground = np.column_stack([places, np.zeros(len(places))])
    return ground, np.vstack([scattering, mines])


def _scan(pose, places, echoes):
    """Add up the echoes of what lies 2 to 11 m ahead: (polarization, pair, frequency)."""
    local = lane_to_scan(places, pose)
    ahead = (local[:, 1] > 2.0) & (local[:, 1] < 11.0)
    local = local[ahead]
    out = np.linalg.norm(local - vehicle_to_scan(TX, pose)[:, None], axis=-1)
    back = np.linalg.norm(local - vehicle_to_scan(RX, pose)[:, None], axis=-1)
    phase = np.exp(-2j * np.pi * FREQUENCY * (out + back)[..., None] / SPEED_OF_LIGHT)
    spread = 30.0 / (out * back)
    return np.einsum("np,an,anf->paf", echoes[ahead], spread, phase, optimize=True)


def _coupling():
    """Make what goes from each transmitter to each receiver directly: (1, pair, frequency)."""
    path = np.linalg.norm(TX - RX, axis=-1)
    return COUPLING * np.exp(-2j * np.pi * FREQUENCY * path[:, None] / SPEED_OF_LIGHT)[None]
