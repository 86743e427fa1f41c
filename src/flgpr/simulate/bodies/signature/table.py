"""Tables of signatures: what a body scatters over tones, soils, depths and directions.

Between the nodes of a table its values are interpolated.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from functools import cache, lru_cache
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from flgpr.archive import Archive
from flgpr.door import read_named
from flgpr.json_text import parse_json
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.faults import no_preset
from flgpr.simulate.bodies.signature.body import Body, load_body, packaged_bodies
from flgpr.types import Complex128Array, ComplexArray, FloatArray

_LOSS_REACH = 0.06  # of the loss tangent, to which the first order holds
FORMAT = "flgpr-signature-1"
FREQUENCY = 0.3e9 + 75e6 * np.arange(40)
PERMITTIVITY = np.array([2.5, 3.1, 3.5, 4.0, 4.6, 5.3, 6.3, 7.6, 12.0])
# Loss tangents that soils of these permittivities tend to have.
LOSS = np.array([0.02, 0.02, 0.02, 0.025, 0.035, 0.05, 0.08, 0.12, 0.15])
SINE = np.sin(np.radians(63.5) + np.radians(18.5) * np.cos(np.pi * (5.5 - np.arange(6)) / 6))
SEPARATION = np.radians([0.0, 15.0, 30.0])
DEPTH = np.array([0.005, 0.015, 0.03, 0.045, 0.07, 0.1, 0.15, np.inf])
ASPECT = np.radians(5.0 * np.arange(19))


@dataclass(frozen=True)
class SignatureTable:
    """A body's scattering amplitudes at the nodes of the library."""

    body: Body
    #: (permittivity, frequency, depth, aspect, sine, separation, 4): HH, VV, (HV + VH)/2 and (HV -
    #: VH)/2 in m, as ``solve_round`` gives them. Round bodies have one aspect, square ones those of
    #: an eighth of a turn, other boxes those of a quarter; boxes have one depth, infinity: the
    #: surface's multiples are left out
    values: ComplexArray

    @property
    def aspects(self) -> FloatArray:
        """Azimuths of the bisector from the body's long side, rad."""
        return ASPECT[: self.values.shape[3]]

    def at(
        self, frequency: FloatArray, permittivity: Complex128Array, depth: float
    ) -> ComplexArray:
        """Return the signature for given tones, soil and depth.

        Below the table's frequencies amplitudes fall as f², above them they stay. Between nodes
        they are cubic in the refractive index, clipped to the table; they are analytic in it, so
        that a loss other than the table's is an imaginary step in it, taken to first order and up
        to a loss tangent 0.06 away.

        Parameters
        ----------
        frequency : ndarray (frequency,)
            Tones, Hz.
        permittivity : ndarray (frequency,) of complex
            Of the soil.
        depth : float
            Soil over the top, m; infinity is soil without a surface.

        Returns
        -------
        ndarray (aspect, sine, separation, 4, frequency) of complex64
            HH, VV, (HV + VH)/2 and (HV - VH)/2, m.
        """
        # First over the soils, at the table's tones.
        share = self._permittivity_weights(frequency, permittivity)
        k = 2 * np.pi * FREQUENCY[:, None] / SPEED_OF_LIGHT
        down = k * np.sqrt(PERMITTIVITY[:, None, None] - SINE**2)  # (permittivity, f, sine)
        terms = []
        for term, path in self._terms(depth, down):
            # Without the phase of its path a term is smooth over the soils.
            smooth = term * _along(np.exp(1j * down * path))
            in_soil = np.einsum("fe,ef...->...f", share, smooth)
            terms.append((in_soil, path))

        # Then over the tones, with the phase of the path in this soil.
        tones = np.clip(frequency, FREQUENCY[0], FREQUENCY[-1])
        real = np.clip(permittivity.real, PERMITTIVITY[0], PERMITTIVITY[-1])
        soil = real * (1 - 1j * _excess_loss(permittivity))
        down = 2 * np.pi * tones / SPEED_OF_LIGHT * np.sqrt(soil - SINE[:, None] ** 2)  # (sine, f)
        total: Any = 0
        for term, path in terms:
            phase = np.exp(-1j * down * path)[:, None, None]
            at_tones = CubicSpline(FREQUENCY, term, axis=-1)(tones)
            total = total + at_tones * phase
        fade = np.minimum(frequency / FREQUENCY[0], 1.0) ** 2
        return np.asarray(total * fade, dtype=np.complex64)

    def _permittivity_weights(
        self, frequency: FloatArray, permittivity: Complex128Array
    ) -> Complex128Array:
        """Return the weights (table frequency, table permittivity) of the table's soils."""
        at_nodes = np.interp(FREQUENCY, frequency, permittivity.real)
        real = np.clip(at_nodes, PERMITTIVITY[0], PERMITTIVITY[-1])
        index = np.sqrt(real)
        # Splines through one in one soil and zero in all others are that soil's weight.
        between = CubicSpline(np.sqrt(PERMITTIVITY), np.identity(PERMITTIVITY.size), axis=0)
        weight = between(index)
        slope = between(index, 1)

        # sqrt(ε(1 - j·tan δ)) ≈ sqrt(ε)·(1 - j·tan δ/2)
        excess = np.interp(FREQUENCY, frequency, _excess_loss(permittivity))
        imaginary_step = -0.5j * index * excess
        return weight + imaginary_step[:, None] * slope

    def _terms(self, depth: float, down: FloatArray) -> list[tuple[Any, float]]:
        """Return the body's own echo and what the surface adds to it at a depth.

        Each comes with the path, m, without whose phase it is smooth over soils and tones. Echoes
        of a dielectric body's top and bottom lie about its middle, those of metal at its top; what
        the surface adds comes later by its first bounce, and falls as 1/d below the last node.
        """
        path = 0.0 if self.body.metal else self.body.height
        deep = self.values[:, :, -1]
        if self.values.shape[2] == 1 or depth == np.inf:
            return [(deep, path)]
        depths = DEPTH[:-1]
        at_least = max(depth, depths[0])
        position = np.interp(depth, depths, np.arange(depths.size))
        low = min(int(position), depths.size - 2)
        added: Any = 0
        for node, share in ((low, 1 - (position - low)), (low + 1, position - low)):
            if share > 0:
                turn = np.exp(2j * down * (depths[node] - at_least))
                added = added + share * (self.values[:, :, node] - deep) * _along(turn)
        fade = min(depths[-1] / at_least, 1.0)
        return [(deep, path), (added * fade, path + 2 * at_least)]


