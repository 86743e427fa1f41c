"""The work at which imaging is timed: one scan of ``sri-array``, and the exact results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT, Grid, load_sensor
from suite.data import complex_noise

ComplexArray = NDArray[np.complex64]
SUBBANDS = ((0.8e9, 2.8e9), (0.75e9, 1.35e9), (1.25e9, 1.85e9), (1.75e9, 2.35e9), (2.25e9, 2.85e9))
"""Sub-bands of the images of a scan (Wang et al. 2007), Hz."""
GRID = Grid(-6.0, 7.0, 240, 380, 0.05, 0.05)
"""Ground grid, 91,200 pixels."""
PERMITTIVITY = 3.4
"""Of the ground in the cases of buried pixels."""
BURIAL = 0.1
"""Depth of those pixels, m."""
CHECKED_PIXELS = 2000
CHECKED_TONES = 57
_SCATTERERS = 60


@dataclass(frozen=True)
class ImagedScan:
    """One scan and what it is imaged on."""

    frequency: NDArray[np.float64]  #: tones, Hz
    tx: NDArray[np.float64]  #: (pair, 3): antennas, m
    rx: NDArray[np.float64]  #: (pair, 3): antennas, m
    pixels: NDArray[np.float64]  #: (pixel, 3): pixel centres, m, cross-track fastest
    #: (polarization, pair, frequency): sixty scatterers in noise of the same power
    data: ComplexArray
    image: ComplexArray  #: (polarization, 1, pixel): noise for the forward model

    def buried_pixels(self) -> NDArray[np.float64]:
        """Return the pixels (pixel, 3) at the depth ``BURIAL``, m."""
        return np.asarray(self.pixels - [0, 0, BURIAL], dtype=np.float64)


@dataclass(frozen=True)
class Case:
    """One code at one piece of work."""

    work: str
    code: str
    run: Callable[[], NDArray[Any]]  #: what is timed
    exact: NDArray[np.complex128]  #: what its error is measured against
    images: int
    width: int = 0  #: samples of the interpolation, for the roofline; 0 where unknown
    scans: int = 1


@dataclass(frozen=True)
class DirectSums:
    """Direct sums in double precision on some pixels and tones."""

    pixel: NDArray[np.int64]
    tone: NDArray[np.int64]
    images: NDArray[np.complex128]
    channel: NDArray[np.complex128]
    buried: NDArray[np.complex128]
    forward: NDArray[np.complex128]


def sri_scan() -> ImagedScan:
    """Return the scan that is imaged: 36 pairs, 1024 tones, three polarizations."""
    sensor = load_sensor("sri-array")
    rng = np.random.default_rng(0)
    height = np.array([0.0, 0.0, sensor.height])
    tx_of_pairs, rx_of_pairs = sensor.pairs()
    tx = np.asarray(tx_of_pairs) + height
    rx = np.asarray(rx_of_pairs) + height
    frequency = sensor.tones.axis()
    pixels = GRID.points().reshape(-1, 3)

    scatterers = rng.uniform([-6, 7, 0], [6, 26, 0], size=(_SCATTERERS, 3))
    amplitude = complex_noise(rng, (3, _SCATTERERS))
    from_tx = np.linalg.norm(scatterers - tx[:, None], axis=2)
    to_rx = np.linalg.norm(scatterers - rx[:, None], axis=2)
    path = from_tx + to_rx

    echoes = []
    for pair_path in path:
        phase = -2j * np.pi * np.outer(pair_path, frequency) / SPEED_OF_LIGHT
        echoes.append(amplitude @ np.exp(phase))
    signal = np.stack(echoes).transpose(1, 0, 2)
    noise = complex_noise(rng, (3, tx.shape[0], frequency.size))
    data = signal + noise * np.sqrt(_SCATTERERS)

    image = complex_noise(rng, (3, 1, pixels.shape[0]))
    return ImagedScan(
        frequency,
        tx,
        rx,
        pixels,
        np.ascontiguousarray(data, np.complex64),
        image.astype(np.complex64),
    )


def direct_sums(scan: ImagedScan) -> DirectSums:
    """Sum term by term what the codes are checked against."""
    rng = np.random.default_rng(1)
    pixel = np.sort(rng.choice(len(scan.pixels), CHECKED_PIXELS, replace=False))
    tone = np.linspace(0, scan.frequency.size - 1, CHECKED_TONES).astype(np.int64)

    def exact_operator(
        frequency: NDArray[np.float64], pixels: NDArray[np.float64], **options: Any
    ) -> ImagingOperator:
        return ImagingOperator(
            frequency, scan.tx, scan.rx, pixels, dtype=np.complex128, method="direct", **options
        )

    checked = scan.pixels[pixel]
    buried = scan.buried_pixels()[pixel]
    subband_operator = exact_operator(scan.frequency, checked, subbands=SUBBANDS)
    channel_operator = exact_operator(scan.frequency, checked)
    buried_operator = exact_operator(
        scan.frequency, buried, subbands=SUBBANDS, half_space=PERMITTIVITY
    )
    forward_operator = exact_operator(scan.frequency[tone], scan.pixels)
    return DirectSums(
        pixel,
        tone,
        images=subband_operator.adjoint(scan.data),
        channel=channel_operator.adjoint(scan.data[:1]),
        buried=buried_operator.adjoint(scan.data),
        forward=forward_operator.forward(scan.image),
    )
