"""A run as a SigMF recording, with the mapping that takes it back."""

from __future__ import annotations

import hashlib
import math
from datetime import UTC, datetime, timedelta
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flgpr.door import MOST_JSON
from flgpr.json_text import MOST_VALUES, compact_json, count_values
from flgpr.model import check_run
from flgpr.model.printable import printable
from flgpr.model.run import polarizations_of
from flgpr.store.notes import log_note
from flgpr.store.outputs import atomic_output
from flgpr.store.text import utc_text
from flgpr.toml_text import toml_value
from flgpr.types import Entries
from flgpr_exchange.sigmf.reading import DATA, META, NAMESPACE, VERSION

if TYPE_CHECKING:
    from flgpr.geo.anchor import Anchor

NAMESPACE_VERSION = "1.0.0"
"""Version of the extension's description, ``docs/reference/flgpr.sigmf-ext.md``."""
_SHA512_DIGITS = 128
_IN_MAPPING = ("title", "source", "import_notes")
"""Attributes of a run that an import gives it again."""
_MAPPING = """\
# Takes the recording back as a run: flgpr import mapped {name}.toml -o run.zarr
title = {title}
source = {source}
files.data = {data}
polarization = {polarization}

[signal]
variable = "samples"
shape = [-1, {tones}, {polarizations}, {pairs}]
dims = ["scan", "frequency", "polarization", "pair"]

[frequency]
variable = "global/flgpr:frequency"
unit = "Hz"

[tx_position]
variable = "global/flgpr:tx_position"
unit = "m"

[rx_position]
variable = "global/flgpr:rx_position"
unit = "m"

[pose]
position = {{variable = "captures/flgpr:pose", unit = "m"}}
angle_unit = "rad"
"""
_TIME_OF_MAPPING = """
[time]
variable = "captures/flgpr:time"
unit = "s"
"""


def write_sigmf(
    run: xr.Dataset,
    folder: str | Path,
    anchor: Anchor | None = None,
    time: datetime | None = None,
) -> Path:
    """Write a run as a SigMF recording of cf32_le, with a mapping that takes it back.

    Every scan is a capture, every tone a sample, and every polarization of every pair a channel.
    Tones, positions of antennas, poses and times are entries of the extension ``flgpr``, which
    ``docs/reference/flgpr.sigmf-ext.md`` describes. All numbers come back equal.

    Parameters
    ----------
    run : xarray.Dataset
        The run, see :func:`flgpr.model.make_run`.
    folder : str or Path
        Folder to make. It holds ``NAME.sigmf-meta``, ``NAME.sigmf-data`` and ``NAME.toml``, the
        mapping, where NAME is the folder's own.
    anchor : Anchor, optional
        Where the lane lies; places of the scans on the Earth are then in the metadata.
    time : datetime, optional
        When the first scan was recorded, with a time zone; the times of the scans are then in the
        metadata.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    ValueError
        If the run breaks a rule, the time has no time zone, or the run has so many scans that
        readers would refuse its metadata; then nothing is written.
    FileExistsError
        If the folder exists and holds something else.
    """
    check_run(run)
    if time is not None and time.tzinfo is None:
        raise ValueError(f"time must have a time zone, got {time.isoformat()}")
    folder = Path(folder)
    left_out = sorted(str(name) for name in run.attrs if name not in _IN_MAPPING)
    captures = _captures(run, anchor, time)
    _check_readable(_metadata(run, captures, digest="0" * _SHA512_DIGITS), len(captures))
    digest = hashlib.sha512()
    with atomic_output(folder) as partial:
        partial.mkdir()
        with (partial / f"{folder.name}{DATA}").open("wb") as file:
            for scan in range(run.sizes["scan"]):
                signal = run["signal"].isel(scan=scan)
                by_sample = signal.transpose("frequency", "polarization", "pair").values
                data = by_sample.astype("<c8").tobytes()
                digest.update(data)
                file.write(data)
        metadata = _metadata(run, captures, digest.hexdigest())
        (partial / f"{folder.name}{META}").write_bytes(metadata)
        mapping = _mapping(run, folder.name)
        (partial / f"{folder.name}.toml").write_text(mapping, encoding="utf-8")
    if left_out:
        log_note(
            f"SigMF has no place for {len(left_out)} attributes of the run, which are left out: "
            f"{', '.join(left_out)}"
        )
    return folder


def _metadata(run: xr.Dataset, captures: list[Entries], digest: str) -> bytes:
    """Return the file of the metadata, JSON without blanks: a capture takes up to 400 bytes."""
    content = {"global": _global(run, digest), "captures": captures, "annotations": []}
    return compact_json(content).encode() + b"\n"


