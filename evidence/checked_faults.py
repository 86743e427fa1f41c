"""What ``flgpr check`` says of faults that are put into clean drives of the packaged arrays, one at a time.

The drives are those of ``faults.py`` (``drive``, 80 m of ``sri-array``) and ``health_limits.py`` (14 m and 7 m of the
other arrays); each is simulated once and kept. Usage::

    python evidence/checked_faults.py WORK_FOLDER [--drives NAME ...] [--only FAULT ...] [--table]

What was checked is kept in ``WORK_FOLDER/checked.jsonl``; a second call checks the rest, and prints the table.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import faults
from common import markdown
from faults import SEED, drive
from flgpr.health.checking import RIGHT, UNSEEN, check_run
from flgpr.model import make_run
from flgpr.store import open_run, save_run
from health_limits import ARRAYS
from health_limits import drive as short_drive

SITE = "prepared-sand"
Parts = dict[str, np.ndarray]
PART_NAMES = ("signal", "frequency", "polarization", "tx_position", "rx_position", "pose", "time")


def on(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Parts], Parts]:
    """Return a fault that changes one part of a run."""
    return lambda parts: {**parts, name: change(parts[name])}


def scaled_pair(factor: float) -> Callable[[Parts], Parts]:
    """Return a fault that multiplies the data of the fourth pair."""
    return on(
        "signal",
        lambda signal: signal * np.where(np.arange(signal.shape[2]) == 3, factor, 1)[:, None],
    )


def shared(name: str) -> Callable[[Parts], Parts]:
    """Return a fault of ``faults.py``."""

    def change(parts: Parts) -> Parts:
        copies = parts["signal"].copy(), parts["pose"].copy()
        signal, pose = faults.FAULTS[name](*copies, np.random.default_rng(SEED))
        return {**parts, "signal": signal, "pose": pose}

    return change


def drifting(signal: np.ndarray) -> np.ndarray:
    """Return data whose gain rises by 3 dB over the run."""
    return signal * 10 ** (np.linspace(0, 3, len(signal)) / 20)[:, None, None, None]


def reversed_receivers(parts: Parts) -> Parts:
    """Return a run whose receivers are listed from right to left instead of from left to right."""
    return {**parts, "rx_position": parts["rx_position"] * [-1, 1, 1]}


SHARED = (
    *("clean", "conjugated", "tones in reverse order", "poses one scan late"),
    *("poses two scans late", "datum 2 m ahead", "heading turned by 180 degrees"),
    *("heading off by 20 degrees", "height 0.3 m too large", "positions in feet"),
    "3 tones disturbed, 30 dB",
)
FAULTS: dict[str, Callable[[Parts], Parts]] = {
    **{name: shared(name) for name in SHARED},
    "receivers in reverse order": reversed_receivers,
    "height 0.3 m too small": on("pose", lambda pose: pose - [0, 0, 0.3, 0, 0, 0]),
    "frequencies in MHz": on("frequency", lambda frequency: frequency / 1e6),
    "angles in degrees": on("pose", lambda pose: pose * [1, 1, 1, *[180 / np.pi] * 3]),
    "one pair dead": scaled_pair(1e-4),
    "one pair 30 dB hot": scaled_pair(10**1.5),
    "one pair 10 dB hot": scaled_pair(10**0.5),
    "gain drifts by 3 dB": on("signal", drifting),
}
"""Faults by name; each takes the parts of a run and returns them changed."""


def faulty(run: xr.Dataset, name: str) -> xr.Dataset:
    """Return a run with a fault."""
    parts = FAULTS[name]({part: run[part].values for part in PART_NAMES})
    signal = np.asarray(parts.pop("signal"), np.complex64)
    return make_run(signal, *parts.values(), {"title": name})


def stored(folder: Path, name: str) -> xr.Dataset:
    """Return a drive, simulated by this or by an earlier call."""
    if name == "drive":
        return open_run(drive(folder))
    path = folder / f"{name}-{SITE}-1.zarr"
    if not path.exists():
        save_run(short_drive(SITE, name, 1), path)
    return open_run(path)


def checked(run: xr.Dataset) -> dict[str, object]:
    """Check a run, and return the verdict, and what is wrong or doubtful."""
    begun = time.monotonic()
    found = check_run(run)
    told = [
        f"{one.verdict}: {one.words}" for one in found.checks if one.verdict not in (RIGHT, UNSEEN)
    ]
    return {
        "verdict": found.verdict,
        "told": told,
        "answer": found.answer,
        "seconds": round(time.monotonic() - begun, 1),
    }


def in_words(row: dict[str, Any] | None) -> str:
    """Return the verdict on a drive, and how much better it focuses the other way."""
    if row is None:
        return "–"
    told = row["told"] or [""]
    gain = re.search(r"\+[0-9.]+ dB so taken", told[0])
    return f"{row['verdict']}{', ' + gain[0].removesuffix(' so taken') if gain else ''}"


def main() -> None:
    """Check what was not checked before, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder that keeps the drives")
    parser.add_argument("--drives", nargs="*", default=["drive", *ARRAYS])
    parser.add_argument("--only", nargs="*", default=list(FAULTS))
    parser.add_argument("--table", action="store_true", help="print the table alone")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    log = options.work / "checked.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    done = {(row["drive"], row["fault"]) for row in rows}
    for name in [] if options.table else options.drives:
        run = stored(options.work, name)
        for fault in options.only:
            if (name, fault) in done:
                continue
            try:
                row = {"drive": name, "fault": fault, **checked(faulty(run, fault))}
            except ValueError as error:
                row = {
                    "drive": name,
                    "fault": fault,
                    "verdict": "refused",
                    "told": [str(error)],
                    "seconds": 0,
                }
            rows.append(row)
            with log.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(row, flush=True)
    drives = list(dict.fromkeys(row["drive"] for row in rows))
    found = {(row["fault"], row["drive"]): row for row in rows}
    cells = []
    for fault in options.only:
        cells.append([fault, *(in_words(found.get((fault, name))) for name in drives)])
    print(markdown(("fault", *drives), cells))


if __name__ == "__main__":
    main()
