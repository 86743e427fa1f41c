"""Results of a folder of gprMax decks as the scans of a run."""

from __future__ import annotations

import hashlib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.door import MOST_CHECKED, MOST_JSON, Folder
from flgpr.json_text import canonical_json, parse_json
from flgpr.types import Complex128Array, ComplexArray, Entries
from flgpr_exchange.gprmax.output import GprmaxOutput, read_gprmax

FORMAT = "flgpr-gprmax-1"
MANIFEST = "manifest.json"
ENDINGS = (".h5", ".out")
_NEEDED = (
    "title",
    "polarization",
    "tones",
    "tx_position",
    "rx_position",
    "pose",
    "time",
    "waveform",
    "grid",
    "runs",
)
"""Entries of a manifest."""


def deck_texts() -> dict[str, str]:
    """Return the texts that are written beside decks, and the mapping of a merged B-scan."""
    packaged = resources.files("flgpr_exchange.gprmax") / "decks.toml"
    return tomllib.loads(packaged.read_text(encoding="utf-8"))


def read_manifest_of_decks(folder: str | Path) -> Entries:
    """Read the manifest of a folder of gprMax decks.

    Parameters
    ----------
    folder : path
        The folder.

    Returns
    -------
    dict of str to Any
        The manifest, as :class:`flgpr.simulate.Decks` describes it.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If the manifest is missing, damaged or of another version.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"folder of gprMax results not found: {folder}")
    path = folder / MANIFEST
    try:
        manifest: Entries = parse_json(Folder(folder).read(MANIFEST, MOST_JSON))
        if manifest["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {manifest['format']!r}")
        missing = [name for name in _NEEDED if name not in manifest]
        if missing:
            raise ValueError(f"missing: {', '.join(missing)}")
    except FileNotFoundError:
        raise ValueError(
            f"{folder}: must hold the {MANIFEST} that simulating with the engine gprmax wrote, "
            "it does not"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: the manifest is damaged or of another version ({error})"
        ) from None
    return manifest


class GprmaxRun:
    """The results of a folder of decks, ``manifest.json`` and all results, as the scans of a run.

    A scan is a pair's field over the transmitter's current moment, V/m per A·m, its direct wave
    (from the run of air alone) taken off unless ``keep_direct``, times j, so that a scatterer at
    path L gives ``exp(-j2πfL/c)`` as everywhere in flgpr.

    Parameters
    ----------
    folder : path
        The folder.
    keep_direct : bool
        Whether the direct wave stays.

    Raises
    ------
    ValueError
        If the manifest is damaged, or results are missing.
    """

    def __init__(self, folder: str | Path, keep_direct: bool = False) -> None:
        self.folder = Path(folder)
        self.keep_direct = keep_direct
        self.manifest = read_manifest_of_decks(folder)
        tones = self.manifest["tones"]
        numbers = np.arange(tones["count"], dtype=np.float64)
        self.frequency = tones["start"] + tones["step"] * numbers
        needed = {run["file"] for run in self.manifest["runs"]}
        if not keep_direct:
            needed |= {run["free"] for run in self.manifest["runs"]}
        self._needed = sorted(needed)
        missing = [name for name in self._needed if self._result(name) is None]
        if missing:
            raise ValueError(
                f"{folder}: {len(missing)} of {len(needed)} results are missing, "
                f"{missing[0]}{ENDINGS[0]} (or {ENDINGS[1]}) among them: "
                f"run gprMax on {missing[0]}.in"
            )
        # Of the scan before, which is often that of the next.
        self._air: dict[str, GprmaxOutput] = {}

    def __len__(self) -> int:
        return len(self.manifest["pose"])

    def scan(self, index: int) -> ComplexArray:
        """Put a scan together.

        Parameters
        ----------
        index : int
            Its number, from 0.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex
            Field over current moment, NaN where not finite.

        Raises
        ------
        ValueError
            If a result is damaged or does not fit the manifest.
        """
        labels = self.manifest["polarization"]
        pairs = len(self.manifest["tx_position"])
        shape = (len(labels), pairs, self.frequency.size)
        signal = np.full(shape, np.nan, dtype=np.complex128)
        runs = [run for run in self.manifest["runs"] if run["scan"] == index]
        free = {run["free"] for run in runs}
        self._air = {name: air for name, air in self._air.items() if name in free}
        for run in runs:
            scene = read_gprmax(self._result(run["file"]) or "")
            air = None
            if not self.keep_direct:
                air = self._air.get(run["free"]) or read_gprmax(self._result(run["free"]) or "")
                self._air[run["free"]] = air
            self._check(scene)
            # The spectrum of the dipole's current moment, A·m per Hz: the current, at half steps,
            # times a cell's edge.
            waveform = self.manifest["waveform"]
            kind, centre = str(waveform["type"]), float(waveform["frequency"])
            moment = scene.current(kind, centre, self.frequency) * float(scene.cell[0])
            for pair, receiver in zip(run["pairs"], run["receivers"], strict=True):
                for row, label in enumerate(labels):
                    if label[0] == run["transmit"]:
                        field = self._field(scene, receiver[label[1]])
                        if air is not None:
                            field = field - self._field(air, receiver[label[1]])
                        signal[row, pair] = 1j * field / moment
        return signal.astype(np.complex64)

    def digest(self) -> str:
        """Return the SHA-256 of the manifest and all results that the scans are made of."""
        digest = hashlib.sha256(canonical_json(self.manifest))
        for name in self._needed:
            with Folder(self.folder).open(self._file(name) or name, MOST_CHECKED) as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    def _result(self, name: str) -> Path | None:
        """Return a result that the manifest names.

        It must be a regular file in the folder; a link, or one outside, is refused.
        """
        file = self._file(name)
        if file is None:
            return None
        Folder(self.folder).check_size(file)
        return self.folder / file

    def _file(self, name: str) -> str | None:
        """Return the name of the file of a result, with its ending."""
        names = (f"{name}{ending}" for ending in ENDINGS)
        return next((file for file in names if Folder(self.folder).has(file)), None)

    def _check(self, output: GprmaxOutput) -> None:
        """Refuse a result whose cells or duration are not those of the manifest."""
        grid = self.manifest["grid"]
        if np.abs(output.cell - grid["cell"]).max() > 1e-6 * grid["cell"]:
            raise ValueError(
                f"{output.path}: cells must be {grid['cell']:g} m as in the manifest, "
                f"got {output.cell}"
            )
        duration = output.steps * output.time_step
        if duration < 0.99 * grid["time_window"]:
            raise ValueError(
                f"{output.path}: must last {grid['time_window']:g} s, got {duration:g} s"
            )

    def _field(self, output: GprmaxOutput, terms: list[Any]) -> Complex128Array:
        """Return the weighted sum (frequency,) of components of the field at receivers."""
        total = np.zeros(self.frequency.size, dtype=np.complex128)
        for name, component, weight in terms:
            total += weight * output.spectrum(name, f"E{component}", self.frequency)
        return total