def _along(phase: Complex128Array) -> Complex128Array:
    """Return phases (permittivity, frequency, sine) along the axes of a table's values."""
    return phase[:, :, None, :, None, None]


def _excess_loss(permittivity: Complex128Array) -> FloatArray:
    """Return a soil's loss tangent over that of the table at its permittivity.

    It is at most 0.06 either way.
    """
    index = np.sqrt(permittivity.real)
    table_loss = np.interp(index, np.sqrt(PERMITTIVITY), LOSS)
    loss = -permittivity.imag / permittivity.real
    return np.clip(loss - table_loss, -_LOSS_REACH, _LOSS_REACH)


def save_table(table: SignatureTable, path: Path) -> str:
    """Write a table as one file.

    Values are stored as 16-bit numbers, right to 1e-3 of the largest of a soil and tone.

    Parameters
    ----------
    table : SignatureTable
        The table.
    path : Path
        File to write.

    Returns
    -------
    str
        SHA-256 of the file.
    """
    scale = np.abs(table.values).max(axis=(2, 3, 4, 5, 6), keepdims=True)
    halves = (table.values / scale).view(np.float32).astype(np.float16)
    about = {"format": FORMAT, "body": table.body.model_dump(mode="json"), "nodes": table_nodes()}
    text = np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, about=text, values=halves, scale=scale.astype(np.float32))
    path.write_bytes(buffer.getvalue())
    return sha256(buffer.getvalue()).hexdigest()


def table_nodes() -> dict[str, list[float]]:
    """Return the nodes at which tables are computed, by name and unit."""
    return {
        "frequency_hz": FREQUENCY.tolist(),
        "permittivity": PERMITTIVITY.tolist(),
        "loss_tangent": LOSS.tolist(),
        "sine": np.round(SINE, 12).tolist(),
        "separation_rad": SEPARATION.tolist(),
        "depth_m": DEPTH[:-1].tolist(),
        "aspect_rad": ASPECT.tolist(),
    }


def load_table(path: Any) -> SignatureTable:
    """Read a table that :func:`save_table` wrote.

    Parameters
    ----------
    path : Path or importlib.resources.abc.Traversable
        File to read.

    Returns
    -------
    SignatureTable
        The table.

    Raises
    ------
    ValueError
        If the file is no table of signatures, or one for other nodes.
    """
    try:
        content = read_named(path) if isinstance(path, Path) else path.read_bytes()
        data = Archive(io.BytesIO(content))
        about = parse_json(bytes(data["about"]))
        values = data["values"].astype(np.float32).view(np.complex64) * data["scale"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"signature {path}: not a table of signatures: {error}") from None
    if about.get("format") != FORMAT or about.get("nodes") != table_nodes():
        raise ValueError(f"signature {path}: made for other nodes, make it again from its body")
    return SignatureTable(Body.model_validate(about["body"]), values)


@cache
def packaged_table(name: str) -> SignatureTable:
    """Return the table of a packaged body."""
    return load_table(resources.files("flgpr.simulate.bodies.signature") / "tables" / f"{name}.npz")


@lru_cache(maxsize=32)
def find_table(name: str) -> SignatureTable:
    """Return a table by the name of a packaged body or the path of a file.

    Raises
    ------
    ValueError
        If there is neither.
    """
    if name in packaged_bodies():
        return packaged_table(name)
    if not Path(name).is_file():
        raise ValueError(no_preset("body", name, packaged_bodies()))
    return load_table(Path(name))


def find_body(name: str) -> Body:
    """Return a body by name; names are those of :func:`find_table`."""
    # The packaged tables are large: their bodies stand in small files of their own.
    return load_body(name) if name in packaged_bodies() else find_table(name).body


def body_size(name: str) -> dict[str, float]:
    """Return a body's radius (of a box half its long side) and height, m, by name.

    Names are those of :func:`find_table`.
    """
    body = find_body(name)
    return {"radius": body.radius * body.elongation, "height": body.height}
