"""A tiny drive with a standing field, and faults of a radar and of its poses put into it."""

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, lane_to_scan, make_run, vehicle_to_scan

SCANS = 24
TX = np.repeat([[-0.9, 0.0, 0.0], [0.9, 0.0, 0.0]], 9, axis=0)
RX = np.tile([[x, 0.1, 0.0] for x in np.linspace(-0.7, 0.7, 9)], (2, 1))
FREQUENCY = 0.5e9 + 8e6 * np.arange(140)  # Hz
PAIRS = len(TX)
TONES = FREQUENCY.size


def noise(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def make_drive(seed=1, scans=SCANS):
    """Simulate scattered ground, the antennas' coupling, and noise."""
    rng = np.random.default_rng(seed)
    pose = np.zeros((scans, 6))
    pose[:, 1] = np.cumsum(rng.uniform(0.35, 0.65, scans))
    pose[:, 0] = 0.05 * rng.normal(size=scans)
    pose[:, 2] = 2.0
    count = 400
    places = np.column_stack(
        [rng.uniform(-4, 4, count), rng.uniform(1, 26, count), np.zeros(count)]
    )
    matrix = noise(rng, count, 2)
    leak = 3 * noise(rng, 2, PAIRS)[..., None] * np.exp(-2j * np.pi * FREQUENCY * 5e-9)
    signal = np.zeros((scans, 2, PAIRS, TONES), complex)
    for k, one in enumerate(pose):
        local = lane_to_scan(places, one)
        ahead = (local[:, 1] > 1) & (local[:, 1] < 9)
        seen = local[ahead]
        ways = [
            np.linalg.norm(seen - vehicle_to_scan(of, one)[:, None], axis=-1) for of in (TX, RX)
        ]
        phase = np.exp(-2j * np.pi * FREQUENCY * (ways[0] + ways[1])[..., None] / SPEED_OF_LIGHT)
        strength = matrix[ahead].T / (ways[0] * ways[1])[:, None]
        signal[k] = (strength @ phase).swapaxes(0, 1)
    signal /= np.sqrt(np.mean(np.abs(signal) ** 2))
    return run_of(signal + leak + 0.1 * noise(rng, *signal.shape), pose)


def run_of(signal, pose):
    return make_run(
        np.asarray(signal, np.complex64), FREQUENCY, ["HH", "VV"], TX, RX, pose,
        0.24 * np.arange(len(pose)), {"title": "tiny drive"},
    )  # fmt: skip


def with_fault(run, change):
    """Return a run whose signal and poses a function changes, in place or by returning them."""
    signal = run["signal"].values.astype(complex)
    pose = run["pose"].values.copy()
    changed = change(signal, pose)
    return run_of(*(changed or (signal, pose)))


def disturbed(signal, pose):
    """Let something transmit on three tones, 30 dB over the mean."""
    rng = np.random.default_rng(5)
    level = np.sqrt(1000 * np.mean(np.abs(signal) ** 2))
    signal[..., [31, 77, 120]] += level * noise(rng, *signal.shape[:3], 3)


def jittered(signal, pose):
    delay = 200e-12 * np.random.default_rng(5).normal(size=len(signal))
    signal *= np.exp(-2j * np.pi * delay[:, None] * FREQUENCY)[:, None, None]


def drifting(signal, pose):
    delay = np.linspace(0, 1.2e-9, len(signal))
    signal *= np.exp(-2j * np.pi * delay[:, None] * FREQUENCY)[:, None, None]


def noisy(signal, pose):
    signal[..., 60:80] += 2 * noise(np.random.default_rng(5), *signal[..., 60:80].shape)


def noise_alone(signal, pose):
    return noise(np.random.default_rng(5), *signal.shape), pose


def turned(signal, pose):
    signal[:, :, [2, 6, 13]] *= -1


def swapped(signal, pose):
    signal[:, :, [3, 7]] = signal[:, :, [7, 3]]


def receivers_reversed(signal, pose):
    shape = signal.shape
    return signal.reshape(*shape[:2], 2, 9, -1)[..., ::-1, :].reshape(shape), pose


def heading_turned(signal, pose):
    pose[:, 3] += np.pi


def late(scans):
    """Return what gives every scan the pose of so many before."""
    return lambda signal, pose: (signal, pose[np.clip(np.arange(len(pose)) - scans, 0, None)])


def on_pose(change):
    return lambda signal, pose: (signal, change(pose))


def frozen_positions(signal, pose):
    middle = len(pose) // 2
    pose[middle:] = pose[middle]


def frozen_signal(signal, pose):
    middle = len(signal) // 2
    signal[middle:] = signal[middle]


def put(place, value):
    def change(signal, pose):
        signal[place] = value

    return change


def scaled(place, factor):
    def change(signal, pose):
        signal[place] *= factor

    return change


ALL = slice(None)
FAULTS = {
    "disturbed tones": disturbed,
    "missing tones": put((ALL, ALL, 4, 50), np.nan),
    "missing pairs": put((ALL, ALL, 4), np.nan),
    "hot pairs": scaled((ALL, ALL, 4), 1e4),
    "dead pairs": scaled((ALL, ALL, 4), 1e-3),
    "dead polarization": scaled((ALL, 1), 1e-4),
    "stuck pairs": put((ALL, ALL, 4), 1 + 1j),
    "swapped pairs": swapped,
    "turned pairs": turned,
    "noisy tones": noisy,
    "noise": noise_alone,
    "jitter": jittered,
    "time zero": drifting,
    "repeated scans": frozen_signal,
    "frozen positions": frozen_positions,
    "receivers": receivers_reversed,
    "heading": heading_turned,
    "lag": late(1),
    "units": on_pose(lambda pose: pose / [0.3048, 0.3048, 1, 1, 1, 1]),
}
"""Faults by the name of what is to be found."""
WAYS = {
    "the data are conjugated": lambda signal, pose: (signal.conj(), pose),
    "the tones are in reverse order": lambda signal, pose: (signal[..., ::-1], pose),
    "the receivers are in reverse order": FAULTS["receivers"],
    "the heading is turned by 180 degrees": FAULTS["heading"],
    "the heading is 20 degrees too large": on_pose(lambda pose: pose + [0, 0, 0, 0.35, 0, 0]),
    "the poses are 1 scan late": late(1),
    "the poses are 2 scans late": late(2),
    "the positions are in feet": FAULTS["units"],
    "x and y are exchanged": on_pose(lambda pose: pose[:, [1, 0, 2, 3, 4, 5]]),
}
"""Other ways to take a run than as it was recorded, by what is said of them."""
