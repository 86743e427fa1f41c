"""Tables of signatures: what a body scatters over tones, soils, depths and directions, and reading between nodes."""

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
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flgpr.archive import Archive
from flgpr.door import parse_json, read_named
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.model.faults import no_preset
from flgpr.simulate.bodies.signature.body import Body, load_body, packaged_bodies

_LOSS_REACH = 0.06
FORMAT = "flgpr-signature-1"
FREQUENCY = 0.3e9 + 75e6 * np.arange(40)
PERMITTIVITY = np.array([2.5, 3.1, 3.5, 4.0, 4.6, 5.3, 6.3, 7.6, 12.0])
LOSS = np.array(
    [0.02, 0.02, 0.02, 0.025, 0.035, 0.05, 0.08, 0.12, 0.15]
)  # tangent that soils of that permittivity tend to have
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
    values: NDArray[np.complex64]

    @property
    def aspects(self) -> FloatArray:
        """Azimuths of the bisector from the body's long side, rad."""
        return ASPECT[: self.values.shape[3]]

    def at(
        self, frequency: FloatArray, permittivity: ComplexArray, depth: float
    ) -> NDArray[np.complex64]:
        """Signature (aspect, sine, separation, 4, frequency) for given tones, soil and depth: HH, VV, (HV ± VH)/2, m.

        Below the table's frequencies amplitudes fall as f², above them they stay. Between nodes
        they are cubic in the refractive index, clipped to the table; they are analytic in it, so
        that a loss other than the table's is a step aside in it, taken to first order and up to a
        loss tangent 0.06 away. ``depth`` is soil over the top; infinity is soil without a surface.
        """
        real = np.clip(
            np.interp(FREQUENCY, frequency, permittivity.real), PERMITTIVITY[0], PERMITTIVITY[-1]
        )
        between = CubicSpline(np.sqrt(PERMITTIVITY), np.identity(PERMITTIVITY.size), axis=0)
        aside = -0.5j * np.sqrt(real) * np.interp(FREQUENCY, frequency, _loss_off(permittivity))
        share = between(np.sqrt(real)) + aside[:, None] * between(np.sqrt(real), 1)
        k = 2 * np.pi * FREQUENCY[:, None] / SPEED_OF_LIGHT
        down = k * np.sqrt(PERMITTIVITY[:, None, None] - SINE**2)  # (permittivity, f, sine)
        parts = self._parts(depth, down)
        smooth = [part * _along(np.exp(1j * down * way)) for part, way in parts]
        here = [np.einsum("fe,ef...->...f", share, part) for part in smooth]
        tones = np.clip(frequency, FREQUENCY[0], FREQUENCY[-1])
        soil = np.clip(permittivity.real, PERMITTIVITY[0], PERMITTIVITY[-1]) * (
            1 - 1j * _loss_off(permittivity)
        )
        down = 2 * np.pi * tones / SPEED_OF_LIGHT * np.sqrt(soil - SINE[:, None] ** 2)  # (sine, f)
        total = sum(
            CubicSpline(FREQUENCY, part, axis=-1)(tones) * np.exp(-1j * down * way)[:, None, None]
            for part, (_, way) in zip(here, parts, strict=True)
        )
        fade = np.minimum(frequency / FREQUENCY[0], 1.0) ** 2
        return np.asarray(total * fade, dtype=np.complex64)

    def _parts(self, depth: float, down: FloatArray) -> list[tuple[Any, float]]:
        """Split off what the surface adds, at a depth: each part, and the way (m) whose phase makes it smooth.

        Echoes of a dielectric body's top and bottom lie about its middle, those of metal at its
        top; what the surface adds comes later by its first bounce, and falls as 1/d below the last
        node.
        """
        way = 0.0 if self.body.metal else self.body.height
        deep = self.values[:, :, -1]
        if self.values.shape[2] == 1 or depth == np.inf:
            return [(deep, way)]
        nodes = DEPTH[:-1]
        place = np.interp(depth, nodes, np.arange(nodes.size))
        low = min(int(place), nodes.size - 2)
        added: Any = 0
        for node, share in ((low, 1 - (place - low)), (low + 1, place - low)):
            if share > 0:
                turn = np.exp(2j * down * (nodes[node] - max(depth, nodes[0])))
                added = added + share * (self.values[:, :, node] - deep) * _along(turn)
        return [
            (deep, way),
            (added * min(nodes[-1] / max(depth, nodes[0]), 1.0), way + 2 * max(depth, nodes[0])),
        ]


def _along(phase: ComplexArray) -> ComplexArray:
    """Bring (permittivity, frequency, sine) to (permittivity, frequency, aspect, sine, separation, 4)."""
    return phase[:, :, None, :, None, None]


def _loss_off(permittivity: ComplexArray) -> FloatArray:
    """Loss tangent of a soil over that of the table at its permittivity, at most 0.06 either way."""
    index = np.sqrt(permittivity.real)
    table = np.interp(index, np.sqrt(PERMITTIVITY), LOSS)
    return np.clip(-permittivity.imag / permittivity.real - table, -_LOSS_REACH, _LOSS_REACH)


def save_table(table: SignatureTable, path: Path) -> str:
    """Write a table as one file, right to 1e-3 of the largest value of a soil and tone, and return its SHA-256."""
    scale = np.abs(table.values).max(axis=(2, 3, 4, 5, 6), keepdims=True)
    parts = (table.values / scale).view(np.float32).astype(np.float16)
    about = {"format": FORMAT, "body": table.body.model_dump(mode="json"), "nodes": table_nodes()}
    text = np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, about=text, values=parts, scale=scale.astype(np.float32))
    path.write_bytes(buffer.getvalue())
    return sha256(buffer.getvalue()).hexdigest()


def table_nodes() -> dict[str, list[float]]:
    """Where tables are computed."""
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
    """Read what :func:`save_table` wrote; another file, or one for other nodes, is a ValueError."""
    try:
        data = Archive(
            io.BytesIO(read_named(path) if isinstance(path, Path) else path.read_bytes())
        )
        about = parse_json(bytes(data["about"]))
        values = data["values"].astype(np.float32).view(np.complex64) * data["scale"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"signature {path}: not a table of signatures: {error}") from None
    if about.get("format") != FORMAT or about.get("nodes") != table_nodes():
        raise ValueError(
            f"signature {path}: made for other nodes, make it again with flgpr simulate signature"
        )
    return SignatureTable(Body.model_validate(about["body"]), values)


@cache
def packaged_table(name: str) -> SignatureTable:
    """Table of a packaged body."""
    return load_table(resources.files("flgpr.simulate.bodies.signature") / "tables" / f"{name}.npz")


@lru_cache(maxsize=32)
def find_table(name: str) -> SignatureTable:
    """Find a table by the name of a packaged body or the path of a file; ValueError if there is neither."""
    if name in packaged_bodies():
        return packaged_table(name)
    if not Path(name).is_file():
        raise ValueError(no_preset("body", name, packaged_bodies()))
    return load_table(Path(name))


def body_size(name: str) -> dict[str, float]:
    """Radius (of a box half its long side) and height of a body, m; arguments as of :func:`find_table`."""
    body = load_body(name) if name in packaged_bodies() else find_table(name).body
    return {"radius": body.radius * body.elongation, "height": body.height}
