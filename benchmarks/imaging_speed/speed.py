"""Speed of the imaging operator beside other codes and the machine's own limits."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.imaging import ImagingOperator
from imaging_speed.cases import (
    PERMITTIVITY,
    SUBBANDS,
    Case,
    DirectSums,
    ImagedScan,
    direct_sums,
    sri_scan,
)
from imaging_speed.peers import cufinufft_rows, missing_peers, peer_cases
from imaging_speed.roofline import peak_bandwidth, peak_flops

BATCH = 32
"""Scans in flight on a CUDA device."""
REPEATS = 10
"""Launches that are timed together on a CUDA device."""
_DEVICE_STEPS = ("on the device", "interpolation alone")
_COLUMNS = ["work", "code", "time", "error", "rate", "roofline"]
_TABLE_HEAD = [
    "| work | code | ms | error | 1e9 updates/s | time / flgpr | of roofline |",
    "|---|---|---|---|---|---|---|",
]


class _Times(NamedTuple):
    """Medians over the rounds."""

    seconds: list[float]  #: of each case
    flops: float  #: measured peak, per second
    bandwidth: float  #: measured peak, bytes per second


def bench_imaging(peers: bool = False, rounds: int = 7, device: str = "cpu") -> pd.DataFrame:
    """Time the imaging operator, and if asked installed other codes, in interleaved rounds.

    On a CUDA device the other code is cuFINUFFT, and the sums alone are timed, too, on data that
    are on the device already.

    Parameters
    ----------
    peers : bool
        Whether other codes are timed.
    rounds : int
        Rounds, whose medians count.
    device : str
        "cpu" or "cuda".

    Returns
    -------
    pandas.DataFrame
        A row for each case: ``work``, ``code``, ``time`` (s per scan), ``error`` (relative L2
        against direct sums), ``rate`` (updates per second; an update is one pixel, pair and image),
        ``ratio`` (time over this package's at the same work) and ``roofline`` (least time that the
        measured peaks allow, over the time; this package on the CPU only).

    Raises
    ------
    ValueError
        If there is no round, or the device is missing.
    """
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    _require_device(device)

    scan = sri_scan()
    exact = direct_sums(scan)
    cases = own_cases(scan, exact, device)
    missing: list[str] = []
    if peers:
        missing = missing_peers(device)
        if device == "cpu":
            cases += peer_cases(scan, exact)

    errors = [_error(case, exact) for case in cases]
    times = _interleaved_times([case.run for case in cases], rounds)
    rows = []
    for case, error, seconds in zip(cases, errors, times.seconds, strict=True):
        rows.append(_row(case, error, seconds, scan, times, device))

    if device == "cuda":
        rows += _device_rows(scan, {row[0]: row for row in rows}, rounds)
        if peers and not missing:
            rows += cufinufft_rows(scan, exact, rounds)

    table = pd.DataFrame(rows, columns=_COLUMNS)
    own_times = table[table["code"] == f"flgpr {device}"].set_index("work")["time"]
    table["ratio"] = table["time"] / table["work"].map(own_times)
    table.attrs["flops"] = times.flops
    table.attrs["bandwidth"] = times.bandwidth
    table.attrs["missing"] = missing
    return table.sort_values(["work", "time"], ignore_index=True)


def _require_device(device: str) -> None:
    """Refuse a device that is not there, before anything is summed."""
    antenna = [[0.0, 0.0, 5.0]]
    ImagingOperator([1e9, 1.1e9], antenna, antenna, [[0.0, 8.0, 0.0]], device=device)


def own_cases(scan: ImagedScan, exact: DirectSums, device: str) -> list[Case]:
    """Return the cases of this package.

    Parameters
    ----------
    scan : ImagedScan
        The scan that is imaged.
    exact : DirectSums
        What images are checked against.
    device : str
        "cpu" or "cuda".

    Returns
    -------
    list of Case
        The cases.
    """

    def operator(
        tolerance: float, pixels: NDArray[np.float64] = scan.pixels, **options: Any
    ) -> ImagingOperator:
        return ImagingOperator(
            scan.frequency,
            scan.tx,
            scan.rx,
            pixels,
            tolerance=tolerance,
            device=device,
            **options,
        )

    images = operator(5e-4, subbands=SUBBANDS)
    buried = operator(5e-4, scan.buried_pixels(), subbands=SUBBANDS, half_space=PERMITTIVITY)
    channel = operator(1e-3)
    code = f"flgpr {device}"
    buffer = images.image_buffer(3)
    cases = []
    for work, one, sums in (
        ("15 images", images, exact.images),
        ("15 images, 1e-5", operator(1e-5, subbands=SUBBANDS), exact.images),
        ("15 images, ground", buried, exact.buried),
    ):
        run = partial(one.adjoint, scan.data, buffer)
        cases.append(Case(work, code, run, sums, 15, one.width))
    width = channel.width
    for work, run, sums in (
        ("one channel", partial(channel.adjoint, scan.data[:1]), exact.channel),
        ("forward", partial(channel.forward, scan.image[:1]), exact.forward[:1]),
    ):
        cases.append(Case(work, code, run, sums, 1, width))
    run = partial(channel.forward, scan.image)
    cases.append(Case("forward, 3 channels", code, run, exact.forward, 3, width))
    if device == "cuda":
        cases += _batch_cases(scan, exact, images, channel, code)
    return cases


def _batch_cases(
    scan: ImagedScan,
    exact: DirectSums,
    images: ImagingOperator,
    channel: ImagingOperator,
    code: str,
) -> list[Case]:
    """Return the cases of many scans at once, for a CUDA device."""
    batch = np.repeat(scan.data[None], BATCH, axis=0)
    cases = []
    for work, operator, data, sums, count in (
        ("15 images", images, batch, exact.images, 15),
        ("one channel", channel, np.ascontiguousarray(batch[:, :1]), exact.channel, 1),
    ):
        run = partial(operator.adjoint, data, operator.image_buffer(BATCH, data.shape[1]))
        work = f"{work} of {BATCH} scans"
        cases.append(Case(work, code, run, sums, count, operator.width, BATCH))
    return cases


def _row(
    case: Case, error: float, seconds: float, scan: ImagedScan, times: _Times, device: str
) -> tuple[Any, ...]:
    """Return the row of a case, with its share of the roofline where that is known.

    An update takes four operations for each sample of the interpolation, a complex number times a
    real weight, and eight for the carrier; every image is written once.
    """
    seconds /= case.scans
    pixels = len(scan.pixels)
    pairs = len(scan.tx)
    updates = pixels * pairs * case.images
    share = np.nan
    if device == "cpu" and case.width > 0:
        computing = updates * (4 * case.width + 8) / times.flops
        moving = 8 * pixels * case.images / times.bandwidth
        share = max(computing, moving) / seconds
    return (case.work, case.code, seconds, error, updates / seconds, share)


def _device_rows(
    scan: ImagedScan, rows_by_work: dict[str, tuple[Any, ...]], rounds: int
) -> list[tuple[Any, ...]]:
    """Time images without transfers; ``rows_by_work`` has the same images with transfers."""
    rows = []
    for work, polarizations, bands, tolerance in (
        ("15 images", 3, SUBBANDS, 5e-4),
        ("one channel", 1, None, 1e-3),
    ):
        operator = ImagingOperator(
            scan.frequency,
            scan.tx,
            scan.rx,
            scan.pixels,
            bands,
            tolerance,
            device="cuda",
        )
        channels = len(bands) if bands else 1
        updates = len(scan.pixels) * len(scan.tx) * polarizations * channels
        for scans, name in ((1, work), (BATCH, f"{work} of {BATCH} scans")):
            count = polarizations * scans
            times = []
            for _ in range(rounds):
                times.append(operator.backend.device_seconds(count, channels, REPEATS))
            # The data and so the error are those of the same work with transfers.
            _, code, _, error, *_ = rows_by_work[name]
            for step, seconds in zip(_DEVICE_STEPS, np.median(times, axis=0), strict=True):
                per_scan = float(seconds) / scans
                rate = updates / per_scan
                rows.append((f"{name}, {step}", code, per_scan, error, rate, np.nan))
    return rows


def _error(case: Case, exact: DirectSums) -> float:
    """Return the relative L2 error of a case on the checked pixels or tones."""
    value = case.run()
    if case.scans > 1:
        value = value[-1]
    is_forward = case.work.startswith("forward")
    indices = exact.tone if is_forward else exact.pixel
    difference = value[..., indices] - case.exact
    return float(np.linalg.norm(difference) / np.linalg.norm(case.exact))


def _interleaved_times(runs: Sequence[Callable[[], NDArray[Any]]], rounds: int) -> _Times:
    """Run every case once per round, and measure the peaks; return medians.

    Each round starts with the next case, so that none always runs on a warmer machine.
    """
    seconds = np.empty((rounds, len(runs)))
    peaks = np.empty((rounds, 2))
    for i in range(rounds):
        peaks[i, 0] = peak_flops()
        peaks[i, 1] = peak_bandwidth()
        order = np.roll(np.arange(len(runs)), -i)
        for j in order.tolist():
            start = time.perf_counter()
            runs[j]()
            seconds[i, j] = time.perf_counter() - start
    flops, bandwidth = np.median(peaks, axis=0)
    medians = [float(value) for value in np.median(seconds, axis=0)]
    return _Times(medians, float(flops), float(bandwidth))


def format_bench(table: pd.DataFrame) -> str:
    """Return the result of :func:`bench_imaging` as a Markdown table, and the measured peaks."""
    lines = list(_TABLE_HEAD)
    for row in table.to_dict("records"):
        ratio = "" if np.isnan(row["ratio"]) else f"{row['ratio']:.2f}"
        share = "" if np.isnan(row["roofline"]) else f"{row['roofline']:.0%}"
        cells = (
            row["work"],
            row["code"],
            f"{row['time'] * 1e3:.1f}",
            f"{row['error']:.1e}",
            f"{row['rate'] / 1e9:.2f}",
            ratio,
            share,
        )
        text = " | ".join(cells)
        lines.append(f"| {text} |")

    flops = table.attrs["flops"] / 1e9
    bandwidth = table.attrs["bandwidth"] / 1e9
    lines.append("")
    lines.append(f"Measured peaks: {flops:.0f} GFLOP/s in single precision, {bandwidth:.1f} GB/s.")
    if table.attrs["missing"]:
        names = ", ".join(table.attrs["missing"])
        lines += ["", f"Not installed and so not measured: {names} (extra bench)."]
    return "\n".join(lines)
