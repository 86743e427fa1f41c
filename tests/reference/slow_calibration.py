"""Coherent sums over an aperture for each range bias, written out."""

import numpy as np

C = 299_792_458.0


def fields_over_bias(run, points, biases):
    """Sum of w·hann(f)·s(f)·exp(+j2πf(L + 2·bias)/c) over scans, pairs and tones: (polarization, point, bias).

    The vehicle's axes are those of the lane; w is a scan's share of the way over the mean share.
    """
    keep = np.flatnonzero(run["valid"].values.all(axis=tuple(range(1, run["valid"].ndim))))
    tones = run["frequency"].values
    signal = run["signal"].values
    pose = run["pose"].values
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(1, tones.size + 1) / (tones.size + 1))
    way = np.zeros(keep.size)
    for k in range(keep.size - 1):
        step = np.linalg.norm(pose[keep[k + 1], :3] - pose[keep[k], :3])
        way[k] += step / 2
        way[k + 1] += step / 2
    way /= way.mean()
    total = np.zeros((signal.shape[1], len(points), len(biases)), complex)
    for weight, scan in zip(way, keep, strict=True):
        for pair in range(signal.shape[2]):
            tx, rx = (
                run[name].values[pair] + pose[scan, :3] for name in ("tx_position", "rx_position")
            )
            for p, point in enumerate(points):
                path = np.linalg.norm(tx - point) + np.linalg.norm(rx - point)
                for b, bias in enumerate(biases):
                    turned = hann * np.exp(2j * np.pi * tones * (path + 2 * bias) / C)
                    total[:, p, b] += weight * (signal[scan, :, pair] * turned).sum(axis=-1)
    return total