def _check_readable(metadata: bytes, scans: int) -> None:
    """Refuse metadata that are larger than a reader of flgpr takes."""
    values = count_values(metadata)
    share = max(len(metadata) / MOST_JSON, values / MOST_VALUES)
    if share > 1:
        most = _rounded(scans / share)
        size = f"{len(metadata) / 2**20:.1f} MiB"
        raise ValueError(
            f"the metadata of a SigMF recording must be at most {MOST_JSON / 2**20:g} MiB and "
            f"{MOST_VALUES} values, which is what readers take, got {size} and {values} values "
            f"of {scans} scans: write parts of at most about {most} scans, "
            f"in Python write_sigmf(run.isel(scan=slice(0, {most})), ...)"
        )


def _rounded(count: float) -> int:
    """Return a number of two digits that is not above a count."""
    digits = max(len(str(int(count))) - 2, 0)
    return int(count) // 10**digits * 10**digits


def _global(run: xr.Dataset, digest: str) -> Entries:
    """Return what the metadata state of the whole recording."""
    entries: Entries = {
        "core:datatype": "cf32_le",
        "core:version": VERSION,
        "core:num_channels": run.sizes["polarization"] * run.sizes["pair"],
        "core:sha512": digest,
        "core:recorder": "flgpr",
        "core:extensions": [
            {"name": NAMESPACE, "version": NAMESPACE_VERSION, "optional": True},
        ],
    }
    title = str(run.attrs.get("title", ""))
    if title:
        entries["core:description"] = title
    entries[f"{NAMESPACE}:polarization"] = polarizations_of(run)
    for name in ("frequency", "tx_position", "rx_position"):
        entries[f"{NAMESPACE}:{name}"] = run[name].values.tolist()
    return entries


def _captures(run: xr.Dataset, anchor: Anchor | None, time: datetime | None) -> list[Entries]:
    """Return what the metadata state of every scan."""
    frequency = run["frequency"].values
    center = float(frequency[0] + frequency[-1]) / 2
    poses = run["pose"].values
    times = run["time"].values
    places = None if anchor is None else anchor.to_geodetic(poses[:, :3]).tolist()
    captures = []
    for scan, pose in enumerate(poses.tolist()):
        capture: Entries = {
            "core:sample_start": scan * frequency.size,
            "core:frequency": center,
        }
        moment = _moment(time, times, scan)
        if moment is not None:
            capture["core:datetime"] = moment
        if anchor is not None and places is not None:
            longitude, latitude, height = places[scan]
            coordinates = [round(longitude, 9), round(latitude, 9)]
            if anchor.heights_known:
                coordinates.append(round(height, 4))
            capture["core:geolocation"] = {"type": "Point", "coordinates": coordinates}
        capture[f"{NAMESPACE}:pose"] = pose
        if math.isfinite(times[scan]):
            capture[f"{NAMESPACE}:time"] = float(times[scan])
        captures.append(capture)
    return captures


def _moment(time: datetime | None, times: np.ndarray[Any, Any], scan: int) -> str | None:
    """Return when a scan was recorded, UTC; None where that is not known."""
    if time is None:
        return None
    seconds = 0.0 if scan == 0 else float(times[scan] - times[0])
    if not math.isfinite(seconds):
        return None
    try:
        return utc_text(time.astimezone(UTC) + timedelta(seconds=seconds))
    except OverflowError:
        raise ValueError(
            f"time of scan {scan} must lie in the years 1 to 9999, got {seconds:g} s after {time}"
        ) from None


def _mapping(run: xr.Dataset, name: str) -> str:
    """Return the mapping that takes a recording back, TOML."""
    text = _MAPPING.format(
        name=printable(name),
        title=_text_value(run.attrs.get("title", "")),
        source=_text_value(run.attrs.get("source", "")),
        data=_text_value(escape(f"{name}{META}")),  # it is a pattern of names
        polarization=toml_value(polarizations_of(run)),
        tones=run.sizes["frequency"],
        polarizations=run.sizes["polarization"],
        pairs=run.sizes["pair"],
    )
    has_times = bool(np.isfinite(run["time"].values).any())
    return text + _TIME_OF_MAPPING if has_times else text


def _text_value(text: Any) -> str:
    """Return a text as a string of TOML, without the halves of characters that UTF-8 has not."""
    return toml_value(str(text).encode("utf-8", "replace").decode("utf-8"))
