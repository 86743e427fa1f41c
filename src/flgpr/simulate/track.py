"""The vehicle's way: the pose of every scan."""

from __future__ import annotations

import numpy as np

from flgpr.model.arrays import FloatArray
from flgpr.simulate.draw import stream
from flgpr.simulate.scene import Scene


def draw_track(scene: Scene, height: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Draw poses (scan, 6), ``height`` m up, and times of all scans: at 2 m/s, one a second while it stands."""
    track, rng = scene.track, stream(seed, "track")
    y, seconds = _positions(scene, rng)
    pose = np.zeros((y.size, 6))
    pose[:, 1] = y
    if track.wander > 0:
        wave = 2 * np.pi / track.wander_length * rng.uniform(0.5, 1.5, 3)
        phase = rng.uniform(0, 2 * np.pi, 3)
        size = track.wander * np.sqrt(2 / 3)
        pose[:, 0] = size * np.sin(np.outer(y, wave) + phase).sum(axis=1)
        pose[:, 3] = np.arctan(size * (wave * np.cos(np.outer(y, wave) + phase)).sum(axis=1))
    pose[:, 0] += (scene.x_min + scene.x_max) / 2
    pose[:, 2] = height + rng.normal(0, track.bounce, y.size)
    pose[:, 4:] = rng.normal(0, track.attitude, (y.size, 2))
    return np.asarray(pose, dtype=np.float64), np.asarray(seconds, dtype=np.float64)


def _positions(scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    track = scene.track
    if track.positions is not None:
        exact = np.asarray(track.positions, dtype=float)
        return exact, np.arange(exact.size, dtype=np.float64)
    place = -20.0 if track.start is None else track.start
    end = scene.length - 5.0 if track.stop is None else track.stop
    stops = sorted(track.stops)
    y, seconds, clock = [], [], 0.0
    while place <= end:
        inside = next((d for d in track.departures if d.start <= place < d.start + d.length), None)
        if inside is not None:
            clock += inside.length / 2.0
            place = inside.start + inside.length
            continue
        y.append(place)
        seconds.append(clock)
        while stops and stops[0][0] <= place:
            for _ in range(stops.pop(0)[1]):
                clock += 1.0
                y.append(place)
                seconds.append(clock)
        stride = rng.uniform(*track.step)
        place += stride
        clock += stride / 2.0
    if not y:
        raise ValueError(f"track must hold at least one scan, got none from {place:g} m to {end:g} m")
    return np.asarray(y, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
