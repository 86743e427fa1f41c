"""A run of a few point scatterers, a standing coupling and gaps, to be looked at as raw data."""

import base64

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, make_run
from flgpr.model.phase import path_phase
from flgpr.store import save_run

TX = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
RX = np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
TARGETS = np.array([[0.2, 3.0], [-0.4, 6.3], [0.3, 8.4]])


def make_raw_lane(path, scans=160, tones=None):
    """Store a run of two pairs and HH, VV: scan 3 has no sweep of pair 1 in HH, 50 to 54 none at all."""
    rng = np.random.default_rng(5)
    frequency = np.linspace(0.5e9, 2.5e9, 161) if tones is None else tones
    pose = np.zeros((scans, 6))
    pose[:, 1] = np.linspace(0, 10, scans)
    pose[:, 2] = 1.0
    signal = np.zeros((scans, 2, 2, frequency.size), complex)
    for x, y in TARGETS:
        for pair in range(2):
            ways = [
                np.linalg.norm(pose[:, :3] + side[pair] - (x, y, 0), axis=1) for side in (TX, RX)
            ]
            signal[:, :, pair] += (
                path_phase(frequency, sum(ways)) / np.prod(ways, axis=0)[:, None]
            )[:, None]
    signal += 5 * path_phase(frequency, 1.5 * SPEED_OF_LIGHT * 1e-9)
    signal += 0.02 * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))
    if scans > 54:
        signal[3, 0, 1] = signal[50:55] = np.nan
    return save_run(make_run(signal, frequency, ["HH", "VV"], TX, RX, pose), path)


def values_of(answer):
    halves = np.frombuffer(base64.b64decode(answer["halves"]), "<f2").astype(float)
    return halves.reshape(len(answer["scans"]), answer["delays_ns"]["count"])


def direct(signal, tones, delays):
    """Sum tone by tone, each with its share of the band under the window."""
    share = np.sin(np.pi * np.arange(1, tones.size + 1) / (tones.size + 1)) ** 2 * np.gradient(
        tones
    )
    total = np.zeros((len(signal), delays.size), complex)
    for k, tone in enumerate(tones):
        total += share[k] / share.sum() * signal[:, k, None] * np.exp(2j * np.pi * tone * delays)
    return total
