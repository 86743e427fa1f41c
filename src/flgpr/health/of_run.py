"""Health of a stored run in one pass, and the run without what is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.health.findings import LEAST_SCANS, SPOILING, Finding
from flgpr.health.focus import AIRBORNE, Taken, like_polarized, looked_at, mean_height, taken
from flgpr.health.hypotheses import MOST_LAG, Ways, best_ways, first_gains, judge_paths
from flgpr.health.judging import (
    Health,
    LeftOut,
    Radar,
    judge_course,
    judge_motion,
    judge_sums,
    what_to_leave_out,
)
from flgpr.health.sums import HealthSums
from flgpr.model import Lane
from flgpr.model.frames import steps_of
from flgpr.model.run import polarizations_of
from flgpr.types import ComplexArray, FloatArray, floats

MOST_SCANS = 256
"""Scans that are read: of a longer run stretches, evenly over it."""
_STRETCH = 32  # scans of a stretch
_LOOKS = 16  # stretches of a run whose looks are compared
_LOOK_SCANS = 4  # consecutive scans of such a stretch: each is compared with all later ones of it
_FIRST_LOOKS = 4  # such stretches for a first look


@dataclass(frozen=True)
class Examined:
    """What is seen of a run."""

    health: Health
    radar: Radar
    sums: HealthSums
    ways: Ways
    unseen: str  #: why the looks of the run tell nothing; "" where they may


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


def examined(run: xr.Dataset, lane: Lane | None = None, thorough: bool = False) -> Examined:
    """Judge the health of a run, see :func:`health_of_run`.

    With ``thorough`` the sums tell drift, and every way to take the run is tried, not only the quick
    ones where a first look leaves a doubt.
    """
    radar = radar_of(run)
    sums, steps = read_sums(run, drift=thorough)
    found = judge_sums(sums, radar)
    found += judge_motion(steps, np.array(sums.changed))
    settled = what_to_leave_out(found, radar)
    ways = Ways()
    unseen = _unseen(run, radar)
    unmoved = _unmoved(run, found)
    if not (unseen or unmoved):
        few = taken_of_run(run, sums.mean, radar, settled.left_out, first=True)
        if few is None:
            unseen = f"fewer than {LEAST_SCANS} consecutive scans are whole"
        elif thorough or any(gain > 0 for _, gain in first_gains(few)):
            scans = taken_of_run(run, sums.mean, radar, settled.left_out)
            ways = best_ways(scans or few, quick=not thorough)
            if not ways.is_seen:
                unseen = (
                    "consecutive looks show nothing in common, whichever way they are taken: are the "
                    "scans in the order of their poses?"
                )
                if few.height > AIRBORNE:
                    unseen = f"the antennas fly, {few.height:.3g} m above the ground"
    told = [way.finding for way in ways.adopted if ways.is_seen]
    if unmoved and not unseen:
        for standing in (
            sums.mean,
            np.zeros(1),
        ):  # all that a vehicle that stands sees stands still
            few = taken_of_run(run, standing, radar, settled.left_out, first=True)
            told = told or judge_paths(few)
    findings = (*settled.findings, *told, *judge_course(run["pose"].values, lane))
    return Examined(Health(findings, settled.left_out), radar, sums, ways, unseen or unmoved)


def _unseen(run: xr.Dataset, radar: Radar) -> str:
    """Return why the array of a run does not look ahead, or cannot be focused; "" where it does."""
    if run.attrs.get("sounding") == "ground-coupled":
        return "antennas on the ground do not look ahead"
    if looked_at(radar.frequency) is None:
        return "the tones are uneven, or fewer than nine"
    height = mean_height(run["pose"].values, radar.tx_position, radar.rx_position)
    return "" if height > 0 else f"the antennas stand {height:.3g} m above the ground"


def _unmoved(run: xr.Dataset, found: list[Finding]) -> str:
    """Return why consecutive looks tell nothing; "" where they may."""
    spoilt = [one.name for one in found if one.name in SPOILING]
    if spoilt:
        return f"the run has {', '.join(spoilt)}"
    steps = steps_of(run["pose"].values)
    return "the vehicle stands" if len(steps) and not np.median(steps) else ""


def radar_of(run: xr.Dataset) -> Radar:
    """Return what the sums of a run are judged by."""
    return Radar(
        tuple(polarizations_of(run)),
        floats(run["frequency"].values),
        floats(run["tx_position"].values),
        floats(run["rx_position"].values),
    )


def read_sums(run: xr.Dataset, drift: bool = False) -> tuple[HealthSums, FloatArray]:
    """Read scans once.

    Return their sums (with those of the quarters, which tell drift), and the distance (m) of each
    from the one before.
    """
    scans = run.sizes["scan"]
    numbers = np.arange(scans)
    if scans > MOST_SCANS:
        starts = np.linspace(0, scans - _STRETCH, MOST_SCANS // _STRETCH).astype(int)
        numbers = np.unique(starts[:, None] + np.arange(_STRETCH))
    pose = run["pose"].values
    sums = HealthSums(run["signal"].shape[1:], numbers.size if drift else 0)
    steps = np.zeros(numbers.size)
    before = -2
    for place, number in enumerate(numbers.tolist()):
        if number != before + 1:
            sums.gap()
        else:
            steps[place] = np.nan_to_num(np.hypot(*(pose[number, :2] - pose[before, :2])))
        sums.add(run["signal"].variable[number].values)
        before = number
    return sums, steps


def taken_of_run(
    run: xr.Dataset, standing: NDArray[Any], radar: Radar, left_out: LeftOut, first: bool = False
) -> Taken | None:
    """Return stretches of consecutive scans as they are recorded; None where there are too few.

    Scans with a sweep that is not finite are left out.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    standing : (polarization, pair, frequency) ndarray of complex
        What stands still, and is no echo of the ground.
    radar : Radar
        Places of its channels and tones.
    left_out : LeftOut
        What of it is left out.
    first : bool
        Whether a few stretches are enough, for a first look.
    """
    pose = floats(run["pose"].values)
    scans = len(pose)
    margin = MOST_LAG if scans > 6 * MOST_LAG else 0
    last = scans - margin - _LOOK_SCANS
    most = min(_FIRST_LOOKS if first else _LOOKS, 1 + (last - margin) // 2)  # halves may be shared
    starts = np.linspace(margin, last, max(most, 1)).astype(int)[:most]
    echoes = {}
    for number in np.unique(starts[:, None] + np.arange(_LOOK_SCANS)).tolist():
        signal = _kept(run["signal"].variable[number].values - standing, radar, left_out)
        if np.isfinite(signal).all() and np.isfinite(pose[number]).all():
            echoes[number] = signal
    if len(echoes) < LEAST_SCANS:
        return None
    numbers = np.array(list(echoes))
    within = (numbers - starts[:, None] >= 0) & (numbers - starts[:, None] < _LOOK_SCANS)
    kept = np.setdiff1d(np.arange(len(radar.tx_position)), left_out.pairs)
    return taken(
        np.array(list(echoes.values())),
        radar.frequency[looked_at(radar.frequency)],
        numbers.tolist(),
        [np.flatnonzero(of_stretch).tolist() for of_stretch in within],
        radar.tx_position[kept],
        radar.rx_position[kept],
        pose,
    )


def _kept(signal: NDArray[Any], radar: Radar, left_out: LeftOut) -> ComplexArray:
    """Return the part of a scan that is looked at, without pairs, and with tones set to zero."""
    kept = signal[like_polarized(radar.polarizations)].astype(np.complex64)
    kept[..., list(left_out.tones)] = 0
    return np.delete(kept, left_out.pairs, axis=1)[..., looked_at(radar.frequency)]


def without(run: xr.Dataset, left_out: LeftOut, silent_tones: bool = False) -> xr.Dataset:
    """Return a run without pairs and tones.

    A sweep whose faulty tones are left out is there again: it is read for it. With ``silent_tones``
    the tones stay, as zeros, where a run beside has all of them.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    left_out : LeftOut
        Numbers of its pairs and tones.
    silent_tones : bool
        Whether its tones are set to zero in place.
    """
    if not left_out:
        return run
    if silent_tones and left_out.tones:
        kept = without(run, LeftOut(left_out.pairs)).compute()
        kept["signal"].values[..., list(left_out.tones)] = 0
        finite = np.isfinite(kept["signal"].values).all(axis=-1)
        return kept.assign(valid=(kept["valid"].dims, finite))
    pairs = np.setdiff1d(np.arange(run.sizes["pair"]), left_out.pairs)
    tones = np.setdiff1d(np.arange(run.sizes["frequency"]), left_out.tones)
    kept = run.isel(pair=pairs, frequency=tones)
    if not left_out.tones:
        return kept
    valid = kept["valid"].values.copy()
    for number in np.flatnonzero(~valid.all(axis=(1, 2))):
        valid[number] = np.isfinite(kept["signal"].variable[number].values).all(axis=-1)
    return kept.assign(valid=(kept["valid"].dims, valid))
