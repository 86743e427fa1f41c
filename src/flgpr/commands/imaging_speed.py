"""How fast the imaging operator is, beside other codes and the machine's own limits, on one scan of ``sri-array``."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.commands.roofline import peak_bandwidth, peak_flops
from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT, Grid, load_sensor

SUBBANDS = ((0.8e9, 2.8e9), (0.75e9, 1.35e9), (1.25e9, 1.85e9), (1.75e9, 2.35e9), (2.25e9, 2.85e9))
"""Sub-bands of the images of a scan (Wang et al. 2007), Hz."""
GRID = Grid(-6.0, 7.0, 240, 380, 0.05, 0.05)
"""Ground grid, 91,200 pixels."""
BATCH = 32
"""Scans in flight on a CUDA device."""
REPEATS = 10
"""Launches that are timed together on a CUDA device."""
CHECKED_PIXELS = 2000
CHECKED_TONES = 57

Run = Callable[[], NDArray[Any]]


@dataclass(frozen=True)
class Scan:
    """One scan and what it is imaged on."""

    frequency: NDArray[np.float64]  #: tones, Hz
    tx: NDArray[np.float64]  #: (pair, 3): antennas, m
    rx: NDArray[np.float64]  #: (pair, 3): antennas, m
    pixels: NDArray[np.float64]  #: (pixel, 3): pixel centres, m, cross-track fastest
    data: NDArray[
        np.complex64
    ]  #: (polarization, pair, frequency): sixty scatterers in noise of the same power
    image: NDArray[np.complex64]  #: (polarization, 1, pixel): noise for the forward model


@dataclass(frozen=True)
class Case:
    """One code at one piece of work: what is timed, what its error is measured against, how much it computes."""

    work: str
    code: str
    run: Run
    exact: NDArray[np.complex128]
    images: int
    width: int = 0
    scans: int = 1


def sri_scan() -> Scan:
    """Make the scan that is imaged: 36 pairs, 1024 tones, three polarizations."""
    sensor = load_sensor("sri-array")
    rng = np.random.default_rng(0)
    height = np.array([0.0, 0.0, sensor.height])
    tx, rx = (np.asarray(position) + height for position in sensor.pairs())
    frequency = sensor.tones.axis()
    pixels = GRID.points().reshape(-1, 3)
    scatterers = rng.uniform([-6, 7, 0], [6, 26, 0], size=(60, 3))
    amplitude = _noise(rng, (3, 60))
    length = np.linalg.norm(scatterers - tx[:, None], axis=2) + np.linalg.norm(
        scatterers - rx[:, None], axis=2
    )
    data = np.stack(
        [
            amplitude @ np.exp(-2j * np.pi * np.outer(row, frequency) / SPEED_OF_LIGHT)
            for row in length
        ]
    )
    data = data.transpose(1, 0, 2) + _noise(rng, (3, tx.shape[0], frequency.size)) * np.sqrt(60)
    image = _noise(rng, (3, 1, pixels.shape[0]))
    return Scan(
        frequency,
        tx,
        rx,
        pixels,
        np.ascontiguousarray(data, np.complex64),
        image.astype(np.complex64),
    )


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    return np.asarray(rng.normal(size=shape) + 1j * rng.normal(size=shape), dtype=np.complex128)


@dataclass(frozen=True)
class Truth:
    """Direct sums in double precision on some pixels and tones: of the images, one channel, 10 cm deep, and forward."""

    pixel: NDArray[np.int64]
    tone: NDArray[np.int64]
    images: NDArray[np.complex128]
    channel: NDArray[np.complex128]
    buried: NDArray[np.complex128]
    forward: NDArray[np.complex128]


def direct_sums(scan: Scan) -> Truth:
    """Sum term by term what the codes are checked against."""
    pixel = np.sort(
        np.random.default_rng(1).choice(len(scan.pixels), CHECKED_PIXELS, replace=False)
    )
    tone = np.linspace(0, scan.frequency.size - 1, CHECKED_TONES).astype(np.int64)
    some = scan.pixels[pixel]

    def exact(
        frequency: Any = scan.frequency, pixels: Any = some, **options: Any
    ) -> ImagingOperator:
        return ImagingOperator(
            frequency, scan.tx, scan.rx, pixels, dtype=np.complex128, method="direct", **options
        )

    return Truth(
        pixel,
        tone,
        exact(subbands=SUBBANDS).adjoint(scan.data),
        exact().adjoint(scan.data[:1]),
        exact(pixels=some - [0, 0, 0.1], subbands=SUBBANDS, half_space=3.4).adjoint(scan.data),
        exact(frequency=scan.frequency[tone], pixels=scan.pixels).forward(scan.image),
    )


def own_cases(scan: Scan, truth: Truth, device: str) -> list[Case]:
    """List what this package is timed at."""

    def operator(tolerance: float, pixels: Any = scan.pixels, **options: Any) -> ImagingOperator:
        return ImagingOperator(
            scan.frequency, scan.tx, scan.rx, pixels, tolerance=tolerance, device=device, **options
        )

    code = f"flgpr {device}"
    images = operator(5e-4, subbands=SUBBANDS)
    fine = operator(1e-5, subbands=SUBBANDS)
    buried = operator(5e-4, scan.pixels - [0, 0, 0.1], subbands=SUBBANDS, half_space=3.4)
    one = operator(1e-3)
    buffer = images.image_buffer(3)
    cases = [
        Case(
            "15 images",
            code,
            lambda: images.adjoint(scan.data, buffer),
            truth.images,
            15,
            images.width,
        ),
        Case(
            "15 images, 1e-5",
            code,
            lambda: fine.adjoint(scan.data, buffer),
            truth.images,
            15,
            fine.width,
        ),
        Case(
            "15 images, ground",
            code,
            lambda: buried.adjoint(scan.data, buffer),
            truth.buried,
            15,
            buried.width,
        ),
        Case("one channel", code, lambda: one.adjoint(scan.data[:1]), truth.channel, 1, one.width),
        Case("forward", code, lambda: one.forward(scan.image[:1]), truth.forward[:1], 1, one.width),
        Case(
            "forward, 3 channels",
            code,
            lambda: one.forward(scan.image),
            truth.forward,
            3,
            one.width,
        ),
    ]
    if device == "cuda":
        batch = np.repeat(scan.data[None], BATCH, axis=0)
        images_of = images.image_buffer(BATCH, 3)
        single = np.ascontiguousarray(batch[:, :1])
        image_of = one.image_buffer(BATCH, 1)
        runs = (lambda: images.adjoint(batch, images_of)), (lambda: one.adjoint(single, image_of))
        cases += [
            Case(
                f"15 images of {BATCH} scans", code, runs[0], truth.images, 15, images.width, BATCH
            ),
            Case(
                f"one channel of {BATCH} scans", code, runs[1], truth.channel, 1, one.width, BATCH
            ),
        ]
    return cases


def bench_imaging(peers: bool = False, rounds: int = 7, device: str = "cpu") -> pd.DataFrame:
    """Time the imaging operator, and perhaps installed other codes, in interleaved rounds, whose medians count.

    On a CUDA device the other code is cuFINUFFT, and the sums alone are timed too, on data on the device already.
    It gives a row per case: ``work``, ``code``, ``time`` (s per scan), ``error`` (relative L2 against direct sums),
    ``rate`` (updates per second; an update is one pixel, pair and image), ``ratio`` (time over this package's at the
    same work) and ``roofline`` (least time that the measured peaks allow, over the time; this package on the CPU only).
    """
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    place = [[0.0, 0.0, 5.0]]
    # Refuses a device that is not here before anything is summed.
    ImagingOperator([1e9, 1.1e9], place, place, [[0.0, 8.0, 0.0]], device=device)
    scan = sri_scan()
    truth = direct_sums(scan)
    cases = own_cases(scan, truth, device)
    missing: list[str] = []
    if peers:
        from flgpr.commands.imaging_peers import missing_peers, peer_cases

        missing = missing_peers(device)
        cases += peer_cases(scan, truth) if device == "cpu" else []
    errors = [_error(case, truth) for case in cases]
    times, flops, bandwidth = _interleave([case.run for case in cases], rounds)
    rows = []
    for case, error, seconds in zip(cases, errors, times, strict=True):
        seconds /= case.scans
        updates = len(scan.pixels) * len(scan.tx) * case.images
        floor = max(
            updates * (4 * case.width + 8) / flops, 8 * len(scan.pixels) * case.images / bandwidth
        )
        limited = device == "cpu" and case.width > 0
        rows.append(
            (
                case.work,
                case.code,
                seconds,
                error,
                updates / seconds,
                floor / seconds if limited else np.nan,
            )
        )
    if device == "cuda":
        rows += _device_rows(scan, {row[0]: row for row in rows}, rounds)
        if peers and not missing:
            from flgpr.commands.imaging_peers import cufinufft_rows

            rows += cufinufft_rows(scan, truth, rounds)
    table = pd.DataFrame(rows, columns=["work", "code", "time", "error", "rate", "roofline"])
    own = table[table["code"] == f"flgpr {device}"].set_index("work")["time"]
    table["ratio"] = table["time"] / table["work"].map(own)
    table.attrs["flops"] = flops
    table.attrs["bandwidth"] = bandwidth
    table.attrs["missing"] = missing
    return table.sort_values(["work", "time"], ignore_index=True)


def _device_rows(
    scan: Scan, like: dict[str, tuple[Any, ...]], rounds: int
) -> list[tuple[Any, ...]]:
    """Time images without transfers; ``like`` has the rows of the same images with them."""
    rows = []
    for work, polarizations, bands, tolerance in (
        ("15 images", 3, SUBBANDS, 5e-4),
        ("one channel", 1, None, 1e-3),
    ):
        engine = ImagingOperator(
            scan.frequency, scan.tx, scan.rx, scan.pixels, bands, tolerance, device="cuda"
        ).engine
        channels = len(bands) if bands else 1
        updates = len(scan.pixels) * len(scan.tx) * polarizations * channels
        for scans, name in ((1, work), (BATCH, f"{work} of {BATCH} scans")):
            times = [
                engine.device_seconds(polarizations * scans, channels, REPEATS)
                for _ in range(rounds)
            ]
            for part, seconds in zip(
                ("on the device", "interpolation alone"), np.median(times, axis=0), strict=True
            ):
                each = float(seconds) / scans
                rows.append(
                    (f"{name}, {part}", like[name][1], each, like[name][3], updates / each, np.nan)
                )
    return rows


def _error(case: Case, truth: Truth) -> float:
    value = case.run()
    if case.scans > 1:
        value = value[-1]
    part = value[..., truth.tone if case.work.startswith("forward") else truth.pixel]
    return float(np.linalg.norm(part - case.exact) / np.linalg.norm(case.exact))


def _interleave(runs: list[Run], rounds: int) -> tuple[list[float], float, float]:
    """Run every case once per round, each round starting at the next; return medians, and those of the two peaks."""
    seconds = np.empty((rounds, len(runs)))
    peaks = np.empty((rounds, 2))
    for i in range(rounds):
        peaks[i] = peak_flops(), peak_bandwidth()
        for j in np.roll(np.arange(len(runs)), -i):
            start = time.perf_counter()
            runs[j]()
            seconds[i, j] = time.perf_counter() - start
    flops, bandwidth = np.median(peaks, axis=0)
    return [float(value) for value in np.median(seconds, axis=0)], float(flops), float(bandwidth)


def format_bench(table: pd.DataFrame) -> str:
    """Set the result of :func:`bench_imaging` as a Markdown table and the measured peaks."""
    lines = [
        "| work | code | ms | error | 1e9 updates/s | time / flgpr | of roofline |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in table.to_dict("records"):
        ratio = "" if np.isnan(row["ratio"]) else f"{row['ratio']:.2f}"
        share = "" if np.isnan(row["roofline"]) else f"{row['roofline']:.0%}"
        figures = f"{row['time'] * 1e3:.1f} | {row['error']:.1e} | {row['rate'] / 1e9:.2f} | {ratio} | {share}"
        lines.append(f"| {row['work']} | {row['code']} | {figures} |")
    flops = table.attrs["flops"] / 1e9
    bandwidth = table.attrs["bandwidth"] / 1e9
    lines += ["", f"Measured peaks: {flops:.0f} GFLOP/s in single precision, {bandwidth:.1f} GB/s."]
    if table.attrs["missing"]:
        lines += [
            "",
            f"Not installed and so not measured: {', '.join(table.attrs['missing'])} (extra bench).",
        ]
    return "\n".join(lines)
