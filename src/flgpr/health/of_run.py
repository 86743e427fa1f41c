"""Health of a stored run in one pass, and the run without what is left out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.health.findings import LEAST_SCANS
from flgpr.health.geometry import (
    GeometryCheck,
    GeometryFigures,
    like_polarized,
    sampled_scans,
)
from flgpr.health.hypotheses import BLOCK_SCANS, BLOCKS, MOST_LAG, Taken
from flgpr.health.judging import (
    Health,
    LeftOut,
    Radar,
    judge_course,
    judge_geometry,
    judge_motion,
    judge_sums,
    what_to_leave_out,
)
from flgpr.health.sums import HealthSums
from flgpr.model import Lane
from flgpr.types import FloatArray

MOST_SCANS = 256
"""Scans that are read: of a longer run stretches, evenly over it."""
_STRETCH = 32  # scans of a stretch


@dataclass(frozen=True)
class Examined:
    """What one pass over a run shows."""

    health: Health
    radar: Radar
    sums: HealthSums


def health_of_run(run: xr.Dataset, lane: Lane | None = None) -> Health:
    """Judge the health of a run by its raw data and poses, in one pass.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    lane : Lane, optional
        Ground that is to be searched; with it the course is compared with its middle.

    Returns
    -------
    Health
        What is wrong, and which pairs and tones are to be left out.
    """
    return examined(run, lane).health


def examined(run: xr.Dataset, lane: Lane | None = None, drift: bool = False) -> Examined:
    """Judge the health of a run, see :func:`health_of_run`; with ``drift`` the sums tell it."""
    radar = radar_of(run)
    sums, steps, samples = read_sums(run, drift)
    found = judge_sums(sums, radar)
    found += judge_motion(steps, np.array(sums.changed))
    settled = what_to_leave_out(found, radar)
    findings = list(settled.findings)
    names = {one.name for one in findings}
    if not names & {"noise", "repeated scans"} and run.attrs.get("sounding") != "ground-coupled":
        figures = geometry_figures(run, radar, sums, samples, settled.left_out)
        findings += judge_geometry(figures)
    findings += judge_course(run["pose"].values, lane)
    return Examined(Health(tuple(findings), settled.left_out), radar, sums)


def radar_of(run: xr.Dataset) -> Radar:
    """Return what the sums of a run are judged by."""
    return Radar(
        tuple(str(label) for label in run["polarization"].values),
        np.asarray(run["frequency"].values, np.float64),
        np.asarray(run["tx_position"].values, np.float64),
        np.asarray(run["rx_position"].values, np.float64),
    )


def read_sums(
    run: xr.Dataset, drift: bool = False
) -> tuple[HealthSums, FloatArray, dict[int, NDArray[Any]]]:
    """Read scans once.

    Return their sums (with those of the quarters, which tell drift), the distance (m) of each from
    the one before, and the data of those that are looked at, by number.
    """
    scans = run.sizes["scan"]
    numbers = np.arange(scans)
    if scans > MOST_SCANS:
        starts = np.linspace(0, scans - _STRETCH, MOST_SCANS // _STRETCH).astype(int)
        numbers = np.unique(starts[:, None] + np.arange(_STRETCH))
    pose = run["pose"].values
    looked_at = set(numbers[sampled_scans(numbers.size)].tolist())
    sums = HealthSums(run["signal"].shape[1:], numbers.size if drift else 0)
    steps = np.full(numbers.size, np.nan)
    samples: dict[int, NDArray[Any]] = {}
    before = -2
    for place, number in enumerate(numbers.tolist()):
        if number != before + 1:
            sums.gap()
        else:
            steps[place] = np.hypot(*(pose[number, :2] - pose[before, :2]))
        signal = run["signal"].variable[number].values
        sums.add(signal)
        if number in looked_at:
            samples[number] = signal
        before = number
    return sums, np.where(np.isfinite(steps), steps, 0.0), samples


def geometry_figures(
    run: xr.Dataset,
    radar: Radar,
    sums: HealthSums,
    samples: dict[int, NDArray[Any]],
    left_out: LeftOut,
) -> GeometryFigures:
    """Return what the scans that were kept tell of paths, receivers and poses."""
    pose = np.asarray(run["pose"].values, np.float64)
    if sums.scans < LEAST_SCANS or not np.isfinite(pose).all():
        return GeometryFigures()
    pairs = np.setdiff1d(np.arange(sums.shape[1]), left_out.pairs)
    standing = _kept(sums.standing / np.maximum(sums.sweeps, 1)[..., None], left_out)
    usable = {}
    for number, signal in samples.items():
        kept = _kept(signal, left_out)
        if np.isfinite(kept).all():
            usable[number] = kept
    check = GeometryCheck(
        radar.frequency,
        radar.tx_position[pairs],
        radar.rx_position[pairs],
        radar.polarizations,
        standing,
    )
    return check.figures(list(usable), list(usable.values()), pose)


def _kept(signal: NDArray[Any], left_out: LeftOut) -> NDArray[np.complex64]:
    """Return data (polarization, pair, frequency) without pairs, and with tones set to zero."""
    kept = np.delete(signal, left_out.pairs, axis=1).astype(np.complex64)
    kept[..., list(left_out.tones)] = 0
    return kept


def taken_of_run(run: xr.Dataset, of_run: Examined) -> Taken | None:
    """Return stretches of consecutive scans as they are stated; None where there are too few.

    Scans with a sweep that is not finite are left out.
    """
    pose = np.asarray(run["pose"].values, np.float64)
    sums, radar, left_out = of_run.sums, of_run.radar, of_run.health.left_out
    scans = len(pose)
    margin = MOST_LAG if scans >= 2 * BLOCKS + 2 * MOST_LAG else 0
    count = min(BLOCKS, (scans - 2 * margin) // BLOCK_SCANS)
    starts = np.linspace(margin, scans - margin - BLOCK_SCANS, max(count, 1)).astype(int)
    standing = _kept(sums.standing / np.maximum(sums.sweeps, 1)[..., None], left_out)
    echoes = []
    numbers = []
    stretch = []
    for place, number in product(range(count), range(BLOCK_SCANS)):
        number += int(starts[place])
        kept = _kept(run["signal"].variable[number].values, left_out)
        if np.isfinite(kept).all() and np.isfinite(pose[number]).all():
            echoes.append((kept - standing)[like_polarized(radar.polarizations)])
            numbers.append(number)
            stretch.append(place)
    if len(numbers) < LEAST_SCANS:
        return None
    pairs = np.setdiff1d(np.arange(len(radar.tx_position)), left_out.pairs)
    return Taken(
        np.array(echoes),
        np.array(numbers),
        np.array(stretch),
        radar.frequency,
        radar.tx_position[pairs],
        radar.rx_position[pairs],
        pose,
    )


def without(run: xr.Dataset, left_out: LeftOut) -> xr.Dataset:
    """Return a run without pairs and tones.

    A sweep whose faulty tones are left out is there again: it is read for it.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    left_out : LeftOut
        Numbers of its pairs and tones.
    """
    if not left_out:
        return run
    pairs = np.setdiff1d(np.arange(run.sizes["pair"]), left_out.pairs)
    tones = np.setdiff1d(np.arange(run.sizes["frequency"]), left_out.tones)
    kept = run.isel(pair=pairs, frequency=tones)
    if not left_out.tones:
        return kept
    valid = kept["valid"].values.copy()
    for number in np.flatnonzero(~valid.all(axis=(1, 2))):
        valid[number] = np.isfinite(kept["signal"].variable[number].values).all(axis=-1)
    return kept.assign(valid=(kept["valid"].dims, valid))
